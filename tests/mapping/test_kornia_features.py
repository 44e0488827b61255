"""DISK and LightGlue from weight files: untrained ones here, since none are downloaded."""

import os

import numpy as np
import pytest
from rgbd_room import walls

from jaxgeo.errors import InputError
from jaxgeo.mapping.image_features import feature_method
from jaxgeo.mapping.kornia_features import DiskFeatures, find_weights

torch = pytest.importorskip("torch")
kornia_feature = pytest.importorskip("kornia.feature")
IMAGE = np.ascontiguousarray(walls(0)[0][:70, :90])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("weights")
    torch.manual_seed(0)
    torch.save({"extractor": kornia_feature.DISK().state_dict()}, path / "depth-save.pth")
    return path


def test_features_lie_in_the_image_and_find_themselves(folder):
    method, words = feature_method("auto", folder)
    assert method.name == "disk"
    assert "depth-save.pth" in words
    assert "mutual nearest neighbours" in words
    features = method.extract(IMAGE)
    assert len(features) > 10
    assert np.all((features.points_px >= 0) & (features.points_px <= [89, 69]))
    np.testing.assert_allclose(np.linalg.norm(features.descriptors, axis=1), 1.0, atol=1e-5)
    pairs = method.match(features, features)
    np.testing.assert_array_equal(pairs[:, 0], pairs[:, 1])


def test_a_file_of_other_content_is_refused(tmp_path):
    (tmp_path / "depth-save.pth").write_bytes(b"no weights at all")
    with pytest.raises(InputError, match=r"depth-save.pth: does not hold the weights of DISK"):
        feature_method("disk", tmp_path)
    torch.save({"extractor": {"other": torch.zeros(3)}}, tmp_path / "depth-save.pth")
    with pytest.raises(InputError, match="does not hold the weights of DISK"):
        feature_method("disk", tmp_path)


def test_lightglue_weights_are_read_under_their_published_names(folder, tmp_path):
    torch.manual_seed(1)
    state = kornia_feature.LightGlue(features=None, weights=None, input_dim=128).state_dict()
    published = {}
    for name, value in state.items():
        parts = name.split(".")
        old = [parts[2], parts[1], *parts[3:]] if parts[0] == "transformers" else parts
        published[".".join(old)] = value
    assert published.keys() != state.keys()
    torch.save(published, tmp_path / "disk_lightglue.pth")
    os.link(folder / "depth-save.pth", tmp_path / "depth-save.pth")
    method = DiskFeatures(find_weights(tmp_path))
    for name, value in method._lightglue.state_dict().items():
        assert torch.equal(value, state[name]), name
    features = method.extract(IMAGE)
    pairs = method.match(features, features)
    assert pairs.dtype == np.int64
    assert pairs.shape[1] == 2
