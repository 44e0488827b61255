"""How the position of odometry alone drifts with distance: what a noise predicts, and what the anchors show.

Edge k's noise n_k, of translation and rotation in the body axes R_k, moves a later pose at p_i by

    R_k n_k,trans + (R_k n_k,rot) x (p_i - p_k)

The trace of the covariance that this sums up to is worked out directly, pose by pose asked for (the estimator has it as
prefix sums of 6x6 matrices): it does not depend on the frame, so the odometry's own will do.
"""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from jaxgeo.data import Anchors, Trajectory
from jaxgeo.export.result import DriftGrowth
from jaxgeo.graph.components import (
    BIAS_ROT,
    BIAS_TRANS,
    BOUNDED,
    LOG_SCALE,
    LOG_TURN,
    N_COMPONENTS,
    ROT,
    TRANS,
    TURN,
    WANDER_ROT,
    WANDER_SCALE,
    WANDER_TRANS,
    NoiseEnsemble,
)
from jaxgeo.graph.noise import LENGTH_FLOOR_M
from jaxgeo.solve.drift import BLOCKS

# Distances at which the prediction is worked out.
_STEPS = 96


def drift_growth(
    trajectory: Trajectory,
    anchors: Anchors,
    scale: float,
    residual_coarse_m: Float[np.ndarray, "k 3"],
    fixed: NoiseEnsemble,
    learned: NoiseEnsemble | None,
) -> DriftGrowth:
    """Predicted standard deviation of the position (length of the error in space) of odometry that starts, without
    error, at the first anchor, and goes on without any other; `scale` is the coarse fit's.

    Observed: how far each anchor's misclosure after the coarse fit is from the first anchor's.
    """
    start, last = int(anchors.pose_index.min()), int(anchors.pose_index.max())
    index = np.unique(np.linspace(start, last, _STEPS).round().astype(int))
    correlation_m = float((fixed if learned is None else learned).correlation_m)
    path_m, variance = unit_variances(trajectory, start, index, correlation_m, scale)

    def of_sets(ensemble: NoiseEnsemble) -> Float[np.ndarray, "q p"]:
        return np.asarray(ensemble.sigma) ** 2 @ variance

    band = None
    if learned is not None:
        sets, weight = np.sqrt(of_sets(learned)), np.asarray(learned.weight)
        band = np.stack([weighted_quantile(sets, weight, p) for p in (0.025, 0.975)])
    first = int(np.argmin(anchors.pose_index))
    return DriftGrowth(
        distance_m=path_m[index] - path_m[start],
        fixed_m=np.sqrt(np.asarray(fixed.weight) @ of_sets(fixed)),
        learned_m=None if learned is None else np.sqrt(np.asarray(learned.weight) @ of_sets(learned)),
        learned_band_m=band,
        observed_distance_m=path_m[anchors.pose_index] - path_m[start],
        observed_m=np.linalg.norm(residual_coarse_m - residual_coarse_m[first], axis=1),
    )


def unit_variances(
    trajectory: Trajectory, start: int, index: Int[np.ndarray, "p"], correlation_m: float, scale: float = 1.0
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n_components p"]]:
    """Distance along the path of every pose; and the trace of the covariance of the positions asked for, in a chain
    that begins at the pose `start`, of each noise component at sigma 1."""
    position = scale * trajectory.position_m
    rotation = Rotation.from_quat(trajectory.quat_wxyz, scalar_first=True)
    turned = (rotation[:-1].inv() * rotation[1:]).as_rotvec()
    step_m = np.linalg.norm(np.diff(trajectory.position_m, axis=0), axis=1) + LENGTH_FLOOR_M
    path_m = np.concatenate([[0.0], np.cumsum(step_m)])
    # The wander is constant on equal stretches of the whole path, as in the estimator.
    stretch = np.clip(np.ceil(path_m[1:] / path_m[-1] * BLOCKS).astype(int) - 1, 0, BLOCKS - 1)
    axes = rotation[1:].as_matrix()
    turned_grid, shifts = np.einsum("kij,kj->ki", axes, turned), np.diff(position, axis=0)
    step = np.arange(BLOCKS)
    rho = np.exp(-np.abs(step[:, None] - step[None]) * path_m[-1] / BLOCKS / correlation_m)
    out = np.zeros((N_COMPONENTS, len(index)))
    for at, pose in enumerate(index):
        edge = slice(start, pose)
        length, r = step_m[edge, None], position[pose] - position[1:][edge]
        column = np.moveaxis(axes[edge], 2, 0)
        lever = np.cross(column, r[None])
        out[TRANS, at] = length.sum()
        out[ROT, at] = (length[None] * lever**2).sum(axis=(1, 2))
        out[TURN, at] = 2.0 * np.linalg.norm(turned[edge], axis=1) @ (r**2).sum(axis=1)
        shift = shifts[edge]
        out[LOG_SCALE, at] = (shift.sum(axis=0) ** 2).sum()
        out[LOG_TURN, at] = (np.cross(turned_grid[edge], r).sum(axis=0) ** 2).sum()
        once = {WANDER_TRANS: length[None] * column, WANDER_ROT: length[None] * lever, WANDER_SCALE: shift[None]}
        for component, moved in once.items():
            total = np.concatenate([np.zeros((len(moved), 1, 3)), np.cumsum(moved, axis=1)], axis=1)
            per = np.diff(total[:, np.searchsorted(stretch[edge], np.arange(BLOCKS + 1))], axis=1)
            out[component, at] = np.einsum("abi,bc,aci->", per, rho, per)
        out[BIAS_TRANS, at] = ((length[None] * column).sum(axis=1) ** 2).sum()
        out[BIAS_ROT, at] = ((length[None] * lever).sum(axis=1) ** 2).sum()
        # A bounded error is not summed: it is the difference of its values at the two ends, on three axes.
        out[BOUNDED, at] = 6.0 * (1.0 - np.exp(-(path_m[pose] - path_m[start]) / correlation_m))
    return path_m, out


def weighted_quantile(
    value: Float[np.ndarray, "q p"], weight: Float[np.ndarray, "q"], p: float
) -> Float[np.ndarray, "p"]:
    """The smallest value of each column below which, with itself, lies at least the share p of the weight."""
    order = np.argsort(value, axis=0)
    share = np.cumsum(weight[order], axis=0)
    row = np.minimum((share < p * weight.sum()).sum(axis=0), len(weight) - 1)
    return np.take_along_axis(value, np.take_along_axis(order, row[None], axis=0), axis=0)[0]
