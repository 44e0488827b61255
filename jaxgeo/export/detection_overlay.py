"""What was detected in one image: the raw image, the mask where there is one, markers with their poses; in one row."""

from collections.abc import Sequence

import cv2
import equinox as eqx
import numpy as np
from jaxtyping import Float, UInt8

from jaxgeo.data import Camera
from jaxgeo.export.image_drawing import (
    INK,
    PAPER,
    as_bgr,
    draw_axes,
    draw_line_of_text,
    draw_markers,
    fitting,
    words_size,
)

# A panel is at least so wide, so that its words fit, and at most so wide, so that three fit a screen.
_PANEL_WIDTH_PX = (480, 960)
_GAP_PX = 6


class MarkerPoses(eqx.Module):
    """Poses of the markers of one image in its camera.

    Attributes:
        camera: the camera.
        t_cam_marker_m: (m, 3).
        R_cam_marker: (m, 3, 3).
        size_m: (m,) side of each.
    """

    camera: Camera
    t_cam_marker_m: Float[np.ndarray, "m 3"]
    R_cam_marker: Float[np.ndarray, "m 3 3"]
    size_m: Float[np.ndarray, "m"]


def detection_overlay(
    image: UInt8[np.ndarray, "h w ..."],
    corners_px: Float[np.ndarray, "m 4 2"],
    names: Sequence[str],
    *,
    mask: UInt8[np.ndarray, "h w"] | None = None,
    poses: MarkerPoses | None = None,
    title: str = "",
) -> UInt8[np.ndarray, "a b 3"]:
    """Panels `raw`, `mask` (where one is given) and `markers`, BGR, under one line of words.

    Args:
        image: BGR or gray.
        corners_px: raw pixels of every marker, names in the same order.
        mask: 0 outside, 255 inside the colour range.
        poses: axes half a side long are drawn where they are known.
        title: what the line says: stamp, camera, source.
    """
    scale = float(np.clip(image.shape[1], *_PANEL_WIDTH_PX)) / image.shape[1]
    words_px = np.clip(scale * image.shape[1] / 55.0, 11.0, 18.0)
    marked = _scaled(as_bgr(image), scale)
    # A pixel's centre is at whole coordinates: the image's edge, at -1/2, is what scaling keeps in place.
    draw_markers(marked, (corners_px + 0.5) * scale - 0.5, names, words_px)
    if poses is not None:
        seen = _scaled_camera(poses.camera, scale)
        for t, R, size in zip(poses.t_cam_marker_m, poses.R_cam_marker, poses.size_m, strict=True):
            draw_axes(marked, seen, t, R, 0.5 * float(size), max(2, round(words_px / 6)))
    panels = [("raw", _scaled(as_bgr(image), scale))]
    if mask is not None:
        panels.append(("mask", _scaled(as_bgr(mask), scale)))
    axes = "" if poses is None else "; axes half a side: x red, y green, z blue"
    panels.append((f"markers{axes}", marked))
    return _beside(panels, title, float(words_px))


def _scaled(image: UInt8[np.ndarray, "h w 3"], scale: float) -> UInt8[np.ndarray, "a b 3"]:
    if scale == 1.0:
        return image
    size = (round(image.shape[1] * scale), round(image.shape[0] * scale))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA if scale < 1.0 else cv2.INTER_CUBIC)


def _scaled_camera(camera: Camera, scale: float) -> Camera:
    fx, fy, cx, cy = camera.intrinsics_px
    moved = np.array([fx * scale, fy * scale, (cx + 0.5) * scale - 0.5, (cy + 0.5) * scale - 0.5])
    return eqx.tree_at(lambda c: c.intrinsics_px, camera, moved)


def _beside(
    panels: Sequence[tuple[str, UInt8[np.ndarray, "h w 3"]]], title: str, words_px: float
) -> UInt8[np.ndarray, "a b 3"]:
    height, width = panels[0][1].shape[:2]
    strip = round(2.0 * words_px)
    top = strip if title else 0
    page = np.full((top + strip + height, len(panels) * (width + _GAP_PX) - _GAP_PX, 3), PAPER, np.uint8)
    if title:
        draw_line_of_text(page, fitting(title, page.shape[1] - 8, words_px), 4, round(1.5 * words_px), words_px, INK)
    for k, (name, image) in enumerate(panels):
        left = k * (width + _GAP_PX)
        small = min(words_px, words_px * (width - 8) / max(words_size(name, words_px)[0], 1))
        draw_line_of_text(page, name, left + 4, top + round(1.5 * words_px), small, INK)
        page[top + strip :, left : left + width] = image
    return page
