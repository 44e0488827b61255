"""An RGB-D camera: colour through a real lens model, depth as stereo measures it."""

import dataclasses
from collections.abc import Callable

import cv2
import numpy as np
from jaxtyping import Float, Float32
from scipy.spatial.transform import RigidTransform, Rotation

from jaxgeo.associate.camera_model import project, undistort
from jaxgeo.associate.planar import UNIT_CORNERS
from jaxgeo.data import Camera, RgbdFrame
from jaxgeo.errors import InputError
from jaxgeo.simulate.image_conditions import ImageConditions
from jaxgeo.simulate.marker_image import PlacedMarker, render_marker_image
from jaxgeo.simulate.sensors.board import MarkerVisit, board_bgr
from jaxgeo.simulate.sensors.ray_casting import Hits
from jaxgeo.simulate.sensors.shadows import light
from jaxgeo.simulate.sensors.texture import BOARD, albedo_bgr
from jaxgeo.simulate.sensors.world import World

_SKY_BGR = np.array([[226.0, 214.0, 200.0], [214.0, 180.0, 146.0]], np.float32)  # at the horizon, above
_EDGE_PX = 1.5  # of disparity between neighbours: stereo finds no match there


@dataclasses.dataclass(frozen=True)
class RgbdCamera:
    """What the sensor is like.

    Attributes:
        resolution_px, focal_px, distortion: of colour and depth, which share their pixels (`sensor_rig`).
        rate_hz, visit_rate_hz: frames a second on the way, and while a marker is shown.
        min_range_m, max_range_m: of depth along the optical axis.
        disparity_px_m: focal length times base line; depth is one over disparity.
        disparity_sigma_px, disparity_step_px: noise and resolution of disparity: both grow with the square of depth.
        exposure_s: for motion blur.
        read_noise, shot_noise: see `ImageConditions`.

    Raises:
        InputError: a number is out of range.
    """

    resolution_px: tuple[int, int] = (640, 480)
    focal_px: float = 460.0
    distortion: tuple[float, ...] = ()
    rate_hz: float = 2.0
    visit_rate_hz: float = 3.0
    min_range_m: float = 0.3
    max_range_m: float = 9.0
    disparity_px_m: float = 44.0
    disparity_sigma_px: float = 0.05
    disparity_step_px: float = 1 / 16
    exposure_s: float = 0.004
    read_noise: float = 1.5
    shot_noise: float = 2.5

    def __post_init__(self) -> None:
        if not (0 < self.rate_hz <= 60 and 0 < self.visit_rate_hz <= 60):
            raise InputError(f"RGB-D camera: {self.rate_hz:g} and {self.visit_rate_hz:g} Hz; expected 0 to 60 Hz.")
        if not 0 < self.min_range_m < self.max_range_m <= 65.0:
            raise InputError(
                f"RGB-D camera: depths {self.min_range_m:g} to {self.max_range_m:g} m; expected two above 0 m, the "
                "second the larger and at most 65 m (16 bits of millimetres)."
            )


@dataclasses.dataclass(frozen=True)
class Marker:
    """What is printed on the board: black cells are green reflector on the board's camouflage."""

    family: str = "apriltag_36h11"
    id: int = 7
    size_m: float = 0.5


def render_frame(
    rng: np.random.Generator,
    sensor: RgbdCamera,
    camera: Camera,
    marker: Marker,
    world: World,
    visit: MarkerVisit | None,
    T_local_cam: Callable[[Float[np.ndarray, "c"]], RigidTransform],
    stamp_s: float,
    index: int,
) -> RgbdFrame:
    """One frame.

    Args:
        visit: during which the board stands there.
        T_local_cam: the optical axes' poses at times after the stamp, seconds.
    """
    pose = T_local_cam(np.array([0.0]))[0]
    width, height = sensor.resolution_px
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2).astype(np.float64)
    flat, _ = undistort(pixels, camera)
    ray = np.column_stack([flat, np.ones(len(flat))])  # of length 1 along the optical axis: t is depth
    seen = pose.rotation.apply(ray)
    scene = world.scene(visit)
    hits = scene.cast(pose.translation.astype(np.float32), seen.astype(np.float32))
    colour = _colours(world, visit, hits, pose.translation, seen, camera)
    background = colour.reshape(height, width, 3)
    shown = _shown(marker, visit, pose, camera, hits, world)
    conditions = _conditions(rng, sensor, camera, T_local_cam)
    image = render_marker_image(rng, camera, background, shown, conditions).bgr
    depth = np.where(hits.met, hits.t, 0.0).reshape(height, width)
    return RgbdFrame(stamp_s, image, _measured(rng, sensor, depth), f"simulated:{index}", index)


def placed_marker(marker: Marker, visit: MarkerVisit, T_local_cam: RigidTransform) -> PlacedMarker:
    """The marker of a visit before the camera."""
    seen = T_local_cam.inv() * visit.T_local_marker
    quat = seen.rotation.as_quat(canonical=True, scalar_first=True)
    return PlacedMarker(marker.family, marker.id, marker.size_m, seen.translation, quat, "csr")


