"""An HSV range fitted to labelled images by gradient, through a soft mask on kornia's colour space (extra `vision`).

A hard mask has no slope. Here each end of the range is a sigmoid, hue is measured round the circle from the range's
middle, and the overlap with the labels (soft Dice) is climbed with Adam from several starts while the sigmoids grow
steep. What is returned is judged by the hard mask that detection uses.
"""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from jaxgeo.detect.mask import HsvRange, hsv_mask
from jaxgeo.errors import DetectError
from jaxgeo.io.sightings_csv import LARGEST_PIXEL
from jaxgeo.io.text_file import read_lines

_MOST_PIXELS = 200_000
_STEPS, _RATE = 300, 0.05
# Softness at the start and at the end: of hue in radians, of S and V as shares.
_SOFT_HUE, _SOFT_SHARE = (0.35, 0.02), (0.12, 0.01)
# Labels hold mixed and shaded pixels: a start from them leaves out these tails.
_TAILS = (0.03, 0.97)
_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")


@dataclasses.dataclass(frozen=True)
class LabelledFrame:
    """An image, and where in it the reflector is."""

    name: str
    bgr: UInt8[np.ndarray, "h w 3"]
    label: Bool[np.ndarray, "h w"]


@dataclasses.dataclass(frozen=True)
class Tuned:
    """A fitted range.

    Attributes:
        hsv: the range; the start itself where nothing overlapped better.
        iou_before, iou_after: intersection over union of all frames' hard masks with their labels.
        frame_iou: by frame: before, after.
        improved: whether `hsv` is another range than the start.
    """

    hsv: HsvRange
    iou_before: float
    iou_after: float
    frame_iou: dict[str, tuple[float, float]]
    improved: bool


def read_labelled(folder: Path) -> list[LabelledFrame]:
    """Images with a mask beside them (`frame.png`, `frame.mask.png`: white where the reflector is), or outlined in
    `labels.csv` (rows `image, x0, y0, x1, y1, ..`, pixels; several rows of one image add up).

    Raises:
        DetectError: no labelled image, a mask of another size, a polygon with fewer than three corners, no such image.
    """
    polygons = _polygons(folder / "labels.csv")
    frames = []
    for path in sorted(folder.iterdir() if folder.is_dir() else []):
        if path.suffix.lower() not in _SUFFIXES or path.stem.endswith(".mask"):
            continue
        mask = path.with_name(f"{path.stem}.mask.png")
        if mask.exists():
            label = _read(mask, cv2.IMREAD_GRAYSCALE) > 127
        elif path.name in polygons:
            label = np.zeros(_read(path).shape[:2], np.uint8)
            cv2.fillPoly(label, [np.rint(p).astype(np.int32) for p in polygons[path.name]], 1)
            label = label > 0
        else:
            continue
        image = _read(path)
        if label.shape != image.shape[:2]:
            raise DetectError(
                f"{mask}: {label.shape[1]} x {label.shape[0]} pixels, but its image has {image.shape[1]} x "
                f"{image.shape[0]}; expected the same size."
            )
        frames.append(LabelledFrame(path.name, image, label))
    missing = sorted(set(polygons) - {frame.name for frame in frames})
    if missing:
        raise DetectError(f"{folder / 'labels.csv'}: no image {missing[0]!r} in the folder.")
    if not frames or not any(frame.label.any() for frame in frames):
        raise DetectError(
            f"{folder}: no labelled image. Put NAME.mask.png beside NAME.png, white where the reflector is, or a table "
            "labels.csv with rows image, x0, y0, x1, y1, .."
        )
    return frames


def tune_range(frames: Sequence[LabelledFrame], start: HsvRange) -> Tuned:
    """The range whose mask overlaps the labels best, never worse than the start.

    Raises:
        DetectError: kornia or torch are not installed; every pixel is labelled, or none.
    """
    pixels, label = _sample(frames)
    if label.all() or not label.any():
        raise DetectError("labels: every pixel is labelled, or none; expected some of both.")
    before = _iou(frames, start)
    best, best_iou = start, before
    for begin in (start, _from_labels(pixels[label])):
        found = _fitted(pixels, label, begin)
        iou = _iou(frames, found)
        if iou > best_iou:
            best, best_iou = found, iou
    each = {frame.name: (_iou([frame], start), _iou([frame], best)) for frame in frames}
    return Tuned(best, before, best_iou, each, best != start)


