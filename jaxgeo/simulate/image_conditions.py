"""What a simulated camera does to a scene: blur, light, occlusion, noise."""

import dataclasses
import functools

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8


@dataclasses.dataclass(frozen=True)
class ImageConditions:
    """How one simulated image is taken; the default is a perfect one.

    Attributes:
        defocus_px: standard deviation of the Gaussian blur.
        motion_px, motion_angle_rad: length and direction of the motion blur.
        gain: of all light; cast: of B, G, R.
        gradient: relative change of the light across the image, left to right; vignetting: its loss in the corners.
        read_noise, shot_noise: standard deviation in levels: constant, and at full brightness (grows with its root).
        occlusion: share of each marker's outline behind a leaf.
    """

    defocus_px: float = 0.0
    motion_px: float = 0.0
    motion_angle_rad: float = 0.0
    gain: float = 1.0
    cast: tuple[float, float, float] = (1.0, 1.0, 1.0)
    gradient: float = 0.0
    vignetting: float = 0.0
    read_noise: float = 0.0
    shot_noise: float = 0.0
    occlusion: float = 0.0


def sample_conditions(rng: np.random.Generator, *, most_occlusion: float = 0.0) -> ImageConditions:
    """A handheld camera in daylight under trees: some blur, uneven light, noise."""
    return ImageConditions(
        defocus_px=rng.uniform(0.4, 1.0),
        motion_px=rng.uniform(0.0, 3.0),
        motion_angle_rad=rng.uniform(0.0, np.pi),
        gain=rng.uniform(0.7, 1.25),
        cast=tuple(rng.uniform(0.95, 1.05, 3)),
        gradient=rng.uniform(-0.3, 0.3),
        vignetting=rng.uniform(0.0, 0.25),
        read_noise=rng.uniform(1.0, 4.0),
        shot_noise=rng.uniform(1.0, 5.0),
        occlusion=rng.uniform(0.0, most_occlusion),
    )


def developed(
    rng: np.random.Generator,
    scene: Float32[np.ndarray, "h w 3"],
    corners_px: Float[np.ndarray, "m 4 2"],
    conditions: ImageConditions,
) -> UInt8[np.ndarray, "h w 3"]:
    """The image of a scene under these conditions; the scene itself may be overwritten."""
    for quad in corners_px if conditions.occlusion > 0.0 else ():
        _cover(rng, scene, quad, conditions.occlusion)
    if conditions.defocus_px > 0.0:
        scene = cv2.GaussianBlur(scene, (0, 0), conditions.defocus_px, borderType=cv2.BORDER_REPLICATE)
    if conditions.motion_px > 0.0:
        kernel = motion_kernel(conditions.motion_px, conditions.motion_angle_rad)
        scene = cv2.filter2D(scene, -1, kernel, borderType=cv2.BORDER_REPLICATE)
    scene = scene * _light(scene.shape[:2], conditions)[..., None] * np.array(conditions.cast, np.float32)
    if conditions.read_noise > 0.0 or conditions.shot_noise > 0.0:
        strength = cv2.sqrt(conditions.read_noise**2 + np.maximum(scene, 0.0) * (conditions.shot_noise**2 / 255.0))
        scene = scene + strength * _noise(rng, scene.shape[:2])
    return np.clip(np.rint(scene), 0, 255).astype(np.uint8)


def motion_kernel(length_px: float, angle_rad: float) -> Float32[np.ndarray, "k k"]:
    """A line through the kernel's middle, symmetric about it: it blurs and shifts nothing."""
    half = int(np.ceil(length_px / 2)) + 1
    kernel = np.zeros((2 * half + 1, 2 * half + 1))
    for along in np.linspace(-length_px / 2, length_px / 2, 16 * half + 1):
        x, y = half + along * np.cos(angle_rad), half + along * np.sin(angle_rad)
        i, j = int(x), int(y)
        for dj, wj in ((0, 1 - (y - j)), (1, y - j)):
            for di, wi in ((0, 1 - (x - i)), (1, x - i)):
                if wi * wj > 0.0:
                    kernel[j + dj, i + di] += wi * wj
    return (kernel / kernel.sum()).astype(np.float32)


def _light(shape: tuple[int, int], conditions: ImageConditions) -> Float32[np.ndarray, "h w"]:
    height, width = shape
    x = np.linspace(-1.0, 1.0, width, dtype=np.float32)[None]
    y = np.linspace(-1.0, 1.0, height, dtype=np.float32)[:, None]
    return conditions.gain * (1.0 + 0.5 * conditions.gradient * x) * (1.0 - conditions.vignetting * (x**2 + y**2) / 2)


# Normal numbers are slow to draw: one tile of them, a prime number of pixels wide, read from a random place.
_TILE = 1021


@functools.cache
def _tile() -> Float32[np.ndarray, "t t 3"]:
    return np.random.default_rng(20_000).standard_normal((_TILE, _TILE, 3), dtype=np.float32)


def _noise(rng: np.random.Generator, shape: tuple[int, int]) -> Float32[np.ndarray, "h w 3"]:
    """Unit white noise; repeats after 1021 pixels, so never within a marker."""
    rows = (rng.integers(_TILE) + np.arange(shape[0])) % _TILE
    columns = (rng.integers(_TILE) + np.arange(shape[1])) % _TILE
    return _tile()[rows][:, columns]


_LEAF_BGR = np.array([48.0, 84.0, 66.0], np.float32)


def _cover(
    rng: np.random.Generator, scene: Float32[np.ndarray, "h w 3"], quad_px: Float[np.ndarray, "4 2"], share: float
) -> None:
    """A dull leaf over one corner: an ellipse about it, sized to hide this share of the outline."""
    corner = quad_px[rng.integers(4)]
    area = abs(cv2.contourArea(quad_px.astype(np.float32)))
    # About a quarter of an ellipse round a corner lies inside.
    radius = np.sqrt(4.0 * share * area / np.pi)
    axes = (max(int(radius * 1.2), 1), max(int(radius / 1.2), 1))
    cover = np.zeros(scene.shape[:2], np.uint8)
    cv2.ellipse(cover, np.rint(corner).astype(int).tolist(), axes, rng.uniform(0, 180), 0, 360, 255, -1, cv2.LINE_AA)
    scene += (cover.astype(np.float32) / 255.0)[..., None] * (_LEAF_BGR - scene)
