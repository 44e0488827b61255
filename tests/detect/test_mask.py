"""Masks: both ends belong to a range, hue wraps round, the soft mask is the hard one with ramps; batches agree."""

import cv2
import numpy as np
import pytest
from data_root import data_root

from jaxgeo.detect.mask import BLUE, GREEN, RED, HsvRange, MaskSettings, clean, hsv_mask, soft_mask
from jaxgeo.errors import DetectError


def every_colour(step: int) -> np.ndarray:
    at = np.arange(0, 256, step, dtype=np.uint8)
    b, g, r = np.meshgrid(at, at, at, indexing="ij")
    return np.stack([b, g, r], axis=-1).reshape(len(at), -1, 3)


@pytest.mark.parametrize(
    "hsv", [GREEN, RED, BLUE, HsvRange((0, 0, 0), (179, 255, 255)), HsvRange((60, 10, 9), (60, 10, 200))]
)
def test_a_mask_is_the_box_of_colours(hsv):
    colours = every_colour(5)
    h, s, v = np.moveaxis(cv2.cvtColor(colours, cv2.COLOR_BGR2HSV), 2, 0)
    hue = (h >= hsv.low[0]) & (h <= hsv.high[0])
    if hsv.low[0] > hsv.high[0]:
        hue = (h >= hsv.low[0]) | (h <= hsv.high[0])
    inside = hue & (s >= hsv.low[1]) & (s <= hsv.high[1]) & (v >= hsv.low[2]) & (v <= hsv.high[2])
    np.testing.assert_array_equal(hsv_mask(colours, hsv) > 0, inside)
    np.testing.assert_array_equal(soft_mask(colours, hsv) > 127, inside)


def test_opening_removes_speckle_and_closing_fills_holes():
    mask = np.zeros((20, 20), np.uint8)
    mask[5:15, 5:15] = 255
    mask[9, 9], mask[1, 1] = 0, 255
    opened = clean(mask, MaskSettings(open_px=2))
    assert opened[1, 1] == 0
    both = clean(mask, MaskSettings(open_px=2, close_px=3))
    assert both[9, 9] == 255
    np.testing.assert_array_equal(clean(mask, MaskSettings()), mask)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: HsvRange((180, 0, 0), (10, 255, 255)), "low is .180, 0, 0.; expected H 0 to 179"),
        (lambda: HsvRange((10, 200, 0), (20, 100, 255)), "S runs from 200 to 100; expected the low end first"),
        (lambda: MaskSettings(polarity="inverted"), "polarity 'inverted'; expected one of auto, marker, ground"),
        (lambda: MaskSettings(open_px=-1), "open_px is -1"),
    ],
)
def test_settings_out_of_range_are_named(make, message):
    with pytest.raises(DetectError, match=message):
        make()


def test_the_board_of_the_demo_frames_is_green():
    """The screen captures of a real iMarker: its board lies in a darker green than the default, all else outside."""
    frame = cv2.imread(str(data_root() / "imarkers" / "demo_frames" / "f033.png"))[132:467, 8:260]
    mask = hsv_mask(frame, HsvRange((60, 100, 20), (100, 255, 120))) > 0
    assert mask[200:300, 190:245].mean() > 0.9
    assert mask[:90].mean() < 0.02


def test_masks_of_many_frames_are_opencv_s_byte_for_byte():
    torch = pytest.importorskip("torch")
    from jaxgeo.detect.mask_batched import clean_masks, hsv_bytes, hsv_masks

    colours = every_colour(3)
    rgb = torch.from_numpy(np.ascontiguousarray(colours[..., ::-1]).transpose(2, 0, 1).copy())[None]
    ours = hsv_bytes(rgb)[0].numpy().transpose(1, 2, 0)
    np.testing.assert_array_equal(ours, cv2.cvtColor(colours, cv2.COLOR_BGR2HSV))
    for hsv in (GREEN, RED):
        np.testing.assert_array_equal(hsv_masks(rgb, hsv)[0].numpy(), hsv_mask(colours, hsv))
    noise = (np.random.default_rng(0).random((2, 40, 50)) < 0.6).astype(np.uint8) * 255
    for settings in (MaskSettings(open_px=3), MaskSettings(close_px=4), MaskSettings(open_px=2, close_px=5)):
        cleaned = clean_masks(torch.from_numpy(noise), settings).numpy()
        for one, mask in zip(cleaned, noise, strict=True):
            np.testing.assert_array_equal(one, clean(mask, settings))
    with pytest.raises(DetectError, match="expected a torch tensor of bytes"):
        hsv_masks(rgb.float(), GREEN)
