"""The masks of `mask` for many frames at once, on the CPU or a GPU: for recorded video (extra `vision`).

Frames are torch tensors, red first, as a video decoder leaves them on a GPU;
`mask` works on OpenCV's blue-first arrays. Both give the same masks, byte for byte: a range chosen on one picture
holds for the batch.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from jaxtyping import UInt8

from jaxgeo.detect.mask import HsvRange, MaskSettings
from jaxgeo.errors import DetectError

if TYPE_CHECKING:
    import torch

# OpenCV's fixed point: the reciprocals 255 / V and 30 / (max - min) are rounded to 2^-12 before they multiply.
_BITS = 12
_HUES = 180


def hsv_masks(rgb: UInt8[torch.Tensor, "b 3 h w"], hsv: HsvRange) -> UInt8[torch.Tensor, "b h w"]:
    """255 inside the range, 0 outside, on the frames' own device: `mask.hsv_mask` of every frame.

    Args:
        rgb: frames of bytes, channels red, green, blue.
        hsv: the reflector's colours.

    Raises:
        DetectError: another shape or type; kornia or torch are not installed.
    """
    import torch

    hue, saturation, value = hsv_bytes(rgb).unbind(dim=1)
    (h0, s0, v0), (h1, s1, v1) = hsv.low, hsv.high
    in_hue = (hue >= h0) & (hue <= h1) if h0 <= h1 else (hue >= h0) | (hue <= h1)
    inside = in_hue & (saturation >= s0) & (saturation <= s1) & (value >= v0) & (value <= v1)
    return inside.to(torch.uint8) * 255


def hsv_bytes(rgb: UInt8[torch.Tensor, "b 3 h w"]) -> UInt8[torch.Tensor, "b 3 h w"]:
    """H 0 .. 179, S and V 0 .. 255 as OpenCV's `COLOR_RGB2HSV` gives them.

    kornia's hue, in radians, times 6 / 2 pi and the spread max - min is a whole number n: the difference of two
    channels plus the sextant's multiple of the spread. It is rounded back to it, and from there on the arithmetic is
    OpenCV's (modules/imgproc/src/color_hsv.simd.hpp, RGB2HSV_b):

        S = (spread * round(255 * 2^12 / V) + 2^11) >> 12,  H = (n * round(30 * 2^12 / spread) + 2^11) >> 12.

    Raises:
        DetectError: another shape or type; kornia or torch are not installed.
    """
    torch, kornia = _libraries()
    if not isinstance(rgb, torch.Tensor) or rgb.dtype != torch.uint8 or rgb.ndim != 4 or rgb.shape[1] != 3:
        raise DetectError(
            f"frames of {_kind(rgb)}; expected a torch tensor of bytes (frames, 3, height, width), channels R, G, B."
        )
    most = rgb.amax(dim=1)
    spread = most - rgb.amin(dim=1)
    hue_rad = kornia.color.rgb_to_hsv(rgb.to(torch.float32) / 255.0)[:, 0]
    n = torch.round(hue_rad * (3.0 / torch.pi) * spread).to(torch.int32)
    # Reds that lean to blue: OpenCV counts them from zero downwards, rounds, and only then goes round.
    n = torch.where(n >= 5 * spread.to(torch.int32), n - 6 * spread.to(torch.int32), n)
    half = 1 << (_BITS - 1)
    hue = (n * _reciprocals(_HUES / 6, rgb.device)[spread.long()] + half) >> _BITS
    hue = torch.where(hue < 0, hue + _HUES, hue)
    saturation = (spread * _reciprocals(255, rgb.device)[most.long()] + half) >> _BITS
    return torch.stack([hue.to(torch.uint8), saturation.to(torch.uint8), most], dim=1)


def clean_masks(masks: UInt8[torch.Tensor, "b h w"], settings: MaskSettings) -> UInt8[torch.Tensor, "b h w"]:
    """Opened, then closed, as the settings say: `mask.clean` of every mask, borders and even sizes as OpenCV has them.

    Raises:
        DetectError: another shape or type; torch is not installed.
    """
    torch, _ = _libraries()
    if not isinstance(masks, torch.Tensor) or masks.dtype != torch.uint8 or masks.ndim != 3:
        raise DetectError(f"masks of {_kind(masks)}; expected a torch tensor of bytes (frames, height, width).")
    for size, signs in ((settings.open_px, (-1.0, 1.0)), (settings.close_px, (1.0, -1.0))):
        if size < 2:
            continue
        # kornia's morphology mirrors squares of even side; OpenCV's window is the same for both operations.
        before, after = size // 2, size - 1 - size // 2
        image = masks[:, None].to(torch.float32)
        for sign in signs:  # dilation is a maximum, erosion that of the negative
            padded = torch.nn.functional.pad(sign * image, (before, after, before, after), value=-torch.inf)
            image = sign * torch.nn.functional.max_pool2d(padded, size, stride=1)
        masks = image[:, 0].to(torch.uint8)
    return masks


def _reciprocals(scale: float, device: Any) -> Any:
    """round(scale 2^12 / i) for i from 0 to 255; 0 for 0. Ties, at V = 2^k, are whole numbers: no rounding rule."""
    import torch

    divisor = torch.arange(256, dtype=torch.float64, device=device)
    table = torch.round(scale * (1 << _BITS) / divisor.clamp(min=1.0)).to(torch.int32)
    table[0] = 0
    return table


def _libraries() -> tuple[Any, Any]:
    try:
        import kornia
        import torch
    except ImportError:
        raise DetectError(
            "masks of many frames at once need torch and kornia, which are not both installed: "
            "pip install 'jaxgeo[vision]'."
        ) from None
    return torch, kornia


def _kind(value: object) -> str:
    shape, dtype = getattr(value, "shape", None), getattr(value, "dtype", None)
    return type(value).__name__ if shape is None else f"shape {tuple(shape)} and type {dtype}"
