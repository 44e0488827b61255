"""Corrections of clock, lever arm and camera rotation within a run: estimated, said, and made where they can be."""

import dataclasses
from typing import Any

import numpy as np

from calibration.calibrate import LearnSettings
from calibration.corrections import estimate_corrections
from calibration.corrections_folds import CorrectedFolds, hold_out_with_corrections
from calibration.corrections_problem import corrected_anchors
from calibration.corrections_words import Corrections, corrections_of
from calibration.result import Calibration
from eval.loo import EnsembleHeldOut, LeaveOneOut, learn_and_hold_out
from jaxgeo.cli.ingest import Ingested
from jaxgeo.config.corrections import CorrectionsInput
from jaxgeo.config.schema import SessionConfig
from jaxgeo.data import Anchors, Trajectory
from jaxgeo.errors import SightingError
from jaxgeo.export.result import HeldOut
from jaxgeo.solve.correct import Settings
from jaxgeo.solve.corrections import CorrectionPrior
from jaxgeo.solve.ensemble_correct import EnsembleCorrection

IN_FOLDS = (
    "Corrected: the written trajectory, and 'learned' among the held-out errors, where the corrections were estimated "
    "anew in every fold from the other locations alone. The similarity and the fixed noise have the sightings as they "
    "were recorded."
)


def as_recorded(config: SessionConfig, command: str) -> tuple[str, ...]:
    """A warning of commands that take the sightings as they were recorded; none where no correction is asked for."""
    if config.corrections is None:
        return ()
    return (
        f"'corrections' are made by 'jaxgeo run' and 'jaxgeo campaign': {command} takes the sightings as recorded.",
    )


@dataclasses.dataclass(frozen=True)
class SessionCorrections:
    """Of one trajectory.

    Attributes:
        asked: of the config; `found` what is reported of the estimate.
        anchors: the visits with the corrections made; None where they are not applied, `said` then says why.
        warnings: of making those anchors.
    """

    asked: CorrectionsInput
    found: Corrections
    anchors: Anchors | None
    said: str
    warnings: tuple[str, ...]

    def facts(self) -> dict[str, Any]:
        """For metrics.json and the report."""
        return {
            "applied": self.anchors is not None,
            "rows": [dataclasses.asdict(row) for row in self.found.rows],
            "visits": self.found.visits,
            "sightings": self.found.sightings,
            "rival_s": self.found.rival_s,
            "sentences": [*(row.sentence for row in self.found.rows), self.said],
        }


def estimated(
    asked: CorrectionsInput,
    trajectory: Trajectory,
    recorded: Anchors,
    data: Ingested,
    settings: Settings,
    learn: LearnSettings,
) -> SessionCorrections:
    """Estimate what the config asks for from all visits; `recorded` are the anchors without.

    Raises:
        SightingError: no sighting can be used.
        ConvergenceError: the corrections did not settle.
    """
    origin = np.asarray(data.frame.origin_enh_m)
    estimate = estimate_corrections(
        trajectory,
        data.sightings,
        data.visits,
        data.survey,
        origin_enh_m=origin,
        settings=settings,
        learn=learn,
        prior=CorrectionPrior(*asked.widths),
    )
    found = corrections_of(estimate)
    if not asked.apply:
        return SessionCorrections(asked, found, None, "Not applied: corrections.apply is false.", ())
    if not found.any_observable:
        said = "Not applied: none of them is observable."
        return SessionCorrections(asked, found, None, said, ())
    try:
        anchors, warnings = corrected_anchors(
            trajectory, data.sightings, data.visits, data.survey, estimate.value, origin_enh_m=origin
        )
    except SightingError as error:
        said = f"Not applied, for with their stamps corrected {error}"
        return SessionCorrections(asked, found, None, said, ())
    if anchors.label != recorded.label:
        lost = ", ".join(label for label in recorded.label if label not in anchors.label)
        said = f"Not applied: with their stamps corrected the visits {lost} would lie outside the trajectory's time."
        return SessionCorrections(asked, found, None, said, ())
    return SessionCorrections(asked, found, anchors, IN_FOLDS, warnings)


def learn_corrected(
    made: SessionCorrections,
    trajectory: Trajectory,
    data: Ingested,
    settings: Settings,
    learn: LearnSettings,
    fixed: LeaveOneOut | None,
) -> tuple[Calibration, EnsembleCorrection, EnsembleHeldOut | None]:
    """As `eval.loo.learn_and_hold_out` with the corrected anchors; `fixed` says which folds are determined.

    Raises:
        ConvergenceError: learning with all anchors did not settle.
    """
    assert made.anchors is not None
    calibration, correction, _ = learn_and_hold_out(trajectory, made.anchors, settings, learn, None)
    if fixed is None:
        return calibration, correction, None
    folds = hold_out_with_corrections(
        trajectory,
        data.sightings,
        data.visits,
        data.survey,
        origin_enh_m=np.asarray(data.frame.origin_enh_m),
        settings=settings,
        learn=learn,
        prior=CorrectionPrior(*made.asked.widths),
    )
    return calibration, correction, _held_out(folds, made.anchors, fixed)


def _held_out(folds: CorrectedFolds, anchors: Anchors, fixed: LeaveOneOut) -> EnsembleHeldOut:
    row = {label: i for i, label in enumerate(folds.label)}
    index = np.array([row[label] for label in anchors.label])
    good = folds.settled[index] & fixed.determined
    error = np.where(good[:, None], folds.error_m[index], np.nan)
    covariance = np.where(good[:, None, None], folds.covariance_m2[index], np.nan)
    result = [
        "converged"
        if good[i]
        else fixed.refined.result[i]
        if not fixed.determined[i]
        else "not settled"
        if anchors.location[i] in folds.estimates
        else "the corrections did not settle"
        for i in range(len(anchors))
    ]
    return EnsembleHeldOut(HeldOut(error, covariance, tuple(result)), error + anchors.surveyed_enh_m)
