"""Was the predicted covariance right? Over many folds or trajectories: normalised errors, coverage, predicted RMS."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from jaxgeo.export.held_out_stats import chi_square_quantile, held_out_stats, mean_or_nan, normalised_squared_errors
from jaxgeo.export.result import HeldOut


@dataclasses.dataclass(frozen=True)
class CalibrationRow:
    """Predicted against achieved errors of one way of estimating.

    Attributes:
        name: what was judged.
        n: errors with a usable covariance; only they are in the figures below. `n_failed` have no error.
        n_groups: groups with such an error. Errors of one group share what they are measured against.
        nees_mean: mean of e^T P^-1 e over groups, each group's errors averaged first; 3 if P is right.
        nees_band: 95 % band of `nees_mean` for a right P and independent groups. The folds of one session share its
            odometry: over few sessions the true band is wider.
        coverage_50, coverage_95: share of errors inside their own ellipsoid of that probability.
        predicted_rms_m: root of the mean trace of P.
        achieved_rms_m: root mean square length of the same errors.
    """

    name: str
    n: int
    n_failed: int
    n_groups: int
    nees_mean: float
    nees_band: tuple[float, float]
    coverage_50: float
    coverage_95: float
    predicted_rms_m: float
    achieved_rms_m: float

    @property
    def achieved_over_predicted(self) -> float:
        """Above 1: the errors are larger than predicted."""
        return self.achieved_rms_m / self.predicted_rms_m


def calibration_row(name: str, group: Sequence[str], held_out: HeldOut) -> CalibrationRow:
    """Of the errors of one session's folds; `group` names the location of every visit."""
    stats = held_out_stats(tuple(group), held_out)
    usable = np.isfinite(stats.nees)
    trace_m2 = np.trace(held_out.covariance_m2[usable], axis1=1, axis2=2)
    return CalibrationRow(
        name=name,
        n=stats.n_covariance,
        n_failed=stats.n_failed,
        n_groups=len({each for each, ok in zip(group, usable, strict=True) if ok}),
        nees_mean=stats.nees_mean,
        nees_band=stats.nees_band,
        coverage_50=stats.coverage_50,
        coverage_95=stats.coverage_95,
        predicted_rms_m=float(np.sqrt(mean_or_nan(trace_m2))),
        achieved_rms_m=float(np.sqrt(mean_or_nan(stats.norm_m[usable] ** 2))),
    )


def pooled_calibration(name: str, sessions: Sequence[tuple[Sequence[str], HeldOut]]) -> CalibrationRow:
    """Of several sessions or trajectories together, each as (location of every visit, its held-out errors).

    A location of one session and the same of another are two groups.
    """
    group = [f"{i}/{location}" for i, (locations, _) in enumerate(sessions) for location in locations]
    if not group:
        return calibration_row(name, (), HeldOut(np.zeros((0, 3)), np.zeros((0, 3, 3)), ()))
    together = HeldOut(
        np.concatenate([held_out.error_enh_m for _, held_out in sessions]),
        np.concatenate([held_out.covariance_m2 for _, held_out in sessions]),
        tuple(words for _, held_out in sessions for words in held_out.result),
    )
    return calibration_row(name, group, together)


def inside_ellipsoid(
    error_m: Float[np.ndarray, "*batch 3"], covariance_m2: Float[np.ndarray, "*batch 3 3"], probability: float = 0.95
) -> Float[np.ndarray, "*batch"]:
    """1 where an error lies inside its own ellipsoid of that probability, 0 where outside, NaN where there is none."""
    nees = normalised_squared_errors(error_m.reshape(-1, 3), covariance_m2.reshape(-1, 3, 3))
    inside = np.where(np.isnan(nees), np.nan, nees <= chi_square_quantile(probability, 3))
    return inside.reshape(error_m.shape[:-1])
