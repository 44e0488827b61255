"""The family of noise models between which the data choose, and the priors of their sigmas.

A prior is log-normal: median and standard deviation of log sigma. The white medians are the fixed defaults of the kind
of odometry (`jaxgeo.graph.noise_defaults`), uncertain by a factor e^2 all together, e^0.5 translation against
rotation, e^0.3 one axis against another. A bias is said relative to the white noise: its median moves a pose, over the
span of the anchors, three times as far as the white noise does (sigma_bias = 3 sigma_white / sqrt(span)), a wander as
far as the white noise does, so that one prior serves 50 m and 5 km; a model that has it and does not need it loses by
its evidence.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from jaxgeo.graph.components import (
    ANCHOR,
    BIAS_ROT,
    BIAS_TRANS,
    BOUNDED,
    LOG_SCALE,
    LOG_TURN,
    N_COMPONENTS,
    ROT,
    TRANS,
    TURN,
    WANDER_ROT,
    WANDER_SCALE,
    WANDER_TRANS,
)
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.graph.noise_defaults import DEFAULTS
from jaxgeo.solve.ensemble_fold import CORRELATION_SHARE

_WHITE = (*range(TRANS.start, TRANS.stop), *range(ROT.start, ROT.stop), TURN)
MODELS: dict[str, tuple[int, ...]] = {
    "white": (*_WHITE, LOG_SCALE),
    "white + scales": (*_WHITE, LOG_SCALE, LOG_TURN, WANDER_SCALE),
    "white + bias": (*_WHITE, BIAS_TRANS, BIAS_ROT),
    "white + wander": (*_WHITE, LOG_SCALE, WANDER_TRANS, WANDER_ROT),
    "white + bounded": (*_WHITE, LOG_SCALE, BOUNDED),
    "bounded": (LOG_SCALE, BOUNDED),
}
LEVEL, GROUP, AXIS, OTHER = 2.0, 0.5, 0.3, 1.0
BIAS_OVER_WHITE = 3.0
TURN_OVER_ROT = 1.0 / 3.0
# Medians of what has no default of its own: a tenth of a metre of bounded error; a scale of the turns of a tenth of a
# per cent (lidar) or half a per cent; odometry scale as in the defaults, at least a fifth of a per cent.
BOUNDED_M = 0.1
LOG_TURN_MEDIAN = {"lidar": 0.001, "vio": 0.005, "wheel": 0.01, "mono": 0.005}
LOG_SCALE_MEDIAN = {"lidar": 0.002, "vio": 0.05, "wheel": 0.01, "mono": 0.3}
WANDER_SCALE_MEDIAN = {"lidar": 0.002, "vio": 0.02, "wheel": 0.005, "mono": 0.1}
ANCHOR_FACTOR_MEDIAN = 0.5


@dataclasses.dataclass(frozen=True)
class FamilyPrior:
    """Prior of every component's log sigma: `mean + per_log_span * log(span of the anchors in metres)`.

    Attributes:
        mean, per_log_span: (n,).
        covariance: (n, n).
        free: (models, n) 1 where a model has the component.
    """

    mean: Float[np.ndarray, "n"]
    per_log_span: Float[np.ndarray, "n"]
    covariance: Float[np.ndarray, "n n"]
    free: Float[np.ndarray, "models n"]

    @property
    def precision(self) -> Float[np.ndarray, "models n n"]:
        """Inverse covariance of each model's own components; zero elsewhere."""
        out = np.zeros((len(self.free), N_COMPONENTS, N_COMPONENTS))
        for model, free in enumerate(self.free > 0):
            own = np.ix_(free, free)
            out[model][own] = np.linalg.inv(self.covariance[own])
        return out


def family_prior(kind: str, noise: OdometryNoise, *, free_anchor_factor: bool = False) -> FamilyPrior:
    """The prior for one kind of odometry; `noise` gives the white medians: the defaults, or the config's values."""
    mean, per_log_span = np.zeros(N_COMPONENTS), np.zeros(N_COMPONENTS)
    covariance = np.zeros((N_COMPONENTS, N_COMPONENTS))
    trans = np.asarray(noise.sigma_trans_m_per_sqrt_m)
    rot = np.asarray(noise.sigma_rot_rad_per_sqrt_m)
    mean[TRANS], mean[ROT] = np.log(trans), np.log(rot)
    level_trans, level_rot = np.log(trans).mean(), np.log(rot).mean()
    mean[TURN] = level_rot + np.log(TURN_OVER_ROT)
    for component, level in (
        (BIAS_TRANS, level_trans),
        (BIAS_ROT, level_rot),
        (WANDER_TRANS, level_trans),
        (WANDER_ROT, level_rot),
    ):
        mean[component] = level + np.log(BIAS_OVER_WHITE)
        per_log_span[component] = -0.5
    # What wanders cancels over the span: to move a pose as far as the white noise it must be larger than a constant.
    mean[[WANDER_TRANS, WANDER_ROT]] -= np.log(BIAS_OVER_WHITE) + 0.5 * np.log(2.0 * CORRELATION_SHARE)
    mean[LOG_SCALE] = np.log(LOG_SCALE_MEDIAN[kind])
    mean[LOG_TURN] = np.log(LOG_TURN_MEDIAN[kind])
    mean[WANDER_SCALE] = np.log(WANDER_SCALE_MEDIAN[kind])
    mean[BOUNDED], mean[ANCHOR] = np.log(BOUNDED_M), np.log(ANCHOR_FACTOR_MEDIAN)
    tied = np.zeros((3, N_COMPONENTS))
    tied[0, [*_WHITE, BIAS_TRANS, BIAS_ROT, WANDER_TRANS, WANDER_ROT]] = LEVEL
    tied[1, [*range(3), BIAS_TRANS, WANDER_TRANS]] = GROUP
    tied[2, [*range(3, 6), TURN, BIAS_ROT, WANDER_ROT]] = GROUP
    own = np.full(N_COMPONENTS, OTHER)
    own[:6] = AXIS
    covariance = tied.T @ tied + np.diag(own**2)
    free = np.zeros((len(MODELS), N_COMPONENTS))
    for row, members in zip(free, MODELS.values(), strict=True):
        row[list(members)] = 1.0
    free[:, ANCHOR] = float(free_anchor_factor)
    return FamilyPrior(mean, per_log_span, covariance, free)


assert set(DEFAULTS) == set(LOG_TURN_MEDIAN) == set(LOG_SCALE_MEDIAN) == set(WANDER_SCALE_MEDIAN)
