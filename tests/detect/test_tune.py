"""A colour range learned from labels: found from a wrong start, round the hue circle, never worse."""

import cv2
import numpy as np
import pytest

from jaxgeo.detect.mask import GREEN, HsvRange, hsv_mask
from jaxgeo.detect.tune import LabelledFrame, read_labelled, tune_range
from jaxgeo.errors import DetectError


def frame(seed: int, hue: float, name: str = "a.png") -> LabelledFrame:
    """A disc of one hue, its saturation 150 to 220, on grays, browns and the opposite hue."""
    rng = np.random.default_rng(seed)
    shape = (60, 80)
    hsv = np.empty((*shape, 3))
    hsv[..., 0] = np.where(rng.random(shape) < 0.5, (hue + 90) % 180, 15)
    hsv[..., 1] = rng.uniform(0, 110, shape)
    hsv[..., 2] = rng.uniform(30, 220, shape)
    y, x = np.mgrid[: shape[0], : shape[1]]
    label = (x - 40) ** 2 + (y - 30) ** 2 < 18**2
    hsv[label, 0] = (hue + rng.normal(0, 3, label.sum())) % 180
    hsv[label, 1] = rng.uniform(150, 220, label.sum())
    hsv[label, 2] = rng.uniform(90, 200, label.sum())
    return LabelledFrame(name, cv2.cvtColor(hsv.astype(np.uint8), cv2.COLOR_HSV2BGR), label)


@pytest.mark.parametrize("hue", [60.0, 0.0])
def test_the_colour_is_found_from_a_wrong_start(hue):
    tuned = tune_range([frame(0, hue), frame(1, hue, "b.png")], HsvRange((80, 200, 10), (110, 255, 255)))
    assert tuned.improved
    assert tuned.iou_before < 0.3
    assert tuned.iou_after > 0.95
    other = frame(2, hue, "c.png")
    mask = hsv_mask(other.bgr, tuned.hsv) > 0
    assert np.mean(mask == other.label) > 0.97
    assert set(tuned.frame_iou) == {"a.png", "b.png"}


def test_a_right_start_is_never_made_worse():
    seen = frame(3, 60.0)
    start = tune_range([seen], GREEN).hsv
    again = tune_range([seen], start)
    assert again.iou_after >= again.iou_before
    assert again.iou_before == tune_range([seen], GREEN).iou_after


def write(path, image):
    assert cv2.imwrite(str(path), image)


def test_labels_are_read_from_masks_and_polygons(tmp_path):
    one, two = frame(0, 60.0), frame(1, 60.0)
    write(tmp_path / "a.png", one.bgr)
    write(tmp_path / "a.mask.png", 255 * one.label.astype(np.uint8))
    write(tmp_path / "b.png", two.bgr)
    write(tmp_path / "unlabelled.png", two.bgr)
    (tmp_path / "labels.csv").write_text("image,x0,y0,x1,y1,x2,y2\nb.png,10,10,30,10,30,20,10,20\n")
    first, second = read_labelled(tmp_path)
    assert (first.name, second.name) == ("a.png", "b.png")
    np.testing.assert_array_equal(first.label, one.label)
    assert second.label.sum() == 21 * 11


@pytest.mark.parametrize(
    ("labels", "message"),
    [
        ("a.png,1,2,3,4\n", r"labels.csv:1: 4 numbers; expected x, y of three corners"),
        ("a.png,1,2,x,4,5,6\n", r"labels.csv:1: .* are not numbers"),
        ("z.png,1,2,3,4,5,6\n", r"no image 'z.png'"),
        ("", r"no labelled image"),
    ],
)
def test_labels_that_are_wrong_are_named(tmp_path, labels, message):
    write(tmp_path / "a.png", frame(0, 60.0).bgr)
    (tmp_path / "labels.csv").write_text(labels)
    with pytest.raises(DetectError, match=message):
        read_labelled(tmp_path)


def test_a_mask_of_another_size_is_refused(tmp_path):
    write(tmp_path / "a.png", frame(0, 60.0).bgr)
    write(tmp_path / "a.mask.png", np.full((10, 10), 255, np.uint8))
    with pytest.raises(DetectError, match="10 x 10 pixels, but its image has 80 x 60"):
        read_labelled(tmp_path)
