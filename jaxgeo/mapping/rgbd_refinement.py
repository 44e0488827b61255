"""The motion between two RGB-D frames by least squares on paired features."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from jaxgeo.geometry import rigid
from jaxgeo.mapping.depth_gates import DepthGates


@dataclasses.dataclass(frozen=True)
class FeaturePairs:
    """Paired features; points in the camera axes, NaN where there is no depth."""

    rays: tuple[Float[np.ndarray, "m 2"], Float[np.ndarray, "m 2"]]
    depth_m: tuple[Float[np.ndarray, "m"], Float[np.ndarray, "m"]]

    def points_m(self, side: int) -> Float[np.ndarray, "m 3"]:
        depth = self.depth_m[side][:, None]
        return np.hstack([self.rays[side] * depth, depth])

    def __len__(self) -> int:
        return len(self.rays[0])


def refine_motion(
    pairs: FeaturePairs,
    agree: Bool[np.ndarray, "m"],
    T: Float[np.ndarray, "4 4"],
    sigma_angle_rad: float,
    gates: DepthGates,
) -> tuple[Float[np.ndarray, "4 4"], Float[np.ndarray, "6 6"]]:
    """Gauss-Newton on rays and depths both ways, with Huber's weights; and the covariance at the end.

    The unknown is x in `T_first_second Exp(x)`. A pair with two depths is counted in both directions though both are
    one observation, so the normal matrix is halved; and the covariance is scaled by the mean squared residual where
    that exceeds one.
    """
    for _ in range(_STEPS):
        residual, jacobian = _linearise(pairs, agree, T, sigma_angle_rad, gates)
        size = np.abs(residual)
        weight = np.where(size > _HUBER, _HUBER / np.maximum(size, _HUBER), 1.0)
        normal = (jacobian * weight[:, None]).T @ jacobian + 1e-9 * np.eye(6)
        step = -np.linalg.solve(normal, jacobian.T @ (weight * residual))
        T = T @ rigid.exp(step)
    residual, jacobian = _linearise(pairs, agree, T, sigma_angle_rad, gates)
    scale = max(1.0, float(np.mean(residual**2)))
    return T, 2.0 * scale * np.linalg.inv(jacobian.T @ jacobian + 1e-9 * np.eye(6))


_STEPS = 4
_HUBER = 1.5  # standard deviations


def _linearise(
    pairs: FeaturePairs,
    agree: Bool[np.ndarray, "m"],
    T: Float[np.ndarray, "4 4"],
    sigma_angle_rad: float,
    gates: DepthGates,
) -> tuple[Float[np.ndarray, "r"], Float[np.ndarray, "r 6"]]:
    """Whitened residuals of the pairs that agree, and their derivative by x in `T_first_second Exp(x)`.

    Both features of a pair err; and where the cameras stand apart by b, a depth's error s moves the ray by b s / z^2.
    """
    baseline_m = float(np.linalg.norm(T[:3, 3]))
    residuals, jacobians = [], []
    for side, motion in enumerate((rigid.inverse(T), T)):
        points = pairs.points_m(side)
        rows = agree & np.all(np.isfinite(points), axis=1) & np.all(np.isfinite(pairs.rays[1 - side]), axis=1)
        points, R = points[rows], motion[:3, :3]
        moved = points @ R.T + motion[:3, 3]
        if side == 0:  # into the second's frame: Exp(-x) T^-1 p
            by_x = np.concatenate([-np.broadcast_to(np.eye(3), (len(moved), 3, 3)), _hats(moved)], axis=2)
        else:  # into the first's frame: T Exp(x) p
            by_x = np.concatenate([np.broadcast_to(R, (len(moved), 3, 3)), -R @ _hats(points)], axis=2)
        z = moved[:, 2]
        project = np.zeros((len(moved), 2, 3))
        project[:, 0, 0] = project[:, 1, 1] = 1.0 / z
        project[:, :, 2] = -moved[:, :2] / z[:, None] ** 2
        sigma_depth = gates.sigma_m(points[:, 2])
        sigma = np.hypot(np.sqrt(2.0) * sigma_angle_rad, baseline_m * sigma_depth / z**2)[:, None]
        residuals.append(((moved[:, :2] / z[:, None] - pairs.rays[1 - side][rows]) / sigma).ravel())
        jacobians.append(((project @ by_x) / sigma[:, :, None]).reshape(-1, 6))
        other = pairs.depth_m[1 - side][rows]
        both = np.isfinite(other)
        sigma = np.hypot(gates.sigma_m(other[both]), sigma_depth[both])
        residuals.append((z[both] - other[both]) / sigma)
        jacobians.append(by_x[both, 2] / sigma[:, None])
    return np.concatenate(residuals), np.concatenate(jacobians)


def _hats(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