def _colours(
    world: World,
    visit: MarkerVisit | None,
    hits: Hits,
    origin_m: Float[np.ndarray, "3"],
    seen: Float[np.ndarray, "n 3"],
    camera: Camera,
) -> Float32[np.ndarray, "n 3"]:
    length = np.linalg.norm(seen, axis=1)
    up = np.clip(seen[:, 2] / length, 0.0, 1.0)[:, None].astype(np.float32)
    colour = _SKY_BGR[0] + np.sqrt(up) * (_SKY_BGR[1] - _SKY_BGR[0])
    met = np.flatnonzero(hits.met)
    mesh = world.scene(visit).mesh
    material = mesh.material[hits.triangle[met]]
    depth_m, normal = hits.t[met].astype(np.float64), hits.normal[met].astype(np.float64)
    point_m = origin_m + depth_m[:, None] * seen[met]
    towards = -np.sum(normal * seen[met], axis=1)
    grazing = np.clip(np.abs(towards) / length[met], 0.15, 1.0)
    footprint_m = depth_m / camera.intrinsics_px[0] / np.sqrt(grazing)
    own = albedo_bgr(world.textures, point_m, normal, material, footprint_m) * mesh.tint[hits.triangle[met]]
    facing = normal * np.where(towards < 0, -1.0, 1.0)[:, None]
    own = own * light(world.sun, point_m, facing)[:, None]
    board = material == BOARD
    if visit is not None and board.any():
        own[board] = board_bgr(world.seed, visit, point_m[board])
    colour[met] = own
    return colour


def _shown(
    marker: Marker,
    visit: MarkerVisit | None,
    pose: RigidTransform,
    camera: Camera,
    hits: Hits,
    world: World,
) -> list[PlacedMarker]:
    """The marker, where its front is seen and all of it lies before the lens."""
    if visit is None:
        return []
    placed = placed_marker(marker, visit, pose)
    seen = RigidTransform.from_components(
        placed.t_cam_marker_m, Rotation.from_quat(placed.quat_cam_marker_wxyz, scalar_first=True)
    )
    board = world.scene(visit).mesh.material[hits.triangle] == BOARD
    corners_m = seen.apply(marker.size_m * np.column_stack([UNIT_CORNERS, np.zeros(4)]))
    _, _, in_front = project(corners_m, camera)
    towards = seen.rotation.as_matrix()[:, 2] @ seen.translation < 0.0
    return [placed] if np.any(board & hits.met) and np.all(in_front) and towards else []


def _conditions(
    rng: np.random.Generator,
    sensor: RgbdCamera,
    camera: Camera,
    T_local_cam: Callable[[Float[np.ndarray, "c"]], RigidTransform],
) -> ImageConditions:
    """Motion blur by how the camera turns while the shutter is open; some defocus, exposure that is never the same."""
    poses = T_local_cam(np.array([0.0, sensor.exposure_s]))
    turn_rad = (poses.rotation[0].inv() * poses.rotation[1]).as_rotvec()
    blur_px = camera.intrinsics_px[:2] * [turn_rad[1], -turn_rad[0]]
    return ImageConditions(
        defocus_px=rng.uniform(0.45, 0.65),
        motion_px=float(np.linalg.norm(blur_px)),
        motion_angle_rad=float(np.arctan2(blur_px[1], blur_px[0])),
        gain=rng.uniform(0.92, 1.08),
        cast=(rng.uniform(0.98, 1.02), 1.0, rng.uniform(0.98, 1.02)),
        vignetting=0.12,
        read_noise=sensor.read_noise,
        shot_noise=sensor.shot_noise,
    )


def _measured(
    rng: np.random.Generator, sensor: RgbdCamera, depth_m: Float32[np.ndarray, "h w"]
) -> Float32[np.ndarray, "h w"]:
    """Depth through disparity: noise that neighbours share, steps, holes where depth jumps; 0 where there is none."""
    usable = (depth_m >= sensor.min_range_m) & (depth_m <= sensor.max_range_m)
    disparity = sensor.disparity_px_m / np.where(usable, depth_m, 1.0)
    # Of unit variance after smoothing over windows of about this size, as block matching does.
    noise = cv2.GaussianBlur(rng.standard_normal(depth_m.shape, dtype=np.float32), (0, 0), 1.5)
    noise *= 2.0 * np.sqrt(np.pi) * 1.5
    disparity = disparity + sensor.disparity_sigma_px * noise
    disparity = sensor.disparity_step_px * np.rint(disparity / sensor.disparity_step_px)
    near = np.where(usable, 1.0 / np.maximum(depth_m, sensor.min_range_m), 0.0).astype(np.float32)
    jump_px = sensor.disparity_px_m * cv2.morphologyEx(near, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
    edge = jump_px > _EDGE_PX
    found = usable & ~edge & (disparity > 0)
    measured = np.where(found, sensor.disparity_px_m / np.where(found, disparity, 1.0), 0.0)
    return np.where((measured >= sensor.min_range_m) & (measured <= sensor.max_range_m), measured, 0.0).astype(
        np.float32
    )
