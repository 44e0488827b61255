"""Learn one trajectory's noise, correct it with what was learned, and do the same without each held-out location."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from calibration.learn import Learned, LearnOptions, learn_folds, prior_arrays
from calibration.models import FamilyPrior, family_prior
from calibration.observations import ObservationSet
from calibration.result import Calibration
from calibration.summary import summarise
from jaxgeo.data import Anchors, Trajectory
from jaxgeo.errors import ConvergenceError
from jaxgeo.graph.anchor_table import anchor_table
from jaxgeo.graph.bucket import anchor_bucket
from jaxgeo.graph.chain import chain_of
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.precision import assert_float64
from jaxgeo.solve.correct import Settings
from jaxgeo.solve.ensemble_correct import EnsembleCorrection, ensemble_correction


@dataclasses.dataclass(frozen=True)
class LearnSettings:
    """What the learning starts from.

    Attributes:
        kind: of odometry: lidar, vio, wheel or mono.
        noise: its white sigmas are the prior's medians: the kind's defaults or the config's values.
        observations: `both`, `anchors` or `revisit`.
        free_anchor_factor: also learn one common factor on the anchors' own covariances.
        prior: learned on another session of the same platform; None: the documented one of the kind.
    """

    kind: str
    noise: OdometryNoise
    observations: ObservationSet = "both"
    free_anchor_factor: bool = False
    prior: FamilyPrior | None = None

    @property
    def family(self) -> FamilyPrior:
        if self.prior is not None:
            return self.prior
        return family_prior(self.kind, self.noise, free_anchor_factor=self.free_anchor_factor)


def learn_options(settings: Settings, learn: LearnSettings) -> LearnOptions:
    """The choices that compile."""
    return LearnOptions(settings.ensemble_options(), learn.observations)


def calibrate(trajectory: Trajectory, anchors: Anchors, settings: Settings, learn: LearnSettings) -> Calibration:
    """Learn the noise of one trajectory from all its anchors.

    Raises:
        ConvergenceError: learning and correcting did not settle.
    """
    return calibrate_and_correct(trajectory, anchors, settings, learn, np.zeros((0, len(anchors))))[0]


def calibrate_and_correct(
    trajectory: Trajectory,
    anchors: Anchors,
    settings: Settings,
    learn: LearnSettings,
    use: Float[np.ndarray, "f k"],
) -> tuple[Calibration, EnsembleCorrection, Learned]:
    """Learn and correct with all anchors; and, each on its own, with the anchors of every row of `use`.

    All in one compiled call. What was learned comes back stacked, without poses: all anchors first, then the folds.
    Check that the anchors fix the frame first (`correct` does): nothing here means anything where they do not.

    Raises:
        ConvergenceError: learning and correcting with all anchors did not settle; a fold carries its own `settled`.
    """
    assert_float64()
    chain = chain_of(trajectory)
    table = anchor_table(anchors, chain, settings.extra_sigma_m)
    rows = np.zeros((anchor_bucket(1 + len(use)) if len(use) else 1, table.real.shape[0]))
    rows[:, : len(anchors)] = 1.0
    rows[1 : 1 + len(use), : len(anchors)] = use
    width = jnp.asarray(settings.loss_width)
    found, first = learn_folds(
        chain, table, prior_arrays(learn.family), jnp.asarray(rows), width, learn_options(settings, learn)
    )
    found = jax.tree.map(np.asarray, found)
    whole = jax.tree.map(lambda x: x[0], found)
    if not bool(whole.fold.settled):
        raise ConvergenceError(
            f"learning the odometry noise did not settle: after {int(whole.fold.rounds)} rounds a marker still moved. "
            "Check for wrong anchors (anchors.loss: cauchy tolerates some), or correct with noise.mode: fixed."
        )
    correction = ensemble_correction(trajectory, chain, first)
    calibration = summarise(whole, learn.family, learn.kind, learn.observations, anchors)
    return calibration, correction, jax.tree.map(lambda x: x[: 1 + len(use)], found)
