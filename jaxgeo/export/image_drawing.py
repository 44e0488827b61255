"""Outlines, words and axes drawn into images, on a dark ground: they must be read on snow and on grass."""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from jaxgeo.associate.camera_model import project
from jaxgeo.data import Camera

Bgr = tuple[int, int, int]
OUTLINE: Bgr = (0, 230, 255)
HALO: Bgr = (0, 0, 0)
AXES: tuple[Bgr, Bgr, Bgr] = ((60, 60, 255), (70, 220, 70), (255, 120, 60))
PAPER: Bgr = (245, 245, 245)
INK: Bgr = (30, 30, 30)

_FONT = cv2.FONT_HERSHEY_SIMPLEX
_FONT_HEIGHT_PX = 22.0  # of a capital letter of this font at scale 1
# Line coordinates are whole numbers of a sixteenth of a pixel.
_SHIFT = 4
_AXIS_POINTS = 9


def as_bgr(image: UInt8[np.ndarray, "h w ..."]) -> UInt8[np.ndarray, "h w 3"]:
    """A copy in colour, to be drawn upon."""
    return cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else np.ascontiguousarray(image).copy()


def draw_path(
    image: UInt8[np.ndarray, "h w 3"], points_px: Float[np.ndarray, "n 2"], colour: Bgr, width_px: int, closed: bool
) -> None:
    """A line through points, pixel centres at whole coordinates, drawn in place."""
    if not np.all(np.abs(points_px) < 1e5):  # what lies so far out would overflow OpenCV's fixed point numbers
        return
    points = np.round(points_px * 2**_SHIFT).astype(np.int32)
    for ink, width in ((HALO, width_px + 2), (colour, width_px)):
        cv2.polylines(image, [points], closed, ink, width, cv2.LINE_AA, _SHIFT)


def draw_words(image: UInt8[np.ndarray, "h w 3"], text: str, at_px: tuple[float, float], height_px: float) -> None:
    """White words on a dark plate, capitals `height_px` high, centred on `at_px` but wholly inside the image."""
    width, height = words_size(text, height_px)
    room = round(0.3 * height_px)
    left = int(np.clip(at_px[0] - width / 2, room, max(room, image.shape[1] - width - room)))
    base = int(np.clip(at_px[1] + height / 2, height + room, max(height + room, image.shape[0] - room)))
    cv2.rectangle(image, (left - room, base - height - room), (left + width + room, base + room), HALO, cv2.FILLED)
    draw_line_of_text(image, text, left, base, height_px, (255, 255, 255))


def draw_line_of_text(
    image: UInt8[np.ndarray, "h w 3"], text: str, left_px: int, base_px: int, height_px: float, ink: Bgr = INK
) -> None:
    """Plain words from a point on their base line."""
    scale = height_px / _FONT_HEIGHT_PX
    cv2.putText(image, text, (left_px, base_px), _FONT, scale, ink, _thickness(height_px), cv2.LINE_AA)


def words_size(text: str, height_px: float) -> tuple[int, int]:
    """Width and height that the words take, pixels."""
    (width, height), _ = cv2.getTextSize(text, _FONT, height_px / _FONT_HEIGHT_PX, _thickness(height_px))
    return width, height


def fitting(text: str, width_px: int, height_px: float) -> str:
    """The text, cut short with dots where it is wider than there is room."""
    if words_size(text, height_px)[0] <= width_px:
        return text
    while text and words_size(text + "..", height_px)[0] > width_px:
        text = text[:-1]
    return text + ".."


def draw_markers(
    image: UInt8[np.ndarray, "h w 3"], corners_px: Float[np.ndarray, "m 4 2"], names: Sequence[str], height_px: float
) -> None:
    """Outline and name of every marker; the name stands below it, or above it at the image's lower edge."""
    width = max(1, round(height_px / 9))
    for corners in corners_px:
        draw_path(image, corners, OUTLINE, width, closed=True)
    for corners, name in zip(corners_px, names, strict=True):
        y = corners[:, 1].max() + 1.2 * height_px
        if y + height_px > image.shape[0]:
            y = corners[:, 1].min() - 1.2 * height_px
        draw_words(image, name, (corners[:, 0].mean(), y), height_px)


def draw_axes(
    image: UInt8[np.ndarray, "h w 3"],
    camera: Camera,
    t_cam_marker_m: Float[np.ndarray, "3"],
    R_cam_marker: Float[np.ndarray, "3 3"],
    length_m: float,
    width_px: int,
) -> None:
    """The marker's axes x red, y green, z (out of the print) blue, through the camera's distortion.

    An axis of which a point leaves the range of the camera model is left out. The one furthest from the camera is
    drawn first.
    """
    along_m = np.linspace(0.0, length_m, _AXIS_POINTS)
    for axis in np.argsort(-R_cam_marker[2]):
        points_m = t_cam_marker_m + along_m[:, None] * R_cam_marker[:, axis]
        pixels, _, ok = project(points_m, camera)
        if ok.all():
            draw_path(image, pixels, AXES[axis], width_px, closed=False)


def _thickness(height_px: float) -> int:
    return max(1, round(height_px / 9))