def _fitted(pixels: UInt8[np.ndarray, "n 3"], label: Bool[np.ndarray, "n"], begin: HsvRange) -> HsvRange:
    """Adam on soft Dice: 1 - 2 sum(m l) / (sum m + sum l)."""
    torch, kornia = _vision()
    rgb = torch.from_numpy(pixels[:, ::-1].astype(np.float64).T[None, :, :, None] / 255.0)
    hue, saturation, value = kornia.color.rgb_to_hsv(rgb)[0, :, :, 0]
    target = torch.from_numpy(label.astype(np.float64))
    width = (begin.high[0] - begin.low[0]) % 180
    middle = (begin.low[0] + width / 2) * np.pi / 90.0
    ends = [begin.low[1] / 255, begin.high[1] / 255, begin.low[2] / 255, begin.high[2] / 255]
    unknown = torch.tensor([middle, max(width, 2) * np.pi / 180.0, *ends], dtype=torch.float64, requires_grad=True)
    optimiser = torch.optim.Adam([unknown], lr=_RATE)
    for step in range(_STEPS):
        done = step / (_STEPS - 1)
        soft_hue, soft = (a * (b / a) ** done for a, b in (_SOFT_HUE, _SOFT_SHARE))
        for group in optimiser.param_groups:
            group["lr"] = _RATE * (1.0 - 0.9 * done)
        apart = torch.remainder(hue - unknown[0] + np.pi, 2 * np.pi) - np.pi
        inside = torch.sigmoid((unknown[1] - apart.abs()) / soft_hue)
        for channel, low, high in ((saturation, 2, 3), (value, 4, 5)):
            inside = inside * torch.sigmoid((channel - unknown[low]) / soft)
            inside = inside * torch.sigmoid((unknown[high] - channel) / soft)
        loss = 1.0 - 2.0 * (inside * target).sum() / (inside.sum() + target.sum())
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    return _range(unknown.detach().numpy())


def _range(unknown: Float[np.ndarray, "6"]) -> HsvRange:
    """In whole OpenCV units; an end that ran beyond its channel stands at the channel's end."""
    half = float(np.clip(unknown[1], 0.0, np.pi))
    low_hue, high_hue = (round((unknown[0] + sign * half) * 90.0 / np.pi) % 180 for sign in (-1, 1))
    if half > np.pi * 0.995:
        low_hue, high_hue = 0, 179
    s0, s1, v0, v1 = (int(np.clip(round(255 * end), 0, 255)) for end in unknown[2:])
    return HsvRange((low_hue, min(s0, s1), min(v0, v1)), (high_hue, max(s0, s1), max(v0, v1)))


def _from_labels(bgr: UInt8[np.ndarray, "n 3"]) -> HsvRange:
    """The labelled pixels' own colours without their tails; hue round its circular mean."""
    hsv = cv2.cvtColor(bgr[:, None], cv2.COLOR_BGR2HSV)[:, 0].astype(np.float64)
    angle = hsv[:, 0] * np.pi / 90.0
    mean = np.arctan2(np.sin(angle).mean(), np.cos(angle).mean())
    off = np.quantile((angle - mean + np.pi) % (2 * np.pi) - np.pi, _TAILS)
    hue = [round((mean + end) * 90.0 / np.pi) % 180 for end in off]
    (s0, s1), (v0, v1) = (np.quantile(hsv[:, k], _TAILS).round().astype(int).tolist() for k in (1, 2))
    return HsvRange((hue[0], s0, v0), (hue[1], s1, v1))


def _sample(frames: Sequence[LabelledFrame]) -> tuple[UInt8[np.ndarray, "n 3"], Bool[np.ndarray, "n"]]:
    total = sum(frame.label.size for frame in frames)
    stride = max(1, -(-total // _MOST_PIXELS))
    pixels = np.concatenate([frame.bgr.reshape(-1, 3)[::stride] for frame in frames])
    return pixels, np.concatenate([frame.label.ravel()[::stride] for frame in frames])


def _iou(frames: Sequence[LabelledFrame], hsv: HsvRange) -> float:
    both = either = 0
    for frame in frames:
        mask = hsv_mask(frame.bgr, hsv) > 0
        both += int(np.count_nonzero(mask & frame.label))
        either += int(np.count_nonzero(mask | frame.label))
    return both / either if either else 1.0


def _polygons(path: Path) -> dict[str, list[Float[np.ndarray, "k 2"]]]:
    if not path.exists() or not path.stat().st_size:
        return {}
    found: dict[str, list[Float[np.ndarray, "k 2"]]] = {}
    for line, text in enumerate(read_lines(path, DetectError), start=1):
        cells = [cell.strip().strip('"') for cell in text.split(",") if cell.strip()]
        if not cells or cells[0].startswith("#") or cells[0] == "image":
            continue
        try:
            corners = np.array(cells[1:], dtype=np.float64)
        except ValueError:
            shown = str(cells[1:])[:80]
            raise DetectError(f"{path}:{line}: {shown} are not numbers; expected x0, y0, x1, y1, ..") from None
        if len(corners) < 6 or len(corners) % 2 or not (np.abs(corners) <= LARGEST_PIXEL).all():
            raise DetectError(
                f"{path}:{line}: {len(corners)} numbers; expected x, y of three corners or more, at most "
                f"{LARGEST_PIXEL:g} pixels."
            )
        found.setdefault(cells[0], []).append(corners.reshape(-1, 2))
    return found


def _read(path: Path, flags: int = cv2.IMREAD_COLOR) -> UInt8[np.ndarray, "h w ..."]:
    image = cv2.imread(str(path), flags)
    if image is None:
        raise DetectError(f"{path}: not an image that OpenCV can read.")
    return np.asarray(image, dtype=np.uint8)


def _vision() -> tuple[Any, Any]:
    try:
        import kornia
        import torch
    except ImportError:
        raise DetectError(
            "tuning needs torch and kornia, which are not installed: pip install 'jaxgeo[vision]'."
        ) from None
    return torch, kornia
