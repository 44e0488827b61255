"""Whether two RGB-D keyframes can have seen one scene: points of one against the surface of the other."""

import numpy as np
from jaxtyping import Float

from jaxgeo.associate.camera_model import project
from jaxgeo.geometry import rigid
from jaxgeo.mapping.depth_gates import DepthGates
from jaxgeo.mapping.rgbd_camera import RgbdCamera
from jaxgeo.mapping.rgbd_keyframe import COARSE_PX, RgbdKeyframe

_ENOUGH_POINTS = 100
_SURFACE_M = 0.05


def surface_share(
    points_m: Float[np.ndarray, "n 3"],
    other: RgbdKeyframe,
    T_other_body: Float[np.ndarray, "4 4"],
    camera: RgbdCamera,
    gates: DepthGates,
) -> float:
    """Of the points that another keyframe should see, the share that lie on the surface it saw.

    The rest lie clearly in front of that surface: where they are said to be, the other camera saw through. Points
    behind it are hidden and tell nothing. 0 where fewer than a hundred tell anything.
    """
    moved = rigid.apply(rigid.inverse(camera.T_body_cam) @ T_other_body, points_m)
    ahead = moved[moved[:, 2] > gates.min_m]
    if len(ahead) < _ENOUGH_POINTS:
        return 0.0
    pixels, _, in_range = project(ahead, camera.camera)
    column, row = np.round(np.where(in_range[:, None], pixels, -COARSE_PX) / COARSE_PX).astype(np.int64).T
    height, width = other.coarse_depth_m.shape
    inside = in_range & (column >= 0) & (column < width) & (row >= 0) & (row < height)
    surface = other.coarse_depth_m[row[inside], column[inside]].astype(np.float64)
    z = ahead[inside, 2][surface > 0.0]
    surface = surface[surface > 0.0]
    allowed = _SURFACE_M + 4.0 * gates.sigma_m(z)
    on, before = np.abs(z - surface) <= allowed, z < surface - allowed
    told = int(on.sum() + before.sum())
    return float(on.sum() / told) if told >= _ENOUGH_POINTS else 0.0
