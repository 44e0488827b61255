"""Features: partners of a shifted image, and what must not become a partner."""

import cv2
import numpy as np
import pytest
from rgbd_room import walls

from jaxgeo.errors import InputError
from jaxgeo.mapping.image_features import Features, SiftFeatures, feature_method, match_mutual
from jaxgeo.mapping.image_likeness import image_vectors

METHOD = SiftFeatures()


def picture(seed: int, width: int = 320) -> np.ndarray:
    return np.ascontiguousarray(walls(seed)[0][:240, :width])


def test_partners_of_a_shifted_image_lie_at_the_shift():
    image = picture(0)
    first, second = METHOD.extract(image[:200, :280]), METHOD.extract(image[17:217, 31:311])
    pairs = METHOD.match(first, second)
    shift = first.points_px[pairs[:, 0]] - second.points_px[pairs[:, 1]]
    assert len(pairs) > 60
    assert np.mean(np.linalg.norm(shift - [31.0, 17.0], axis=1) < 1.0) > 0.97


def test_descriptors_are_of_unit_length_and_the_strongest_come_first():
    many, few = SiftFeatures(200).extract(picture(1)), SiftFeatures(50).extract(picture(1))
    np.testing.assert_allclose(np.linalg.norm(many.descriptors, axis=1), 1.0, atol=1e-5)
    assert {tuple(point) for point in few.points_px} <= {tuple(point) for point in many.points_px}


def test_no_place_counts_twice():
    features = METHOD.extract(picture(2))
    pairs = METHOD.match(features, features)
    places = np.round(features.points_px[pairs[:, 0]])
    assert len(np.unique(places, axis=0)) == len(places) > 100


def test_what_is_there_twice_has_no_partner():
    image = picture(3, 160)
    alone, twice = METHOD.extract(image), METHOD.extract(np.hstack([image, image]))
    well_inside = np.abs(alone.points_px[:, 0] - 80) < 50
    assert len(METHOD.match(alone, alone)) > 50
    assert np.mean(np.isin(np.flatnonzero(well_inside), METHOD.match(alone, twice)[:, 0])) < 0.1


def test_neither_a_mirrored_nor_another_image_is_a_partner():
    image = picture(4)
    features = METHOD.extract(image)
    assert len(METHOD.match(features, METHOD.extract(cv2.flip(image, 1)))) < 0.03 * len(features)
    assert len(METHOD.match(features, METHOD.extract(picture(5)))) < 0.03 * len(features)


def test_an_empty_image_has_no_features_and_no_partners():
    nothing = METHOD.extract(np.zeros((100, 120, 3), dtype=np.uint8))
    assert len(nothing) == 0
    assert METHOD.match(nothing, METHOD.extract(picture(0))).shape == (0, 2)


def test_match_mutual_against_the_definition():
    random = np.random.default_rng(0)
    sides = []
    for n in (40, 55):
        descriptors = np.abs(random.normal(size=(n, 8)))
        points = np.stack([np.arange(n) * 10.0, np.zeros(n)], axis=1)
        sides.append(Features(points, descriptors / np.linalg.norm(descriptors, axis=1, keepdims=True), (600, 1)))
    distance = np.linalg.norm(sides[0].descriptors[:, None] - sides[1].descriptors[None], axis=2)
    expected = []
    for i, row in enumerate(distance):
        j = int(np.argmin(row))
        clear = row[j] < 0.9 * np.partition(row, 1)[1] and row[j] < 0.9 * np.partition(distance[:, j], 1)[1]
        if clear and np.argmin(distance[:, j]) == i:
            expected.append((i, j))
    assert len(expected) > 3
    assert sorted(map(tuple, match_mutual(*sides, 0.9).tolist())) == expected


def test_without_weights_it_is_sift_and_says_so(tmp_path):
    method, words = feature_method("auto", tmp_path)
    assert isinstance(method, SiftFeatures)
    assert "SIFT, since there are no weights" in words
    assert str(tmp_path) in words


@pytest.mark.parametrize(("name", "words"), [("orb", "'orb' is not known"), ("disk", "no weights of DISK")])
def test_methods_that_cannot_be_had_are_refused(tmp_path, name, words):
    with pytest.raises(InputError, match=words):
        feature_method(name, tmp_path)


def test_views_of_one_scene_are_more_alike_than_others():
    scenes = [METHOD.extract(picture(seed)[:200, left : left + 220]) for seed in range(6) for left in (0, 60)]
    vectors = image_vectors([*scenes, METHOD.extract(np.zeros((50, 50, 3), dtype=np.uint8))], words=8)
    likeness = vectors @ vectors.T - 2.0 * np.eye(len(vectors))
    np.testing.assert_array_equal(np.argmax(likeness[:12], axis=1), np.arange(12) ^ 1)
    assert not vectors[12].any()


def test_with_one_word_two_images_are_opposite():
    """Differences from the mean of both sum to opposite vectors: VLAD by its definition."""
    random = np.random.default_rng(0)
    images = [Features(np.zeros((50, 2)), random.normal(size=(50, 16)).astype(np.float32), (9, 9)) for _ in range(2)]
    first, second = image_vectors(images, words=1)
    assert first @ second == pytest.approx(-1.0, abs=1e-3)
