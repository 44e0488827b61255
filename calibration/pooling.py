"""The noise of one platform, learned over its sessions: a normal population of log sigmas (partial pooling).

    theta_s ~ N(mu, T)            log sigmas of session s; what its data say of them: `SessionEvidence`
    mu ~ N(m, C),  T about T_0    m, C: the documented prior of the kind of odometry; T_0 = `BETWEEN_SHARE`^2 C

mu and T are found by expectation and maximisation (Dempster, Laird and Rubin 1977): given both, every session's theta
has a normal posterior; given those, mu is a weighted mean, and T the mean of what the sessions differ by and of their
own widths, with `T_0` counted as `BETWEEN_SESSIONS` sessions more: few sessions cannot say that all are alike. The
prior of a session yet to come is N(mu, T + Var(mu)).
"""

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Float

from calibration.result import ModelEstimate
from jaxgeo.graph.components import COMPONENTS, N_COMPONENTS

# Standard deviation of log sigma between sessions of one platform, in that between platforms of one kind, before any
# session is seen: 0.5 for what all white sigmas have in common. Counted as so many sessions.
BETWEEN_SHARE = 0.25
BETWEEN_SESSIONS = 4.0
# What a session says is taken as normal; no further than so many prior standard deviations, where that may hold.
FARTHEST = 3.0
MAX_ROUNDS = 500
SETTLED = 1e-4


@dataclasses.dataclass(frozen=True)
class SessionEvidence:
    """The likelihood of one session's log sigmas as a normal: exp(-1/2 theta' precision theta + linear' theta).

    Attributes:
        precision, linear: (n, n), (n,) what the data say, without any prior; zero where they say nothing.
        prior_mean: (n,) that the session's own learning started from.
    """

    precision: Float[np.ndarray, "n n"]
    linear: Float[np.ndarray, "n"]
    prior_mean: Float[np.ndarray, "n"]


@dataclasses.dataclass(frozen=True)
class Population:
    """Log sigmas of a platform's sessions.

    Attributes:
        mean: (n,) of the population; `mean_covariance` (n, n) how well it is known.
        between: (n, n) covariance of the sessions about it.
        n_sessions: learned from; `rounds` of expectation and maximisation.
        settled: False where they ran out.
    """

    mean: Float[np.ndarray, "n"]
    mean_covariance: Float[np.ndarray, "n n"]
    between: Float[np.ndarray, "n n"]
    n_sessions: int
    rounds: int
    settled: bool

    @property
    def predictive_covariance(self) -> Float[np.ndarray, "n n"]:
        """Of the log sigmas of a session yet to come."""
        return self.between + self.mean_covariance


def session_evidence(
    models: Sequence[ModelEstimate], prior_mean: Float[np.ndarray, "n"], prior_covariance: Float[np.ndarray, "n n"]
) -> SessionEvidence:
    """A session's likelihood from its posterior: the prior divided out of every model, the models by their weights.

    The logarithms of the models' likelihoods are averaged (the expectation over which model holds); of a component
    that a model does not have it says nothing.
    """
    precision, linear = np.zeros((N_COMPONENTS, N_COMPONENTS)), np.zeros(N_COMPONENTS)
    for model in models:
        if not model.converged or model.weight <= 0.0:
            continue
        own = [COMPONENTS.index(name) for name in model.components]
        block = np.ix_(own, own)
        covariance = np.asarray(model.correlation) * np.outer(model.log_sd, model.log_sd)
        found = _divided(np.log(model.sigma), covariance, prior_mean[own], prior_covariance[block])
        precision[block] += model.weight * found[0]
        linear[own] += model.weight * found[1]
    return SessionEvidence(precision, linear, prior_mean)


def _divided(
    mean: Float[np.ndarray, "c"],
    covariance: Float[np.ndarray, "c c"],
    prior_mean: Float[np.ndarray, "c"],
    prior_covariance: Float[np.ndarray, "c c"],
) -> tuple[Float[np.ndarray, "c c"], Float[np.ndarray, "c"]]:
    """Posterior over prior, in directions in which the posterior is the narrower one; the others say nothing."""
    root = np.linalg.cholesky(prior_covariance)  # theta = prior_mean + root z, z ~ N(0, 1) before
    inverse = np.linalg.inv(root)
    variance, axes = np.linalg.eigh(inverse @ covariance @ inverse.T)
    variance = np.clip(variance, 1e-9, 1.0)
    told = 1.0 / variance - 1.0
    z = axes.T @ inverse @ (mean - prior_mean) / variance
    z = np.clip(z, -FARTHEST * told, FARTHEST * told)
    back = inverse.T @ axes
    precision = (back * told) @ back.T
    return precision, precision @ prior_mean + back @ z


def population(sessions: Sequence[SessionEvidence], prior_covariance: Float[np.ndarray, "n n"]) -> Population:
    """The population of these sessions.

    Args:
        prior_covariance: of the documented prior, whose mean is that of the sessions' own.

    Raises:
        ValueError: no session.
    """
    if not sessions:
        raise ValueError("a population of no session; expected one or more")
    precision = np.array([each.precision for each in sessions])
    linear = np.array([each.linear for each in sessions])
    middle = np.mean([each.prior_mean for each in sessions], axis=0)
    hyper = np.linalg.inv(prior_covariance)
    first = BETWEEN_SHARE**2 * prior_covariance
    mean, between = middle, first
    rounds, moved, seen = 0, np.inf, hyper
    while rounds < MAX_ROUNDS and moved > SETTLED:
        rounds += 1
        # With theta integrated out a session says N(mu; y, T + P^-1), and (T + P^-1)^-1 = (1 + P T)^-1 P.
        share = np.linalg.inv(np.eye(len(mean)) + precision @ between)
        seen = hyper + np.sum(share @ precision, axis=0)
        new = np.linalg.solve(seen, hyper @ middle + np.einsum("sab,sb->a", share, linear))
        width = between @ share  # posterior covariance of each session's theta
        off = np.einsum("sab,sb->sa", width, linear - precision @ new)  # its mean, minus mu
        scatter = np.einsum("sa,sb->ab", off, off) + width.sum(axis=0)
        after = (BETWEEN_SESSIONS * first + scatter) / (BETWEEN_SESSIONS + len(sessions))
        after = 0.5 * (after + after.T)
        moved = max(np.abs(new - mean).max(), np.abs(np.sqrt(np.diag(after)) - np.sqrt(np.diag(between))).max())
        mean, between = new, after
    return Population(mean, np.linalg.inv(_symmetric(seen)), between, len(sessions), rounds, bool(moved <= SETTLED))


def population_without(
    sessions: Sequence[SessionEvidence], held_out: Iterable[int], prior_covariance: Float[np.ndarray, "n n"]
) -> Population | None:
    """The population of the sessions with other indices, which nothing of these reaches; None where none is left."""
    without = set(held_out)
    others = [each for i, each in enumerate(sessions) if i not in without]
    return population(others, prior_covariance) if others else None


def _symmetric(matrix: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    return 0.5 * (matrix + matrix.T)
