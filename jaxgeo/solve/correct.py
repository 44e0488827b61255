"""Correct one trajectory: the main entry point of the estimator."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxgeo.data import Anchors, Trajectory
from jaxgeo.errors import ConvergenceError, SightingError, UndeterminedError
from jaxgeo.geometry.robust import RobustKind
from jaxgeo.geometry.sim3 import Sim3, sim3_apply_trajectory
from jaxgeo.graph.anchor_table import AnchorTable, anchor_table
from jaxgeo.graph.bucket import anchor_bucket
from jaxgeo.graph.chain import Chain, Poses, chain_of
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.graph.pose_graph import Globals, Terms
from jaxgeo.precision import assert_float64
from jaxgeo.solve.fold import FOLD_BATCH, Fold, FoldOptions, fold_graph, solve_folds
from jaxgeo.solve.gauge import free_direction_words
from jaxgeo.solve.posterior import all_pose_covariances, posterior
from jaxgeo.solve.solver import result_words, succeeded


@dataclasses.dataclass(frozen=True)
class Settings:
    """How a trajectory is corrected.

    Attributes:
        coarse_scale, coarse_gravity: of the one-time similarity.
        loss, loss_width: robust loss on the anchors, its width in standard deviations.
        use_rotation: surveyed marker rotations enter the graph.
        extra_sigma_m: added in squares to every anchor.
        max_steps: trial steps before the solver gives up.
    """

    coarse_scale: bool = True
    coarse_gravity: bool = False
    loss: RobustKind = "none"
    loss_width: float = 3.0
    use_rotation: bool = False
    extra_sigma_m: float = 0.0
    max_steps: int = 50

    def fold_options(self, noise: OdometryNoise) -> FoldOptions:
        """The choices that compile: a noise term enters the graph where its prior is not zero."""
        bias = np.any(noise.sigma_bias_trans_m_per_m) or np.any(noise.sigma_bias_rot_rad_per_m)
        return self._options(Terms(self.use_rotation, bool(noise.sigma_log_scale > 0), bool(bias), self.loss))

    def ensemble_options(self) -> FoldOptions:
        """The same under a noise ensemble: its terms are in the ensemble, the graph only carries the log-scale."""
        return self._options(Terms(self.use_rotation, log_scale=True, loss=self.loss))

    def _options(self, terms: Terms) -> FoldOptions:
        return FoldOptions(self.coarse_scale, self.coarse_gravity, terms, self.max_steps)


@dataclasses.dataclass(frozen=True)
class Correction:
    """A corrected trajectory, local frame.

    Attributes:
        coarse: the measured trajectory after the one-time similarity, whose translation is `coarse_translation_m`.
        corrected: the trajectory after the pose graph.
        covariance: (n, 6, 6) of `corrected`, grid axes: position error added, rotation error multiplied on the left.
        fold: coarse fit, predictions and result code, anchors padded.
        bias: (6,) estimated constant bias per metre, (translation, rotation).
        log_scale: estimate and its standard deviation.
    """

    coarse: Trajectory
    coarse_translation_m: Float[np.ndarray, "3"]
    corrected: Trajectory
    covariance: Float[np.ndarray, "n 6 6"]
    fold: Fold
    bias: Float[np.ndarray, "6"]
    log_scale: tuple[float, float]

    @property
    def result(self) -> str:
        return result_words(self.fold.solution.result)


@functools.partial(jax.jit, static_argnames="options")
def _covariances(
    chain: Chain,
    table: AnchorTable,
    noise: OdometryNoise,
    loss_width: Array,
    options: FoldOptions,
    poses: Poses,
    glob: Globals,
) -> Float[Array, "n 6 6"]:
    graph, *_ = fold_graph(chain, table, noise, table.real, loss_width, options)
    return all_pose_covariances(posterior(graph, poses, glob))


def correct(trajectory: Trajectory, anchors: Anchors, noise: OdometryNoise, settings: Settings) -> Correction:
    """Georeference one trajectory with all its anchors.

    Raises:
        SightingError: rotations are to be used, and no anchor has one.
        UndeterminedError: the anchors leave a direction of the frame free; names it.
        ConvergenceError: the solver stopped early; names its result code and steps.
    """
    correction, _ = correct_with_folds(trajectory, anchors, noise, settings, np.zeros((0, len(anchors))), batch=1)
    return correction


def correct_with_folds(
    trajectory: Trajectory,
    anchors: Anchors,
    noise: OdometryNoise,
    settings: Settings,
    use: Float[np.ndarray, "f k"],
    *,
    batch: int = FOLD_BATCH,
) -> tuple[Correction, Fold]:
    """The same, and the folds that use only some of the anchors (rows of `use`), in one compiled call.

    Raises:
        SightingError, UndeterminedError, ConvergenceError: as `correct`, of the correction with all anchors. A fold
            carries its own result code.
    """
    assert_float64()
    chain = chain_of(trajectory)
    table = anchor_table(anchors, chain, settings.extra_sigma_m)
    if settings.use_rotation and not np.any(table.has_rotation):
        raise SightingError(
            f"anchors.use_rotation is on, but none of the {len(anchors)} anchors has a rotation: the survey must give "
            "rx, ry, rz, and the sightings must be unambiguous marker poses. Add them, or set it to false."
        )
    # As many rows as a bucket holds, so that sessions with a few more or fewer locations share one program.
    rows = np.zeros((anchor_bucket(1 + len(use)) if len(use) else 1, table.real.shape[0]))
    rows[:, : len(anchors)] = 1.0
    rows[1 : 1 + len(use), : len(anchors)] = use
    options, width = settings.fold_options(noise), jnp.asarray(settings.loss_width)
    found, poses = solve_folds(chain, table, noise, jnp.asarray(rows), width, options, batch)
    found = jax.tree.map(np.asarray, found)
    fold = jax.tree.map(lambda x: x[0], found)
    _check(fold, anchors, settings.max_steps)
    covariance = _covariances(chain, table, noise, width, options, poses, fold.solution.glob)
    correction = _correction(trajectory, chain, fold, poses, np.asarray(covariance))
    return correction, jax.tree.map(lambda x: x[1 : 1 + len(use)], found)


def _correction(
    trajectory: Trajectory, chain: Chain, fold: Fold, poses: Poses, covariance: Float[np.ndarray, "p 6 6"]
) -> Correction:
    n = len(trajectory)
    position = np.stack([np.asarray(c)[:n] for c in poses.t], axis=-1) + np.asarray(fold.origin_m)
    quat = np.stack([np.asarray(c)[:n] for c in poses.quat], axis=-1)
    glob = fold.solution.glob
    coarse = _from_measured(fold.coarse, chain)
    return Correction(
        coarse=sim3_apply_trajectory(coarse, trajectory),
        coarse_translation_m=np.asarray(coarse.translation_m),
        corrected=Trajectory(trajectory.stamp_s, position, quat),
        covariance=covariance[:n],
        fold=fold,
        bias=np.array([*glob.bias_trans, *glob.bias_rot], dtype=float),
        log_scale=(float(glob.log_scale), float(fold.log_scale_sigma)),
    )


def _from_measured(coarse: Sim3, chain: Chain) -> Sim3:
    """The similarity from the trajectory's own frame, the chain's origin taken back."""
    shift = coarse.scale * (coarse.rotation @ chain.map_origin_m)
    return Sim3(coarse.scale, coarse.rotation, coarse.translation_m - shift)


def _check(fold: Fold, anchors: Anchors, max_steps: int) -> None:
    if not bool(fold.determined):
        free = free_direction_words(np.asarray(fold.gauge_sigma), np.asarray(fold.gauge_direction))
        places = sorted(set(anchors.location))
        raise UndeterminedError(
            f"the {len(anchors)} anchors at {len(places)} location(s) ({', '.join(places[:8])}) do not fix the frame: "
            f"{free}. Three locations off one line are needed: survey one to the side of the line, or, where the "
            "markers' rotations are surveyed, set anchors.use_rotation: true. Is every visit tied to its own location "
            "(visits.order, visits.locations)?"
        )
    if not bool(succeeded(fold.solution.result)):
        left_m = np.linalg.norm(np.asarray(fold.coarse_point_m)[: len(anchors)] - anchors.surveyed_enh_m, axis=1)
        worst = int(np.argmax(left_m))
        raise ConvergenceError(
            f"the pose graph did not converge: {result_words(fold.solution.result)} after {int(fold.solution.steps)} "
            f"of {max_steps} steps (solver.max_steps) at cost {float(fold.solution.cost):.6g}. After the coarse fit "
            f"visit {anchors.label[worst]!r} is farthest off, by {left_m[worst]:.3g} m, the median visit by "
            f"{np.median(left_m):.3g} m. Check for wrong anchors (anchors.loss: cauchy tolerates some), odometry noise "
            "far too small, or too few steps."
        )
