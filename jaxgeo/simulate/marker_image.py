"""Simulated images of markers, with their true corners and poses.

Formed as a camera does: the scene is averaged over each pixel through the exact lens model, then blurred by defocus and
motion, lit, and read out with noise. Pixel centres are at whole numbers.
"""

import dataclasses
from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8
from scipy.spatial.transform import Rotation

from jaxgeo.associate.camera_model import project, undistort
from jaxgeo.associate.planar import UNIT_CORNERS
from jaxgeo.data import Camera
from jaxgeo.errors import DetectError
from jaxgeo.simulate.image_conditions import ImageConditions, developed
from jaxgeo.simulate.marker_pattern import black_cells, texture

CSR_BGR = (62.0, 158.0, 52.0)
PAPER_BGR, INK_BGR = (226.0, 230.0, 232.0), (34.0, 32.0, 32.0)
# Dull green with darker lines: what a real iMarker's ground and reflector look like without its polariser.
GROUND_BGR, LINE_BGR = (52.0, 120.0, 40.0), (44.0, 66.0, 40.0)
LOOKS = ("csr", "printed", "ground")
_SAMPLES = 6  # along each axis of a pixel
_NODES_PX = 4.0  # the lens is inverted on a grid this fine, and interpolated
_ROOM_PX = 4


@dataclasses.dataclass(frozen=True)
class PlacedMarker:
    """A marker in front of a camera.

    Attributes:
        family, marker: what is printed.
        size_m: side of the black border.
        t_cam_marker_m, quat_cam_marker_wxyz: pose; marker frame x right, y up, z out of the print.
        look: `csr`: black cells are green reflector on whatever lies behind; `printed`: black on white paper;
            `ground`: dark lines on a green board.
    """

    family: str
    marker: int
    size_m: float
    t_cam_marker_m: Float[np.ndarray, "3"]
    quat_cam_marker_wxyz: Float[np.ndarray, "4"]
    look: str = "csr"


@dataclasses.dataclass(frozen=True)
class MarkerImage:
    """A simulated image and the truth about it: corners_px (m, 4, 2) in the order of `CornerSightings`, distorted."""

    bgr: UInt8[np.ndarray, "h w 3"]
    markers: tuple[PlacedMarker, ...]
    corners_px: Float[np.ndarray, "m 4 2"]


def render_marker_image(
    rng: np.random.Generator,
    camera: Camera,
    background: Float32[np.ndarray, "h w 3"],
    markers: Sequence[PlacedMarker],
    conditions: ImageConditions,
) -> MarkerImage:
    """One simulated image.

    Args:
        background: B, G, R, 0 to 255, as large as the image (`camouflage`).

    Raises:
        DetectError: a marker that is not wholly in front of the camera and within its lens model, or shows its back.
    """
    scene = background.astype(np.float32, copy=True)
    corners = np.zeros((len(markers), 4, 2))
    for row, marker in enumerate(markers):
        corners[row] = marker_corners_px(camera, marker)
    for row in sorted(range(len(markers)), key=lambda i: -markers[i].t_cam_marker_m[2]):  # the nearest last
        _paint(scene, camera, markers[row], corners[row])
    return MarkerImage(developed(rng, scene, corners, conditions), tuple(markers), corners)


def marker_corners_px(camera: Camera, marker: PlacedMarker) -> Float[np.ndarray, "4 2"]:
    """True corners in the image."""
    R = Rotation.from_quat(marker.quat_cam_marker_wxyz, scalar_first=True).as_matrix()
    points = (marker.size_m * np.column_stack([UNIT_CORNERS, np.zeros(4)])) @ R.T + marker.t_cam_marker_m
    pixels, _, ok = project(points, camera)
    if not np.all(ok):
        raise DetectError(
            f"marker {marker.marker} is not wholly in front of the camera and within the range of its lens model."
        )
    if R[:, 2] @ marker.t_cam_marker_m >= 0.0:
        raise DetectError(f"marker {marker.marker} shows its back; expected its z axis towards the camera.")
    return pixels


def sample_marker(
    rng: np.random.Generator,
    camera: Camera,
    family: str,
    marker: int,
    side_px: float,
    *,
    size_m: float = 0.15,
    most_tilt_rad: float = np.pi / 3,
    look: str = "csr",
) -> PlacedMarker:
    """A marker anywhere in the image, any roll, tilted up to `most_tilt_rad` against the line of sight.

    `side_px` is the side it would show face on at its distance.
    """
    assert camera.resolution_px is not None
    width, height = camera.resolution_px
    room = 0.75 * side_px + 3.0
    pixel = np.array([rng.uniform(room, width - room), rng.uniform(room, height - room)])
    ray = np.append(undistort(pixel[None], camera)[0][0], 1.0)
    depth = float(np.mean(camera.intrinsics_px[:2])) * size_m / side_px
    axis_angle = rng.uniform(0.0, 2.0 * np.pi)
    tilt = Rotation.from_rotvec(
        rng.uniform(0.0, most_tilt_rad) * np.array([np.cos(axis_angle), np.sin(axis_angle), 0.0])
    )
    roll = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi))
    facing = Rotation.from_matrix(np.diag([1.0, -1.0, -1.0]))
    # Tilted against the ray, not against the optical axis.
    towards = Rotation.align_vectors((ray / np.linalg.norm(ray))[None], np.array([[0.0, 0.0, 1.0]]))[0]
    rotation = towards * tilt * roll * facing
    return PlacedMarker(family, marker, size_m, depth * ray, rotation.as_quat(scalar_first=True), look)


