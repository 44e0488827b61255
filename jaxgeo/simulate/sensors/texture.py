"""Colours of surfaces as functions of the place in the world: the same wall looks the same from wherever it is seen.

Each material has one square tile that repeats, a coarser shade of another period lies over all of them, and both are
looked up at the level of detail that a pixel can show (mip maps: Williams, "Pyramidal parametrics", 1983).
"""

import dataclasses
import functools

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int, UInt8
from scipy import fft

GRASS, PAVING, BRICK, PLASTER, CONCRETE, GLASS, ROOF, BARK, LEAF, METAL, WOOD, SIGN, BOARD = range(13)
# B, G, R, 0 to 255. Grass and leaves are duller and yellower than a marker's reflector.
_COLOUR_BGR = np.array(
    [
        [58, 98, 98],
        [148, 156, 160],
        [72, 88, 142],
        [168, 186, 196],
        [150, 156, 158],
        [92, 80, 66],
        [84, 86, 96],
        [52, 68, 88],
        [46, 92, 92],
        [120, 118, 116],
        [70, 106, 150],
        [200, 204, 210],
        [80, 90, 90],
    ],
    dtype=np.float32,
)
# Share of a LiDAR's light that comes back, face on.
REFLECTIVITY = np.array([0.45, 0.3, 0.35, 0.6, 0.4, 0.08, 0.25, 0.25, 0.5, 0.5, 0.4, 0.7, 0.4])
TEXELS, TEXEL_M = 1024, 0.01
SHADE_TEXEL_M = 0.0371
# Where the shade at this multiple of its scale is above the threshold, the ground is paved and not grown over.
PATCH_SCALE, PATCH_LEVEL = 3.5, 0.1
_LEVELS = 9


@dataclasses.dataclass(frozen=True)
class Textures:
    """Pyramids of all tiles, levels one after another; a level of `layers` squares is row-major."""

    colour: UInt8[np.ndarray, "n 3"]
    shade: Float32[np.ndarray, "m 1"]


@functools.lru_cache(maxsize=2)
def textures_of(seed: int) -> Textures:
    """The tiles of a world."""
    rng = np.random.default_rng(np.random.SeedSequence([seed], spawn_key=(100,)))
    tiles = np.stack([_tile(rng, material) for material in range(len(_COLOUR_BGR))])
    shade = _noise(rng, -1.6)[None, ..., None]
    return Textures(
        np.concatenate([np.clip(level, 0, 255).astype(np.uint8).reshape(-1, 3) for level in _pyramid(tiles)]),
        np.concatenate([level.reshape(-1, 1) for level in _pyramid(shade)]),
    )


def albedo_bgr(
    textures: Textures,
    point_m: Float[np.ndarray, "n 3"],
    normal: Float[np.ndarray, "n 3"],
    material: UInt8[np.ndarray, "n"],
    footprint_m: Float[np.ndarray, "n"],
) -> Float32[np.ndarray, "n 3"]:
    """Colour of surface points, 0 to 255; `footprint_m` is the width of what a pixel sees."""
    at_m = surface_coordinates_m(point_m, normal)
    patch = _looked_up(textures.shade, 1, np.zeros(len(at_m), int), at_m / (PATCH_SCALE * SHADE_TEXEL_M), footprint_m)
    layer = np.where((material == GRASS) & (patch[:, 0] > PATCH_LEVEL), PAVING, material).astype(int)
    colour = _looked_up(textures.colour, len(_COLOUR_BGR), layer, at_m / TEXEL_M, footprint_m / TEXEL_M)
    shade = _looked_up(
        textures.shade, 1, np.zeros(len(at_m), int), at_m / SHADE_TEXEL_M + 137.0, footprint_m / SHADE_TEXEL_M
    )
    return colour * np.clip(1.0 + 0.13 * shade, 0.5, 1.5)


