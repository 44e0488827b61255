"""From a solved ensemble fold to a corrected trajectory with the covariance of every pose."""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxgeo.data import Trajectory
from jaxgeo.graph.chain import Chain
from jaxgeo.solve.ensemble_fold import CHUNK, EnsembleFold, covariance_at

# Poses whose covariance is worked out; between them it is interpolated along the path, on which it is smooth but for
# the anchors, which are always among them.
KNOTS = 512


@dataclasses.dataclass(frozen=True)
class EnsembleCorrection:
    """A trajectory corrected under a noise ensemble, local frame.

    Attributes:
        corrected: the mean of the ensemble's predictions.
        covariance: (n, 6, 6) of it, the spread between noise values included; grid axes, position error added,
            rotation error multiplied on the left.
        point_m: (k, 3) markers, anchors padded.
        log_scale: of the odometry, mean.
        rounds, settled: of the solution.
    """

    corrected: Trajectory
    covariance: Float[np.ndarray, "n 6 6"]
    point_m: Float[np.ndarray, "k 3"]
    log_scale: float
    rounds: int
    settled: bool


def ensemble_correction(trajectory: Trajectory, chain: Chain, fold: EnsembleFold) -> EnsembleCorrection:
    """Gather poses and covariances of the fold that used all anchors."""
    n = len(trajectory)
    poses, offset = fold.state.poses, fold.state.offset_m
    position = np.stack([np.asarray(p + u)[:n] for p, u in zip(poses.t, offset, strict=True)], axis=-1)
    quat = np.stack([np.asarray(c)[:n] for c in poses.quat], axis=-1)
    return EnsembleCorrection(
        corrected=Trajectory(trajectory.stamp_s, position + np.asarray(fold.origin_m), quat),
        covariance=_covariance(fold, n),
        point_m=np.asarray(fold.point_m),
        log_scale=float(fold.state.log_scale),
        rounds=int(fold.rounds),
        settled=bool(fold.settled),
    )


def _covariance(fold: EnsembleFold, n: int) -> Float[np.ndarray, "n 6 6"]:
    anchored = np.minimum(np.asarray(fold.observed.graph.anchors.pose_index), n - 1)
    knots = np.unique(np.concatenate([np.linspace(0, n - 1, min(n, KNOTS)).round().astype(int), anchored, [n - 1]]))
    padded = np.pad(knots, (0, -len(knots) % CHUNK), mode="edge")
    at = np.asarray(covariance_at(fold, jnp.asarray(padded)))[: len(knots)]
    # A mean of covariance matrices is one.
    after = np.searchsorted(knots, np.arange(n))
    before = np.maximum(after - 1, 0)
    gap = np.maximum(knots[after] - knots[before], 1)
    share = np.where(after > 0, (np.arange(n) - knots[before]) / gap, 1.0)[:, None, None]
    return (1.0 - share) * at[before] + share * at[after]