def _paint(
    scene: Float32[np.ndarray, "h w 3"], camera: Camera, marker: PlacedMarker, corners_px: Float[np.ndarray, "4 2"]
) -> None:
    """Blend a marker into the scene: each pixel takes the share of the marker that covers it."""
    black = black_cells(marker.family, marker.marker)
    cells = len(black)
    quiet = 0 if marker.look == "csr" else 1
    grow = 1.0 + 2.0 * quiet / cells
    middle = corners_px.mean(axis=0)
    reach = (corners_px - middle) * grow * 1.1
    low = np.maximum(np.floor(middle + reach.min(axis=0)).astype(int) - _ROOM_PX, 0)
    high = np.minimum(np.ceil(middle + reach.max(axis=0)).astype(int) + _ROOM_PX + 1, scene.shape[1::-1])
    if np.any(high <= low):
        return  # wholly beside the image
    at_cells = _cell_coordinates(camera, marker, low, high, cells)
    side_px = np.linalg.norm(np.roll(corners_px, -1, axis=0) - corners_px, axis=1).max()
    texels = int(np.clip(np.ceil(_SAMPLES * side_px / cells), 4, 64))
    # A cell outside on every side, so that the border's edge is sampled like any other.
    ink = texture(black, texels, quiet + 1)
    ink_share = _average(ink, (at_cells + quiet + 1) * texels - 0.5)
    part = scene[low[1] : high[1], low[0] : high[0]]
    if marker.look != "csr":
        board = texture(np.ones((cells + 2, cells + 2), dtype=bool), texels, 1)
        board_share = _average(board, (at_cells + 2) * texels - 0.5)
        ground = PAPER_BGR if marker.look == "printed" else GROUND_BGR
        part += board_share[..., None] * (np.array(ground, np.float32) - part)
    ink_bgr = {"csr": CSR_BGR, "printed": INK_BGR, "ground": LINE_BGR}[marker.look]
    part += ink_share[..., None] * (np.array(ink_bgr, np.float32) - part)


def _cell_coordinates(
    camera: Camera, marker: PlacedMarker, low: np.ndarray, high: np.ndarray, cells: int
) -> Float[np.ndarray, "a b 2"]:
    """Where each sample of the box lies on the print, in cells from its upper left; the lens inverted on a grid."""
    count = (high - low) * _SAMPLES
    nodes = np.maximum(np.ceil((high - low) / _NODES_PX).astype(int) + 1, 2)
    x = np.linspace(low[0] - 0.5, high[0] - 0.5, nodes[0])
    y = np.linspace(low[1] - 0.5, high[1] - 0.5, nodes[1])
    grid = np.stack(np.meshgrid(x, y), axis=-1)
    rays, _ = undistort(grid.reshape(-1, 2), camera)
    rays = rays.reshape(*grid.shape).astype(np.float64)
    # Node (i, j) of the coarse grid under sample (a, b): sample centres are (a + 1/2) / samples pixels from the edge.
    a = (np.arange(count[0]) + 0.5) / count[0] * (nodes[0] - 1)
    b = (np.arange(count[1]) + 0.5) / count[1] * (nodes[1] - 1)
    u = _interpolated(rays[..., 0], a, b)
    v = _interpolated(rays[..., 1], a, b)
    R = Rotation.from_quat(marker.quat_cam_marker_wxyz, scalar_first=True).as_matrix()
    to_ray = np.column_stack([R[:, :2], marker.t_cam_marker_m])  # ray ~ R1 X + R2 Y + t
    X, Y, W = np.tensordot(np.linalg.inv(to_ray), np.stack([u, v, np.ones_like(u)]), axes=1)
    X, Y = X / W, Y / W
    return np.stack([X / marker.size_m + 0.5, 0.5 - Y / marker.size_m], axis=-1) * cells


def _interpolated(values: Float[np.ndarray, "r c"], columns: np.ndarray, rows: np.ndarray) -> Float[np.ndarray, "b a"]:
    """Bilinear, in float64 (OpenCV's maps would round rays to 1e-7 of a large range)."""
    i = np.minimum(columns.astype(int), values.shape[1] - 2)
    j = np.minimum(rows.astype(int), values.shape[0] - 2)
    s, t = (columns - i)[None, :], (rows - j)[:, None]
    upper = values[j][:, i] * (1 - s) + values[j][:, i + 1] * s
    lower = values[j + 1][:, i] * (1 - s) + values[j + 1][:, i + 1] * s
    return upper * (1 - t) + lower * t


def _average(ink: Float32[np.ndarray, "t t"], at: Float[np.ndarray, "a b 2"]) -> Float32[np.ndarray, "h w"]:
    points = at.astype(np.float32)
    sampled = cv2.remap(
        ink, points[..., 0], points[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0.0
    )
    h, w = sampled.shape[0] // _SAMPLES, sampled.shape[1] // _SAMPLES
    return sampled.reshape(h, _SAMPLES, w, _SAMPLES).mean(axis=(1, 3))
