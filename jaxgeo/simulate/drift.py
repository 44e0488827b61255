"""What odometry makes of a true motion."""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

Axes = tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class Drift:
    """The errors of one odometry, body axes; what is constant is given, what is white is drawn.

    Attributes:
        sigma_trans_m_per_sqrt_m, sigma_rot_rad_per_sqrt_m: white noise by distance.
        sigma_turn_rad_per_sqrt_rad: white rotation noise by turned angle.
        bias_trans_m_per_m, bias_rot_rad_per_m: constant over the session.
        log_scale: the odometry's translations are exp(-log_scale) times the true ones.
    """

    sigma_trans_m_per_sqrt_m: Axes = (0.0, 0.0, 0.0)
    sigma_rot_rad_per_sqrt_m: Axes = (0.0, 0.0, 0.0)
    sigma_turn_rad_per_sqrt_rad: float = 0.0
    bias_trans_m_per_m: Axes = (0.0, 0.0, 0.0)
    bias_rot_rad_per_m: Axes = (0.0, 0.0, 0.0)
    log_scale: float = 0.0


def drifting_steps(truth: RigidTransform, drift: Drift, random: np.random.Generator) -> RigidTransform:
    """Odometry steps `O_k` with `T_{k+1} = T_k O_k Exp(e_k)`: e_k is what the odometry missed.

    A step of length d and turn a has white noise of variance `sigma_trans^2 d` and `sigma_rot^2 d + sigma_turn^2 a`,
    and a bias in proportion to d.
    """
    step = truth[:-1].inv() * truth[1:]
    length_m = np.linalg.norm(step.translation, axis=1, keepdims=True)
    turn_rad = step.rotation.magnitude()[:, None]
    white = random.standard_normal((len(length_m), 6))
    trans = white[:, :3] * np.asarray(drift.sigma_trans_m_per_sqrt_m) * np.sqrt(length_m)
    sigma_rot = np.sqrt(
        np.square(drift.sigma_rot_rad_per_sqrt_m) * length_m + drift.sigma_turn_rad_per_sqrt_rad**2 * turn_rad
    )
    trans = trans + np.asarray(drift.bias_trans_m_per_m) * length_m
    rot = white[:, 3:] * sigma_rot + np.asarray(drift.bias_rot_rad_per_m) * length_m
    # SciPy's exponential coordinates are rotation first.
    missed = RigidTransform.from_exp_coords(np.hstack([rot, trans]))
    seen = step * missed.inv()
    return RigidTransform.from_components(seen.translation * np.exp(-drift.log_scale), seen.rotation)


def chain(steps: RigidTransform) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 4"]]:
    """Positions and quaternions (wxyz) of the poses that the steps make, the first at the origin of its own map."""
    matrix = steps.as_matrix()
    poses = np.empty((len(matrix) + 1, 4, 4))
    poses[0] = np.eye(4)
    for k, one in enumerate(matrix):
        poses[k + 1] = poses[k] @ one
    made = RigidTransform.from_matrix(poses)
    return made.translation, made.rotation.as_quat(canonical=True, scalar_first=True)
