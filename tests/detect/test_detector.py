"""The detector on pictures with known markers, and on the real photographs."""

import cv2
import numpy as np
import pytest
from data_root import data_root
from printed_marker import printed, slanted

from jaxgeo.detect import Detector, DetectorSettings, Gates
from jaxgeo.errors import DetectError

SHAPE = (240, 320)


def two_markers() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    first, second = slanted(50.0, (80.3, 100.6), 0.3), slanted(70.0, (220.1, 120.2), 1.2)
    image = np.minimum(printed("apriltag_36h11", 12, first, SHAPE), printed("4x4_50", 3, second, SHAPE))
    return image, first, second


def test_several_families_in_one_run():
    image, first, second = two_markers()
    found = Detector(DetectorSettings(families=("apriltag_36h11", "DICT_4X4_50")))(image)
    assert set(zip(found.family.tolist(), found.marker.tolist(), strict=True)) == {
        ("apriltag_36h11", 12),
        ("4x4_50", 3),
    }
    tag = found.corners_px[found.family == "apriltag_36h11"][0]
    np.testing.assert_allclose(tag, np.roll(first, -2, axis=0)[[3, 2, 1, 0]], atol=0.1)
    other = found.corners_px[found.family == "4x4_50"][0]
    np.testing.assert_allclose(other, second[[3, 2, 1, 0]], atol=0.1)


def test_gray_and_colour_give_the_same():
    image = two_markers()[0]
    gray = Detector(DetectorSettings())(image)
    colour = Detector(DetectorSettings())(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    np.testing.assert_allclose(gray.corners_px, colour.corners_px, atol=1e-6)


def test_ids_out_of_use_are_refused_and_counted():
    detector = Detector(DetectorSettings(gates=Gates(ids=frozenset({1, 2}))))
    assert len(detector(two_markers()[0])) == 0
    assert detector.refused["id not in use"] > 0


def test_kornia_s_quads_give_the_same_corners():
    image = two_markers()[0]
    image = cv2.resize(image, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    ours = Detector(DetectorSettings())(image)
    theirs = Detector(DetectorSettings(decoder="kornia"))(image)
    assert theirs.marker.tolist() == ours.marker.tolist() == [12]
    np.testing.assert_allclose(theirs.corners_px, ours.corners_px, atol=0.05)


def test_a_small_marker_gets_a_second_look():
    corners = slanted(13.0, (100.2, 90.7), 0.35)
    image = printed("apriltag_36h11", 40, corners, SHAPE, black=60, white=190)
    found = Detector(DetectorSettings(gates=Gates(max_hamming=3, min_margin=0.1)))(image)
    assert found.marker.tolist() == [40]
    np.testing.assert_allclose(found.corners_px[0], np.roll(corners, -2, axis=0)[[3, 2, 1, 0]], atol=0.4)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros((4, 5), np.float32), "type float32; expected bytes"),
        (np.zeros((4, 5, 4), np.uint8), r"shape \(4, 5, 4\)"),
    ],
)
def test_images_of_another_kind_are_refused(image, message):
    with pytest.raises(DetectError, match=message):
        Detector(DetectorSettings())(image)


def test_a_mask_needs_colour():
    from jaxgeo.detect.mask import MaskSettings

    with pytest.raises(DetectError, match="a mask needs colour"):
        Detector(DetectorSettings(mask=MaskSettings()))(np.zeros((40, 50), np.uint8))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"families": ()}, "no marker family"),
        ({"decoder": "pupil"}, "decoder 'pupil' is not known"),
        ({"decoder": "kornia", "families": ("4x4_50",)}, "not 4x4_50; use decoder opencv"),
    ],
)
def test_settings_that_make_no_sense(settings, message):
    with pytest.raises(DetectError, match=message):
        Detector(DetectorSettings(**settings))


def test_the_photographs_of_a_room():
    """Every sixth of the 72: every listed id, none that is not listed."""
    folder = data_root() / "tags" / "swatbotics_mapping"
    rows = [line.split() for line in (folder / "groundtruth_ids.txt").read_text().splitlines() if line.strip()]
    detector = Detector(DetectorSettings())
    for name, *ids in rows[::6]:
        found = detector(cv2.imread(str(folder / name)))
        assert sorted(found.marker.tolist()) == sorted(map(int, ids)), name


def test_the_photograph_of_a_screen():
    image = cv2.imread(str(data_root() / "tags" / "aruco_fdcl" / "test_image.png"))
    found = Detector(DetectorSettings(families=("aruco_original",)))(image)
    assert sorted(found.marker.tolist()) == list(range(8))
