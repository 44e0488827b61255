"""What was learned of one trajectory's noise, as plain numbers."""

import dataclasses

import numpy as np
from jaxtyping import Float

from jaxgeo.graph.components import NoiseEnsemble


@dataclasses.dataclass(frozen=True)
class SigmaEstimate:
    """A sigma's posterior over all models that have it: log-normal quantiles, and how much the data said.

    Attributes:
        component: name with unit, one of `COMPONENTS`, or `trans_...`/`rot_...` for the geometric mean of three axes.
        median, low_68, high_68, low_95, high_95: of sigma.
        log_sd: standard deviation of log sigma; `prior_log_sd`, `prior_median` before: no narrower, nothing learned.
        probability: posterior probability of the models that have the component.
    """

    component: str
    median: float
    low_68: float
    high_68: float
    low_95: float
    high_95: float
    log_sd: float
    prior_median: float
    prior_log_sd: float
    probability: float


@dataclasses.dataclass(frozen=True)
class ModelEstimate:
    """One model of the family.

    Attributes:
        name: see `calibration.models.MODELS`.
        weight: of its predictions: softmax of the mean of `log_evidence` (Laplace) and `log_predictive` (leave one
            location out), both relative to the best.
        components: names, in the order of `sigma` (optimum), `log_sd` (Laplace) and `correlation` (of log sigma).
        converged: whether its optimum was found; a model without one has no weight.
    """

    name: str
    weight: float
    log_evidence: float
    log_predictive: float
    components: tuple[str, ...]
    sigma: Float[np.ndarray, "c"]
    log_sd: Float[np.ndarray, "c"]
    correlation: Float[np.ndarray, "c c"]
    converged: bool


@dataclasses.dataclass(frozen=True)
class Calibration:
    """Learned noise of one trajectory.

    Attributes:
        kind: of odometry, whose prior was used; `observations` what it was learned from.
        models: the whole family, best first.
        sigmas: every component's posterior.
        ensemble: all draws of all models with their weights: what the trajectory was corrected under.
        theta_mean, theta_covariance: (n,), (n, n) of all components' log sigma over the ensemble, a prior for another
            session; a component that no model has keeps its prior.
        n_contrasts: independent numbers that it was learned from.
        n_revisits: visits beyond the first of a location, among those.
        sentences: what the data cannot tell, in words; empty where they can.
        rounds, settled: of learning and moving.
    """

    kind: str
    observations: str
    models: tuple[ModelEstimate, ...]
    sigmas: tuple[SigmaEstimate, ...]
    ensemble: NoiseEnsemble
    theta_mean: Float[np.ndarray, "n"]
    theta_covariance: Float[np.ndarray, "n n"]
    n_contrasts: int
    n_revisits: int
    sentences: tuple[str, ...]
    rounds: int
    settled: bool
