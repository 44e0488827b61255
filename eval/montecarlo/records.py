"""What is kept of every session, as plain arrays: small enough for thousands, and enough for every figure."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from calibration.fit import ModelFit
from calibration.learn import Learned
from calibration.models import MODELS, FamilyPrior
from calibration.reml import Prior
from calibration.summary import GROUPS, sigma_estimates
from eval.montecarlo.batch import SessionOutcome
from eval.montecarlo.regimes import Regime
from eval.montecarlo.sessions import SessionArrays
from jaxgeo.graph.components import ANCHOR, COMPONENTS, N_COMPONENTS

# Identifiable: the estimate claims to know log sigma to this standard deviation or better, a factor of 1.5.
IDENTIFIABLE_LOG_SD = float(np.log(1.5))
# At a bound: the estimate lies this many prior standard deviations from the prior's median.
BOUND_SD = 4.0
# The anchors' own noise is not learned here; the last are geometric means of three axes.
SIGMAS: tuple[str, ...] = (*(c for i, c in enumerate(COMPONENTS) if i != ANCHOR), *GROUPS)
_PICK = np.array(
    [np.eye(N_COMPONENTS)[COMPONENTS.index(name)] for name in SIGMAS[: -len(GROUPS)]]
    + [np.isin(np.arange(N_COMPONENTS), np.arange(N_COMPONENTS)[g]) / 3.0 for g in GROUPS.values()]
)


@dataclasses.dataclass(frozen=True)
class Records:
    """Sessions on the leading axis n; stages as in `batch.STAGES`, k visits, f folds of which the first has all.

    Attributes:
        session, seed, regime: numbers; `regime` is the place in the study's order.
        location: (n, k) of every visit.
        error_m, covariance_m2: held out, as in `SessionOutcome`.
        good: (n, stages, f).
        sigma: (n, sigmas, 6) learned from all anchors, in the order of `SIGMAS`: median, low and high 68 %, low and
            high 95 %, standard deviation of log sigma.
        true_sigma: (n, sigmas) per metre of the odometry's own way; 0 where the session has no such error.
        model_weight: (n, models).
        rounds: (n, f) of learning and moving.
        stuck: (n,) whether learning ran away from its prior or did not converge, in any fold.
    """

    session: Int[np.ndarray, "n"]
    seed: Int[np.ndarray, "n"]
    regime: Int[np.ndarray, "n"]
    location: Int[np.ndarray, "n k"]
    error_m: Float[np.ndarray, "n s k 3"]
    covariance_m2: Float[np.ndarray, "n s k 3 3"]
    good: Bool[np.ndarray, "n s f"]
    sigma: Float[np.ndarray, "n c 6"]
    true_sigma: Float[np.ndarray, "n c"]
    model_weight: Float[np.ndarray, "n m"]
    rounds: Int[np.ndarray, "n f"]
    stuck: Bool[np.ndarray, "n"]

    def __len__(self) -> int:
        return len(self.session)

    @property
    def failed(self) -> Bool[np.ndarray, "n"]:
        """Sessions with a fold that is not determined or did not converge, at any stage: in no mean."""
        good = self.good.all(axis=(1, 2)) & np.isfinite(self.error_m).all(axis=(1, 2, 3))
        return np.asarray(~good)

    def take(self, index: np.ndarray) -> "Records":
        return Records(**{field.name: getattr(self, field.name)[index] for field in dataclasses.fields(self)})


def together(parts: Sequence[Records]) -> Records:
    """One after the other."""
    names = [field.name for field in dataclasses.fields(Records)]
    return Records(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def record(
    session: int, seed: int, place: int, regime: Regime, arrays: SessionArrays, outcome: SessionOutcome
) -> Records:
    """One session's row, from what went into the program and what came out of it (NumPy arrays)."""
    k = int(np.asarray(arrays.table.real).sum())
    family = regime.learn.family
    posterior = outcome.posterior
    sigmas = {s.component: s for s in sigma_estimates(_learned(outcome, family), family)}
    learned = [
        [s.median, s.low_68, s.high_68, s.low_95, s.high_95, s.log_sd] for s in (sigmas[name] for name in SIGMAS)
    ]
    true = np.asarray(arrays.true.sigma)[0]
    with np.errstate(divide="ignore"):  # the logarithm of a noise that is not there
        log_true = np.where(_PICK > 0, np.log(true)[None], 0.0)
    row = dict(
        session=np.array(session),
        seed=np.array(seed),
        regime=np.array(place),
        location=np.asarray(arrays.table.location)[:k],
        error_m=outcome.error_m[:, :k],
        covariance_m2=outcome.covariance_m2[:, :k],
        good=outcome.good,
        sigma=np.array(learned),
        true_sigma=np.exp((_PICK * log_true).sum(axis=1)),
        model_weight=posterior.weight[0],
        rounds=posterior.rounds,
        stuck=np.array(stuck(outcome, family)),
    )
    return Records(**{name: np.asarray(value)[None] for name, value in row.items()})


def _learned(outcome: SessionOutcome, family: FamilyPrior) -> Learned:
    """The posterior from all anchors in the form that `calibration.summary` reads."""
    first = jax.tree.map(lambda x: np.asarray(x)[0], outcome.posterior)
    nothing: Any = np.zeros(())
    mean, precision, free = _as_is(np.broadcast_to(first.mean, family.free.shape), family.precision, family.free)
    fit = ModelFit(
        theta=first.theta,
        covariance=outcome.theta_covariance,
        log_evidence=nothing,
        log_predictive=nothing,
        draws=nothing,
        log_weight=nothing,
        converged=first.converged,
    )
    unread: Any = None
    return Learned(unread, fit, first.weight, unread, Prior(mean, precision, free))


def _as_is(*arrays: Any) -> tuple[Any, ...]:
    """NumPy arrays where a type says JAX array: `summary` reads either."""
    return arrays


def stuck(outcome: SessionOutcome, family: FamilyPrior) -> bool:
    """Whether any fold did not settle, or its heaviest model did not converge or ran away from its prior."""
    posterior = outcome.posterior
    folds = np.arange(len(posterior.weight))
    best = np.argmax(posterior.weight, axis=1)
    away = np.abs(posterior.theta[folds, best] - posterior.mean) / np.sqrt(np.diag(family.covariance))
    away = away * (family.free[best] > 0)
    settled = outcome.good[2] & posterior.converged[folds, best]
    return bool(np.any(~settled) or np.any(away > BOUND_SD))


def bias_weight(records: Records) -> Float[np.ndarray, "n"]:
    """Weight of the models with a constant bias."""
    return records.model_weight[:, ["bias" in name for name in MODELS]].sum(axis=1)
