"""From arrays to what can be read: quantiles of every sigma, the models' table, and what the data cannot tell."""

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq
from scipy.stats import norm

from calibration.learn import LEARNING_ROUNDS, Learned, noise_held
from calibration.models import MODELS, FamilyPrior
from calibration.result import Calibration, ModelEstimate, SigmaEstimate
from calibration.sentences import sentences
from jaxgeo.data import Anchors
from jaxgeo.graph.components import COMPONENTS, N_COMPONENTS, ROT, TRANS

# Geometric means of three axes, reported beside the single axes.
GROUPS: dict[str, slice] = {"trans_m_per_sqrt_m": TRANS, "rot_rad_per_sqrt_m": ROT}


def summarise(learned: Learned, prior: FamilyPrior, kind: str, observations: str, anchors: Anchors) -> Calibration:
    """Gather one fold's learned noise (NumPy arrays)."""
    weight = np.asarray(learned.model_weight)
    mean, covariance = model_moments(learned)
    sigmas = sigma_estimates(learned, prior)
    estimates = sorted(
        (_model(learned, i, name, weight) for i, name in enumerate(MODELS)), key=lambda m: m.weight, reverse=True
    )
    theta_mean, theta_covariance = _over_models(learned, prior, weight, mean, covariance)
    n_revisits = len(anchors) - len(set(anchors.location))
    n_contrasts = round(float(learned.found.count))
    said = sentences(sigmas, n_contrasts, n_revisits, observations, anchors)
    return Calibration(
        kind=kind,
        observations=observations,
        models=tuple(estimates),
        sigmas=sigmas,
        ensemble=learned.fold.ensemble,
        theta_mean=theta_mean,
        theta_covariance=theta_covariance,
        n_contrasts=n_contrasts,
        n_revisits=n_revisits,
        sentences=(*_held(int(learned.fold.rounds)), *said),
        rounds=int(learned.fold.rounds),
        settled=bool(learned.fold.settled),
    )


def _held(rounds: int) -> tuple[str, ...]:
    if not noise_held(rounds):
        return ()
    return (
        f"Noise and trajectory did not settle together in {LEARNING_ROUNDS} rounds: the noise is that of the last of "
        "them, and another answer fits almost as well.",
    )


def model_moments(learned: Learned) -> tuple[Float[np.ndarray, "models n"], Float[np.ndarray, "models n n"]]:
    """Laplace mean and covariance of every model's log sigmas.

    The weighted draws' moments would lie lower: where translation and rotation noise can stand for each other, each has
    a long tail towards zero. On simulated sessions the optimum is the better centred estimate.
    """
    theta, covariance = np.asarray(learned.fit.theta), np.asarray(learned.fit.covariance)
    # A model that was not found has no weight, but it may hold NaN, and 0 x NaN is NaN.
    found = np.asarray(learned.fit.converged)
    prior = learned.prior
    masked = prior.precision + np.eye(N_COMPONENTS) * (1.0 - np.asarray(prior.free))[:, None]
    width = np.linalg.inv(masked) * np.asarray(prior.free)[:, :, None] * np.asarray(prior.free)[:, None]
    return (
        np.where(found[:, None], theta, np.asarray(prior.mean)),
        np.where(found[:, None, None], covariance, width),
    )


def _prior_mean(learned: Learned) -> Float[np.ndarray, "n"]:
    return np.asarray(learned.prior.mean)[0]


