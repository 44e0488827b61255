"""Held-out errors with corrections: in every fold estimated anew, from the visits of the other locations alone."""

import dataclasses
from collections.abc import Callable, Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from calibration.calibrate import LearnSettings, learn_options
from calibration.corrections import CorrectionEstimate, estimate_corrections
from calibration.corrections_problem import corrected_anchors
from calibration.learn import learn_folds, prior_arrays
from jaxgeo.data import Anchors, Sightings, Survey, Trajectory, Visit
from jaxgeo.errors import ConvergenceError
from jaxgeo.graph.anchor_table import anchor_table
from jaxgeo.graph.chain import chain_of
from jaxgeo.solve.correct import Settings
from jaxgeo.solve.corrections import CorrectionPrior


@dataclasses.dataclass(frozen=True)
class CorrectedFolds:
    """What the fold without a visit's location predicts for the visit, noise learned and corrections made in that fold.

    Attributes:
        label, location: of the visits, in the order given.
        error_m: (k, 3) predicted minus surveyed position of the marker, local frame; NaN where a fold did not settle.
        covariance_m2: (k, 3, 3) of that error.
        settled: (k,) of the visit's fold.
        estimates: of the folds, by the location held out; a fold whose corrections did not settle has none.
    """

    label: tuple[str, ...]
    location: tuple[str, ...]
    error_m: Float[np.ndarray, "k 3"]
    covariance_m2: Float[np.ndarray, "k 3 3"]
    settled: Bool[np.ndarray, "k"]
    estimates: dict[str, CorrectionEstimate]


def hold_out_with_corrections(
    trajectory: Trajectory,
    sightings: Sightings,
    visits: Sequence[Visit],
    survey: Survey,
    *,
    origin_enh_m: Float[np.ndarray, "3"],
    settings: Settings,
    learn: LearnSettings,
    prior: CorrectionPrior,
    done: Callable[[], None] = lambda: None,
) -> CorrectedFolds:
    """Hold out each location in turn; `done` is called after every fold.

    Only visits of the other locations enter the corrections; the held-out ones are then moved by them too, for one
    clock and one camera saw them all, and are predicted.

    Raises:
        SightingError: as `make_anchors`.
    """
    k = len(visits)
    row = {visit.label: i for i, visit in enumerate(visits)}
    error, covariance = np.full((k, 3), np.nan), np.full((k, 3, 3), np.nan)
    settled, estimates = np.zeros(k, dtype=bool), {}
    for location in dict.fromkeys(visit.location for visit in visits):
        train = [visit for visit in visits if visit.location != location]
        try:
            found = estimate_corrections(
                trajectory,
                sightings,
                train,
                survey,
                origin_enh_m=origin_enh_m,
                settings=settings,
                learn=learn,
                prior=prior,
            )
        except ConvergenceError:
            done()
            continue
        estimates[location] = found
        anchors, _ = corrected_anchors(trajectory, sightings, visits, survey, found.value, origin_enh_m=origin_enh_m)
        point, own, ok = _predicted(trajectory, anchors, location, settings, learn)
        for i, label in enumerate(anchors.label):
            if anchors.location[i] == location:
                at = row[label]
                settled[at] = ok
                if ok:
                    error[at], covariance[at] = point[i] - anchors.surveyed_enh_m[i], own[i]
        done()
    labels, locations = tuple(v.label for v in visits), tuple(v.location for v in visits)
    return CorrectedFolds(labels, locations, error, covariance, settled, estimates)


def _predicted(
    trajectory: Trajectory, anchors: Anchors, held_out: str, settings: Settings, learn: LearnSettings
) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3 3"], bool]:
    """Every marker's position, its error's covariance, and whether learning settled, without one location."""
    chain = chain_of(trajectory)
    table = anchor_table(anchors, chain, settings.extra_sigma_m)
    use = np.zeros(table.real.shape[0])
    use[: len(anchors)] = [name != held_out for name in anchors.location]
    found, _ = learn_folds(
        chain,
        table,
        prior_arrays(learn.family),
        jnp.asarray(use)[None],
        jnp.asarray(settings.loss_width),
        learn_options(settings, learn),
    )
    fold = found.fold
    return np.asarray(fold.point_m[0]), np.asarray(fold.error_covariance_m2[0]), bool(fold.settled[0])
