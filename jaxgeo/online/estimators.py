"""The two estimators, fixed noise and noise ensemble, behind one face: state the graph, solve it, gather the answer."""

import dataclasses
from typing import Any, Protocol

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxgeo.data import Trajectory
from jaxgeo.graph.anchor_table import AnchorTable
from jaxgeo.graph.chain import Chain
from jaxgeo.graph.components import NoiseEnsemble
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.online import ensemble_solve, fixed_solve
from jaxgeo.online.joint import LastPose
from jaxgeo.online.warm_start import LastSolution
from jaxgeo.solve.correct import Settings
from jaxgeo.solve.ensemble_correct import ensemble_correction
from jaxgeo.solve.measurement_space import MeasurementSpaceLM
from jaxgeo.solve.solver import SOLVER_FOR_GRADIENTS, result_words, succeeded

# A solve on the way may stop where a next step would lower the cost by no more than this: then no pose is further from
# the optimum than a tenth of its standard deviation. The next solve goes on from there, the final one to the end.
SOLVER_ON_THE_WAY = MeasurementSpaceLM(rtol=1e-6, atol=5e-3)
# Closer to the optimum than the batch job, whose own tolerance may leave millimetres far from all anchors.
SOLVER_FINAL = SOLVER_FOR_GRADIENTS


@dataclasses.dataclass(frozen=True)
class Answer:
    """One solve.

    Attributes:
        converged, words: or why not.
        steps: taken.
        last_pose: where the drift goes on from.
        last: where the next solve starts.
        framed, found: what the whole trajectory is gathered from.
    """

    converged: bool
    words: str
    steps: int
    last_pose: LastPose
    last: LastSolution
    framed: Any
    found: Any


class Estimator(Protocol):
    """A way to solve."""

    def frame(self, chain: Chain, table: AnchorTable) -> Any:
        """The graph at its coarse fit; its `known` says whether the anchors fix the frame."""
        ...

    def solve(self, framed: Any, count: int, last: LastSolution | None, *, final: bool) -> Answer:
        """The optimum, from the last solution or the coarse fit."""
        ...

    def whole(
        self, answer: Answer, trajectory: Trajectory, chain: Chain, table: AnchorTable
    ) -> tuple[Trajectory, Float[np.ndarray, "n 6 6"], float]:
        """All poses, their covariances, and the log-scale."""
        ...


class FixedNoise:
    """White noise, constant bias and log-scale of given size: what `correct` solves."""

    def __init__(self, noise: OdometryNoise, settings: Settings) -> None:
        self._noise, self._settings = noise, settings
        self._options = settings.fold_options(noise)
        self._width = jnp.asarray(settings.loss_width)

    def frame(self, chain: Chain, table: AnchorTable) -> fixed_solve.Framed:
        return fixed_solve.framed(chain, table, self._noise, self._width, self._options)

    def solve(self, framed: fixed_solve.Framed, count: int, last: LastSolution | None, *, final: bool) -> Answer:
        solver = SOLVER_FINAL if final else SOLVER_ON_THE_WAY
        found = fixed_solve.solved(framed, jnp.asarray(count), last, self._settings.max_steps, solver)
        solution = found.solution
        converged = bool(succeeded(solution.result)) and _finite(found.last_pose)
        words = result_words(solution.result)
        return Answer(converged, words, int(solution.steps), found.last_pose, found.last, framed, found)

    def whole(
        self, answer: Answer, trajectory: Trajectory, chain: Chain, table: AnchorTable
    ) -> tuple[Trajectory, Float[np.ndarray, "n 6 6"], float]:
        n, poses = len(trajectory), answer.found.solution.poses
        glob = answer.found.solution.glob
        covariance = fixed_solve.covariances(answer.framed, poses, glob)
        position = np.stack([np.asarray(c)[:n] for c in poses.t], axis=-1) + np.asarray(answer.framed.origin_m)
        quat = np.stack([np.asarray(c)[:n] for c in poses.quat], axis=-1)
        corrected = Trajectory(trajectory.stamp_s.copy(), position, quat)
        return corrected, np.asarray(covariance)[:n], float(glob.log_scale)


class UnderEnsemble:
    """Weighted sets of every noise component: what `solve_ensemble` solves."""

    def __init__(self, noise: NoiseEnsemble, settings: Settings) -> None:
        self._noise = noise
        self._options = settings.ensemble_options()
        self._width = jnp.asarray(settings.loss_width)

    def frame(self, chain: Chain, table: AnchorTable) -> ensemble_solve.EnsembleFramed:
        return ensemble_solve.ensemble_framed(chain, table, self._noise, self._width, self._options)

    def solve(
        self, framed: ensemble_solve.EnsembleFramed, count: int, last: LastSolution | None, *, final: bool
    ) -> Answer:
        found = ensemble_solve.ensemble_solved(framed, self._noise, jnp.asarray(count), last)
        settled = bool(found.settled)
        words = "converged" if settled else f"markers still move by {float(found.moved_m):.3g} m a round"
        converged = settled and _finite(found.last_pose)
        return Answer(converged, words, int(found.rounds), found.last_pose, found.last, framed, found)

    def whole(
        self, answer: Answer, trajectory: Trajectory, chain: Chain, table: AnchorTable
    ) -> tuple[Trajectory, Float[np.ndarray, "n 6 6"], float]:
        fold = ensemble_solve.ensemble_fold(answer.framed, self._noise, answer.found, table)
        own = Trajectory(trajectory.stamp_s.copy(), trajectory.position_m, trajectory.quat_wxyz)
        made = ensemble_correction(own, chain, fold)
        return made.corrected, made.covariance, made.log_scale


def estimator_of(noise: OdometryNoise | NoiseEnsemble, settings: Settings) -> Estimator:
    return FixedNoise(noise, settings) if isinstance(noise, OdometryNoise) else UnderEnsemble(noise, settings)


def _finite(last: LastPose) -> bool:
    return bool(np.all(np.isfinite(last.position_m)) and np.all(np.isfinite(last.covariance)))