def sigma_estimates(learned: Learned, prior: FamilyPrior) -> tuple[SigmaEstimate, ...]:
    """Every component's posterior over the models, and those of `GROUPS`; fold and contrasts are not read."""
    weight = np.asarray(learned.model_weight)
    mean, covariance = model_moments(learned)
    prior_mean = _prior_mean(learned)
    out = []
    picks = {name: np.eye(N_COMPONENTS)[i] for i, name in enumerate(COMPONENTS)}
    for name, members in GROUPS.items():
        picks[name] = np.zeros(N_COMPONENTS)
        picks[name][members] = 1.0 / 3.0
    for name, pick in picks.items():
        has = np.all(prior.free[:, pick > 0] > 0, axis=1)
        total = float(weight[has].sum())
        if not has.any():
            continue
        # A component that only impossible models have: any of them says the same, that it was not learned.
        share = weight[has] / total if total > 1e-12 else np.full(int(has.sum()), 1.0 / has.sum())
        centre = mean[has] @ pick
        spread = np.sqrt(np.maximum(np.einsum("a,mab,b->m", pick, covariance[has], pick), 1e-12))
        quantile = [_mixture_quantile(p, share, centre, spread) for p in (0.5, 0.16, 0.84, 0.025, 0.975)]
        middle = share @ centre
        log_sd = np.sqrt(share @ (spread**2 + (centre - middle) ** 2))
        out.append(
            SigmaEstimate(
                name,
                *(float(np.exp(q)) for q in quantile),
                log_sd=float(log_sd),
                prior_median=float(np.exp(prior_mean @ pick)),
                prior_log_sd=float(np.sqrt(pick @ prior.covariance @ pick)),
                probability=total,
            )
        )
    return tuple(out)


def _mixture_quantile(p: float, share: np.ndarray, centre: np.ndarray, spread: np.ndarray) -> float:
    low, high = np.min(centre - 9 * spread), np.max(centre + 9 * spread)
    root = brentq(lambda x: share @ norm.cdf((x - centre) / spread) - p, low, high, full_output=False)
    return float(root)  # type: ignore[arg-type]


def _model(learned: Learned, index: int, name: str, weight: Float[np.ndarray, "models"]) -> ModelEstimate:
    free = np.asarray(learned.prior.free)[index] > 0
    covariance = np.asarray(learned.fit.covariance)[index][np.ix_(free, free)]
    sd = np.sqrt(np.diag(covariance))
    evidence, predictive = np.asarray(learned.fit.log_evidence), np.asarray(learned.fit.log_predictive)
    return ModelEstimate(
        name=name,
        weight=float(weight[index]),
        log_evidence=float(evidence[index] - np.nanmax(evidence)),
        log_predictive=float(predictive[index] - np.nanmax(predictive)),
        components=tuple(c for c, has in zip(COMPONENTS, free, strict=True) if has),
        sigma=np.exp(np.asarray(learned.fit.theta)[index][free]),
        log_sd=sd,
        correlation=covariance / np.outer(sd, sd),
        converged=bool(np.asarray(learned.fit.converged)[index]),
    )


def _over_models(
    learned: Learned,
    prior: FamilyPrior,
    weight: Float[np.ndarray, "models"],
    mean: Float[np.ndarray, "models n"],
    covariance: Float[np.ndarray, "models n n"],
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n n"]]:
    """Moments of all components over the models; a model that does not have one says of it what the prior says.

    Given a model's own components the others follow the prior's conditional normal.
    """
    prior_mean, full = _prior_mean(learned), prior.covariance
    means, covariances = [], []
    for has, own_mean, own_covariance in zip(prior.free > 0, mean, covariance, strict=True):
        gain = np.zeros((N_COMPONENTS, N_COMPONENTS))
        gain[:, has] = full[:, has] @ np.linalg.inv(full[np.ix_(has, has)])
        gain[np.ix_(has, has)] = np.eye(int(has.sum()))
        rest = full - gain @ full
        rest[has], rest[:, has] = 0.0, 0.0
        means.append(prior_mean + gain @ np.where(has, own_mean - prior_mean, 0.0))
        covariances.append(gain @ own_covariance @ gain.T + rest)
    stacked = np.array(means)
    middle = weight @ stacked
    off = stacked - middle
    return middle, np.einsum("m,mab->ab", weight, np.array(covariances) + off[:, :, None] * off[:, None, :])
