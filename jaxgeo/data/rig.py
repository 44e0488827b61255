"""The rig: cameras fixed to one body."""

import equinox as eqx
import numpy as np
from jaxtyping import Float


class Camera(eqx.Module):
    """A pinhole camera fixed to the body.

    Attributes:
        intrinsics_px: (4,) fx, fy, cx, cy.
        distortion_model: `radtan` (Brown-Conrady: k1, k2, p1, p2[, k3]), `equidistant` (Kannala-Brandt: k1 .. k4) or
            `none`.
        distortion: coefficients of that model, empty for `none`.
        resolution_px: (width, height), or None where unknown.
        t_body_cam_m: (3,) optical centre in the body frame.
        quat_body_cam_wxyz: (4,) optical axes (x right, y down, z forward) to body.
    """

    intrinsics_px: Float[np.ndarray, "4"]
    distortion_model: str
    distortion: Float[np.ndarray, "k"]
    resolution_px: tuple[int, int] | None
    t_body_cam_m: Float[np.ndarray, "3"]
    quat_body_cam_wxyz: Float[np.ndarray, "4"]


class Rig(eqx.Module):
    """Cameras by name, all on one rigid body: the body whose poses the trajectory holds."""

    cameras: dict[str, Camera]
