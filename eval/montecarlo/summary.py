"""What a study says, a row a regime: how near learned noise comes to true noise, with intervals."""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from eval.bootstrap import bootstrap_interval, mean, ratio_of_means
from eval.montecarlo.batch import STAGES
from eval.montecarlo.records import IDENTIFIABLE_LOG_SD, SIGMAS, Records, bias_weight
from eval.montecarlo.settings import StudySettings
from eval.uncertainty import CalibrationRow, pooled_calibration
from jaxgeo.export.held_out_stats import mean_or_nan
from jaxgeo.export.result import HeldOut

WHITE = ("trans_m_per_sqrt_m", "rot_rad_per_sqrt_m")
# Within this factor of the truth a sigma counts as found.
FOLD = 1.5


@dataclasses.dataclass(frozen=True)
class SigmaRow:
    """How one learned sigma lies to the true one over a regime's sessions.

    Attributes:
        component: one of `records.SIGMAS`.
        median, low, high: of learned over true; the 5 and 95 % quantiles.
        within: share within `FOLD`; `within_identifiable` the same where the estimate itself claims as much, NaN where
            it nowhere does; `identifiable` the share of sessions where it does.
        coverage_68, coverage_95: share of sessions whose interval holds the truth.
    """

    component: str
    n: int
    median: float
    low: float
    high: float
    within: float
    within_identifiable: float
    identifiable: float
    coverage_68: float
    coverage_95: float


@dataclasses.dataclass(frozen=True)
class RegimeRow:
    """One regime.

    Attributes:
        n: sessions in the means; `n_failed` are in none of them: a fold not determined or not converged.
        error_mean_m: {stage: mean held-out error over sessions and visits}, `error_interval_m` its 95 % interval.
        ratio: {stage: mean error over that with the true noise}, `ratio_interval` its 95 % interval over sessions.
        uncertainty: {stage: were the predicted covariances right}.
        sigmas: of every component that the regime's odometry has.
        stuck_share: sessions (of all) in which learning ran away from its prior or did not converge in some fold.
        bias_weight: mean weight of the models with a constant bias.
    """

    regime: str
    words: str
    n: int
    n_failed: int
    error_mean_m: dict[str, float]
    error_interval_m: dict[str, tuple[float, float]]
    ratio: dict[str, float]
    ratio_interval: dict[str, tuple[float, float]]
    uncertainty: dict[str, CalibrationRow]
    sigmas: tuple[SigmaRow, ...]
    stuck_share: float
    bias_weight: float


def session_error_m(records: Records) -> Float[np.ndarray, "n s"]:
    """Mean held-out error of every session by stage, over its visits."""
    return np.linalg.norm(records.error_m, axis=-1).mean(axis=-1)


def regime_rows(records: Records, settings: StudySettings) -> tuple[RegimeRow, ...]:
    """A row for every regime that has sessions, in the study's order."""
    rows = []
    for place, regime in enumerate(settings.regimes):
        own = records.take(np.flatnonzero(records.regime == place))
        if len(own):
            rows.append(_regime_row(regime.name, regime.words, own, settings.seed))
    return tuple(rows)


def _regime_row(name: str, words: str, every: Records, seed: int) -> RegimeRow:
    records = every.take(np.flatnonzero(~every.failed))
    error_m = session_error_m(records)
    by_stage = dict(zip(STAGES, error_m.T, strict=True))
    others = [stage for stage in STAGES if stage != "true"]
    nothing = (float("nan"), float("nan"))
    known = len(records) > 0
    return RegimeRow(
        regime=name,
        words=words,
        n=len(records),
        n_failed=len(every) - len(records),
        error_mean_m={stage: mean_or_nan(values) for stage, values in by_stage.items()},
        error_interval_m={
            stage: bootstrap_interval(values, mean, seed=seed) if known else nothing
            for stage, values in by_stage.items()
        },
        ratio={s: mean_or_nan(by_stage[s]) / mean_or_nan(by_stage["true"]) for s in others},
        ratio_interval={
            s: bootstrap_interval(np.stack([by_stage[s], by_stage["true"]], axis=1), ratio_of_means, seed=seed)
            if known
            else nothing
            for s in others
        },
        uncertainty={stage: _uncertainty(stage, records) for stage in STAGES if stage != "similarity"},
        sigmas=tuple(_sigma_row(i, records) for i in range(len(SIGMAS)) if (every.true_sigma[:, i] > 0).all()),
        stuck_share=float(every.stuck.mean()),
        bias_weight=mean_or_nan(bias_weight(records)),
    )


def _uncertainty(stage: str, records: Records) -> CalibrationRow:
    i = STAGES.index(stage)
    words = ("converged",) * records.error_m.shape[2]
    return pooled_calibration(
        stage,
        [
            ([str(x) for x in location], HeldOut(error, covariance, words))
            for location, error, covariance in zip(
                records.location, records.error_m[:, i], records.covariance_m2[:, i], strict=True
            )
        ],
    )


def sigma_ratio(records: Records, component: str) -> Float[np.ndarray, "n"]:
    """Learned (median) over true sigma of every session."""
    i = SIGMAS.index(component)
    return records.sigma[:, i, 0] / records.true_sigma[:, i]


def identifiable(records: Records, component: str) -> Bool[np.ndarray, "n"]:
    """Sessions whose own estimate claims to know the sigma by a factor of 1.5."""
    return records.sigma[:, SIGMAS.index(component), 5] < IDENTIFIABLE_LOG_SD


def within(records: Records, component: str) -> Bool[np.ndarray, "n"]:
    """Sessions whose learned sigma is within `FOLD` of the true one."""
    return np.abs(np.log(sigma_ratio(records, component))) < np.log(FOLD)


def _sigma_row(index: int, records: Records) -> SigmaRow:
    component = SIGMAS[index]
    ratio, near, claimed = (f(records, component) for f in (sigma_ratio, within, identifiable))
    low, high = np.quantile(ratio, [0.05, 0.95]) if len(ratio) else (float("nan"), float("nan"))
    return SigmaRow(
        component=component,
        n=len(ratio),
        median=float(np.median(ratio)) if len(ratio) else float("nan"),
        low=float(low),
        high=float(high),
        within=mean_or_nan(near),
        within_identifiable=mean_or_nan(near[claimed]),
        identifiable=mean_or_nan(claimed),
        coverage_68=mean_or_nan(covered(records, component, 68)),
        coverage_95=mean_or_nan(covered(records, component, 95)),
    )


def covered(records: Records, component: str, percent: int) -> Bool[np.ndarray, "n"]:
    """Sessions whose 68 or 95 % interval of the sigma holds the truth."""
    i = SIGMAS.index(component)
    low = {68: 1, 95: 3}[percent]
    true = records.true_sigma[:, i]
    return (records.sigma[:, i, low] <= true) & (true <= records.sigma[:, i, low + 1])


def summary_dict(rows: tuple[RegimeRow, ...], records: Records, settings: StudySettings) -> dict[str, Any]:
    """All rows as `summary.json` has them."""
    return {
        "simulated": True,
        "draws": len(records),
        "failed": int(records.failed.sum()),
        "stuck": int(records.stuck.sum()),
        "regimes": {row.regime: dataclasses.asdict(row) for row in rows},
        "settings": settings.as_dict(),
    }