def surface_coordinates_m(
    point_m: Float[np.ndarray, "n 3"], normal: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 2"]:
    """Two coordinates on a surface: along and up a wall; east and north where it is more level than upright."""
    level = np.abs(normal[:, 2]) > 0.7
    across = np.maximum(np.hypot(normal[:, 0], normal[:, 1]), 1e-9)
    along_m = (point_m[:, 1] * normal[:, 0] - point_m[:, 0] * normal[:, 1]) / across
    return np.stack([np.where(level, point_m[:, 0], along_m), np.where(level, point_m[:, 1], point_m[:, 2])], axis=-1)


def _looked_up(
    pyramid: np.ndarray,
    layers: int,
    layer: Int[np.ndarray, "n"],
    at_texels: Float[np.ndarray, "n 2"],
    footprint_texels: Float[np.ndarray, "n"],
) -> Float32[np.ndarray, "n c"]:
    """Bilinear, at the level whose texels are as wide as the footprint."""
    level = np.clip(np.log2(np.maximum(footprint_texels, 1.0)) + 0.3, 0, _LEVELS - 1).astype(int)
    first = layers * np.concatenate([[0], np.cumsum([(TEXELS >> i) ** 2 for i in range(_LEVELS - 1)])])
    size = TEXELS >> level
    start = first[level] + layer * size * size
    at = at_texels / (1 << level)[:, None] - 0.5
    low = np.floor(at)
    part = (at - low).astype(np.float32)
    i, j = low[:, 0].astype(int), low[:, 1].astype(int)
    mask = size - 1
    i0, i1 = i & mask, (i + 1) & mask
    j0, j1 = start + (j & mask) * size, start + ((j + 1) & mask) * size
    s, t = part[:, :1], part[:, 1:]
    lower = pyramid[j0 + i0] * (1 - s) + pyramid[j0 + i1] * s
    upper = pyramid[j1 + i0] * (1 - s) + pyramid[j1 + i1] * s
    return lower * (1 - t) + upper * t


def _pyramid(tiles: Float32[np.ndarray, "l t t c"]) -> list[np.ndarray]:
    levels = [tiles]
    for _ in range(_LEVELS - 1):
        last = levels[-1]
        levels.append(last.reshape(len(last), last.shape[1] // 2, 2, last.shape[2] // 2, 2, -1).mean(axis=(2, 4)))
    return levels


def _noise(rng: np.random.Generator, slope: float) -> Float32[np.ndarray, "t t"]:
    """Noise that repeats, of unit variance; its power falls with frequency f as f^slope in amplitude."""
    spectrum = fft.rfft2(rng.standard_normal((TEXELS, TEXELS), dtype=np.float32)) * _spectrum(slope)
    field = np.asarray(fft.irfft2(spectrum, s=(TEXELS, TEXELS)))
    return field / field.std()


@functools.cache
def _spectrum(slope: float) -> Float32[np.ndarray, "t f"]:
    f = np.hypot(fft.fftfreq(TEXELS)[:, None], fft.rfftfreq(TEXELS)[None])
    f[0, 0] = np.inf
    return (f**slope).astype(np.float32)


def _tile(rng: np.random.Generator, material: int) -> Float32[np.ndarray, "t t 3"]:
    """One material's tile."""
    relief = 1.0 + 0.1 * _noise(rng, -0.7) + 0.06 * _noise(rng, -1.3)
    if material == BRICK:
        relief *= _bricks(rng, 8, 32, half_offset=True)
    elif material == PAVING:
        relief *= _bricks(rng, 64, 64, half_offset=True)
    elif material == CONCRETE:
        relief *= 0.6 + 0.4 * _bricks(rng, 128, 256, half_offset=False)
    elif material == WOOD:
        relief *= _bricks(rng, 1024, 16, half_offset=False).T
    elif material == SIGN:
        relief *= _letters(rng)
    elif material in (GRASS, LEAF, BARK):
        relief += 0.16 * _noise(rng, -0.3) + 0.08 * _noise(rng, -1.0)
    elif material == GLASS:
        relief = 1.0 + 0.25 * _noise(rng, -2.0)
    return np.maximum(relief, 0.05)[..., None] * _COLOUR_BGR[material] * _hue(rng, material)


def _hue(rng: np.random.Generator, material: int) -> Float32[np.ndarray, "t t 3"]:
    """Slow changes of colour between the channels."""
    strength = 0.05 if material in (GRASS, LEAF, BRICK) else 0.02
    blue, red = (strength * _noise(rng, -1.5) for _ in range(2))
    return np.stack([1 + blue, np.ones_like(blue), 1 + red], axis=-1)


def _bricks(rng: np.random.Generator, height: int, width: int, *, half_offset: bool) -> Float32[np.ndarray, "t t"]:
    """Courses of stones `height` by `width` texels, each of its own brightness, with darker joints."""
    j, i = np.mgrid[:TEXELS, :TEXELS]
    row = j // height
    shifted = (i + (row % 2) * (width // 2 if half_offset else 0)) % TEXELS
    own = rng.normal(1.0, 0.13, (TEXELS // height, TEXELS // width)).astype(np.float32)
    joint = (j % height == 0) | (shifted % width == 0)
    return np.where(joint, 0.7, np.clip(own[row, shifted // width], 0.6, 1.4)).astype(np.float32)


def _letters(rng: np.random.Generator) -> Float32[np.ndarray, "t t"]:
    """Dark marks of many sizes on a light ground."""
    canvas = np.ones((TEXELS, TEXELS), np.float32)
    for size, count in ((40, 120), (14, 700), (5, 2500)):
        for x, y, angle, dark in rng.uniform([0, 0, 0, 0.15], [TEXELS, TEXELS, 180, 0.7], (count, 4)):
            axes = (max(int(size * 0.9), 1), max(int(size * 0.3), 1))
            cv2.ellipse(canvas, (int(x), int(y)), axes, angle, 0, 360, float(dark), -1)
    return canvas
