"""A small room of markers on three walls, photographed: true poses and exact corners."""

import numpy as np
from scipy.spatial.transform import Rotation

from jaxgeo.associate.camera_model import project
from jaxgeo.associate.planar import UNIT_CORNERS
from jaxgeo.data import Camera, CornerSightings, Rig

SIDE_M = 0.15
N_IMAGES = 10


def room_rig(model: str = "none", distortion: tuple[float, ...] = ()) -> Rig:
    turn = Rotation.from_rotvec([0.1, -0.2, 0.05]).as_quat(scalar_first=True)
    intrinsics = np.array([700.0, 710.0, 400.0, 300.0])
    return Rig({"cam0": Camera(intrinsics, model, np.array(distortion), (800, 600), np.array([0.1, -0.05, 0.2]), turn)})


def true_markers() -> tuple[Rotation, np.ndarray]:
    """T_room_marker: five on the wall y = 0 that look along +y, one of them turned; the first is the frame."""
    position = np.array([[0.0, 0.0, 1.0], [0.5, 0.1, 1.2], [1.0, 0.0, 0.9], [1.5, -0.1, 1.3], [0.8, 0.3, 1.5]])
    upright = Rotation.from_matrix(np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]))
    turns = [[0, 0, 0], [0, 0, 0.4], [0.2, 0, 0], [0, 0, -0.5], [-0.3, 0.2, 0.1]]
    return Rotation.from_rotvec(turns) * upright, position


def sighted(
    rig: Rig, noise_px: float = 0.0, seed: int = 0, side_m: float = SIDE_M
) -> tuple[CornerSightings, tuple[Rotation, np.ndarray], tuple[Rotation, np.ndarray]]:
    """Sightings of all images, true T_map_marker, and true T_map_body; the map frame is marker "m0"."""
    rng = np.random.default_rng(seed)
    camera = rig.cameras["cam0"]
    R_marker, t_marker = true_markers()
    eye = np.column_stack(
        [np.linspace(-0.3, 1.9, N_IMAGES), rng.uniform(1.5, 2.5, N_IMAGES), rng.uniform(0.8, 1.8, N_IMAGES)]
    )
    target = np.column_stack([np.linspace(0.2, 1.2, N_IMAGES), np.zeros(N_IMAGES), np.full(N_IMAGES, 1.15)])
    z = (target - eye) / np.linalg.norm(target - eye, axis=1, keepdims=True)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    R_cam = Rotation.from_matrix(np.stack([x, np.cross(z, x), z], axis=2))
    R_body_cam = Rotation.from_quat(camera.quat_body_cam_wxyz, scalar_first=True)
    R_body = R_cam * R_body_cam.inv()
    t_body = eye - R_body.apply(camera.t_body_cam_m)
    corners_m = np.column_stack([side_m * UNIT_CORNERS, np.zeros(4)])
    stamp, marker, pixels = [], [], []
    for i in range(N_IMAGES):
        for m in range(len(t_marker)):
            in_cam = R_cam[i].inv().apply(R_marker[m].apply(corners_m) + t_marker[m] - eye[i])
            seen, _, ok = project(in_cam, camera)
            if ok.all() and np.all((seen > 0) & (seen < [800, 600])):
                stamp.append(float(i))
                marker.append(f"m{m}")
                pixels.append(seen)
    n = len(stamp)
    corners = np.array(pixels) + noise_px * rng.standard_normal((n, 4, 2))
    source = np.array([f"room.csv:{row + 2}" for row in range(n)])
    sightings = CornerSightings(np.array(stamp), np.full(n, "cam0"), np.array(marker), corners, source)
    back = R_marker[0].inv()
    in_map = lambda R, t: (back * R, back.apply(t - t_marker[0]))  # noqa: E731
    return sightings, in_map(R_marker, t_marker), in_map(R_body, t_body)
