"""The two estimators, fixed noise and noise ensemble, behind one face: solve the graph, gather the answer.

On the way both take steps under one set of variances (`mean_solve`); the end is solved by the batch job's own solver.
"""

import dataclasses
from typing import Any, Protocol

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxgeo.data import Trajectory
from jaxgeo.graph.components import NoiseEnsemble
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.online import ensemble_solve, fixed_solve
from jaxgeo.online.frame_known import FrameKnown
from jaxgeo.online.joint import LastPose
from jaxgeo.online.mean_noise import mean_noise
from jaxgeo.online.mean_solve import OnTheWay, solved_on_the_way
from jaxgeo.online.warm_start import Given, LastSolution, chain_of_given
from jaxgeo.solve.correct import Settings
from jaxgeo.solve.ensemble_correct import ensemble_correction
from jaxgeo.solve.solver import result_words, succeeded


@dataclasses.dataclass(frozen=True)
class Answer:
    """One solve.

    Attributes:
        known: whether the anchors fix the frame; where not, nothing else here means anything.
        converged, words: or why not.
        steps: taken.
        last_pose: where the drift goes on from.
        last: where the next solve starts.
        found: what the whole trajectory is gathered from.
    """

    known: FrameKnown
    converged: bool
    words: str
    steps: int
    last_pose: LastPose
    last: LastSolution
    found: Any


class Estimator(Protocol):
    """A way to solve."""

    def solve(self, given: Given, last: LastSolution | None, *, final: bool) -> Answer:
        """From the last solution or the coarse fit: near the optimum, or, finally, at it."""
        ...

    def whole(
        self, answer: Answer, trajectory: Trajectory, given: Given
    ) -> tuple[Trajectory, Float[np.ndarray, "n 6 6"], float]:
        """All poses, their covariances, and the log-scale, of a final answer."""
        ...


class FixedNoise:
    """White noise, constant bias and log-scale of given size: what `correct` solves."""

    def __init__(self, noise: OdometryNoise, settings: Settings) -> None:
        self._noise, self._mean = noise, mean_noise(noise)
        self._options = settings.fold_options(noise)
        self._width = jnp.asarray(settings.loss_width)

    def solve(self, given: Given, last: LastSolution | None, *, final: bool) -> Answer:
        if not final:
            return _on_the_way(solved_on_the_way(given, self._mean, self._width, last, self._options))
        found = fixed_solve.solved(given, self._noise, self._width, last, self._options)
        solution = found.solution
        converged = bool(succeeded(solution.result)) and _finite(found.last_pose)
        words = result_words(solution.result)
        return Answer(found.known, converged, words, int(solution.steps), found.last_pose, found.last, found)

    def whole(
        self, answer: Answer, trajectory: Trajectory, given: Given
    ) -> tuple[Trajectory, Float[np.ndarray, "n 6 6"], float]:
        n, (poses, glob) = len(trajectory), (answer.found.solution.poses, answer.found.solution.glob)
        covariance = fixed_solve.covariances(given, self._noise, self._width, poses, glob, self._options)
        position = np.stack([np.asarray(c)[:n] for c in poses.t], axis=-1) + np.asarray(answer.last.origin_m)
        quat = np.stack([np.asarray(c)[:n] for c in poses.quat], axis=-1)
        corrected = Trajectory(trajectory.stamp_s.copy(), position, quat)
        return corrected, np.asarray(covariance)[:n], float(glob.log_scale)


class UnderEnsemble:
    """Weighted sets of every noise component: what `solve_ensemble` solves."""

    def __init__(self, noise: NoiseEnsemble, settings: Settings) -> None:
        self._noise, self._mean = noise, mean_noise(noise)
        self._options = settings.ensemble_options()
        self._width = jnp.asarray(settings.loss_width)

    def solve(self, given: Given, last: LastSolution | None, *, final: bool) -> Answer:
        if not final:
            return _on_the_way(solved_on_the_way(given, self._mean, self._width, last, self._options))
        found = ensemble_solve.ensemble_solved(given, self._noise, self._width, last, self._options)
        settled = bool(found.fold.settled)
        words = "converged" if settled else f"markers still move by {float(found.moved_m):.3g} m a round"
        converged = settled and _finite(found.last_pose)
        return Answer(found.known, converged, words, int(found.fold.rounds), found.last_pose, found.last, found)

    def whole(
        self, answer: Answer, trajectory: Trajectory, given: Given
    ) -> tuple[Trajectory, Float[np.ndarray, "n 6 6"], float]:
        own = Trajectory(trajectory.stamp_s.copy(), trajectory.position_m, trajectory.quat_wxyz)
        made = ensemble_correction(own, chain_of_given(given), answer.found.fold)
        return made.corrected, made.covariance, made.log_scale


def estimator_of(noise: OdometryNoise | NoiseEnsemble, settings: Settings) -> Estimator:
    return FixedNoise(noise, settings) if isinstance(noise, OdometryNoise) else UnderEnsemble(noise, settings)


def _on_the_way(found: OnTheWay) -> Answer:
    settled = bool(found.settled) and _finite(found.last_pose)
    words = "converged" if settled else "the steps do not settle"
    return Answer(found.known, settled, words, int(found.steps), found.last_pose, found.last, found)


def _finite(last: LastPose) -> bool:
    return bool(np.all(np.isfinite(last.position_m)) and np.all(np.isfinite(last.covariance)))
