"""The priors say what the module says of them, whatever the kind of odometry."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from calibration.models import AXIS, BIAS_OVER_WHITE, GROUP, LEVEL, MODELS, OTHER, family_prior
from jaxgeo.graph.components import (
    ANCHOR,
    BIAS_ROT,
    BIAS_TRANS,
    BOUNDED,
    COMPONENTS,
    LOG_SCALE,
    N_COMPONENTS,
    ROT,
    TRANS,
    TURN,
    WANDER_ROT,
    WANDER_TRANS,
)
from jaxgeo.graph.noise import odometry_noise
from jaxgeo.graph.noise_defaults import DEFAULTS, default_noise
from jaxgeo.solve.ensemble_fold import CORRELATION_SHARE

SPANS_M = (50.0, 5000.0)


def median(prior, component: int, span_m: float) -> float:
    return float(np.exp(prior.mean[component] + prior.per_log_span[component] * np.log(span_m)))


@pytest.mark.parametrize("kind", DEFAULTS)
def test_white_medians_are_the_defaults(kind):
    prior = family_prior(kind, default_noise(kind))
    for span_m in SPANS_M:
        for axis in range(3):
            assert_allclose(median(prior, axis, span_m), DEFAULTS[kind]["sigma_trans_m_per_sqrt_m"])
            assert_allclose(median(prior, 3 + axis, span_m), DEFAULTS[kind]["sigma_rot_rad_per_sqrt_m"])


def test_medians_follow_the_values_given_axis_by_axis():
    noise = odometry_noise([0.1, 0.2, 0.4], [0.01, 0.02, 0.08])
    prior = family_prior("vio", noise)
    assert_allclose(np.exp(prior.mean[TRANS]), [0.1, 0.2, 0.4])
    assert_allclose(np.exp(prior.mean[ROT]), [0.01, 0.02, 0.08])
    # A bias has no axes: of the geometric mean.
    assert_allclose(median(prior, BIAS_TRANS, 1.0), BIAS_OVER_WHITE * 0.2)
    assert_allclose(median(prior, BIAS_ROT, 1.0), BIAS_OVER_WHITE * (0.01 * 0.02 * 0.08) ** (1.0 / 3.0))


@pytest.mark.parametrize("span_m", SPANS_M)
@pytest.mark.parametrize(("bias", "wander", "white"), [(BIAS_TRANS, WANDER_TRANS, 0), (BIAS_ROT, WANDER_ROT, 3)])
def test_a_bias_moves_three_times_as_far_as_white_noise_and_a_wander_as_far(bias, wander, white, span_m):
    prior = family_prior("lidar", default_noise("lidar"))
    moved_white = median(prior, white, span_m) * np.sqrt(span_m)
    assert_allclose(median(prior, bias, span_m) * span_m, 3.0 * moved_white)
    # A Gauss-Markov bias summed over the span, on a fine grid of it.
    at = np.linspace(0.0, span_m, 2001)
    step = at[1] - at[0]
    variance = step**2 * np.exp(-np.abs(at[:, None] - at[None]) / (CORRELATION_SHARE * span_m)).sum()
    # The formula takes the span for long against the correlation length: ten times is 5 per cent off.
    assert_allclose(median(prior, wander, span_m) * np.sqrt(variance), moved_white, rtol=0.07)


def test_what_is_known_together_and_what_apart():
    """Level, translation against rotation, one axis against another: the standard deviations of differences."""
    covariance = family_prior("vio", default_noise("vio")).covariance

    def sd(a: int, b: int | None = None) -> float:
        pick = np.eye(N_COMPONENTS)[a] - (0.0 if b is None else np.eye(N_COMPONENTS)[b])
        return float(np.sqrt(pick @ covariance @ pick))

    assert_allclose(sd(0), np.sqrt(LEVEL**2 + GROUP**2 + AXIS**2))
    assert_allclose(sd(0, 1), np.sqrt(2.0) * AXIS)
    assert_allclose(sd(0, 3), np.sqrt(2.0 * (GROUP**2 + AXIS**2)))
    assert_allclose(sd(3, TURN), np.sqrt(AXIS**2 + OTHER**2))
    assert_allclose(sd(0, BIAS_TRANS), np.sqrt(AXIS**2 + OTHER**2))
    for alone in (LOG_SCALE, BOUNDED, ANCHOR):
        assert_allclose(sd(alone), OTHER)
        assert np.count_nonzero(covariance[alone]) == 1
    assert np.linalg.eigvalsh(covariance)[0] > 1e-3


@pytest.mark.parametrize("anchor_factor", [False, True])
def test_a_model_s_precision_is_of_its_own_components(anchor_factor):
    prior = family_prior("wheel", default_noise("wheel"), free_anchor_factor=anchor_factor)
    assert prior.free.shape == (len(MODELS), N_COMPONENTS)
    for row, members, precision in zip(prior.free, MODELS.values(), prior.precision, strict=True):
        own = np.array(sorted({*members, *([ANCHOR] if anchor_factor else [])}))
        assert list(np.flatnonzero(row)) == list(own)
        block = np.ix_(own, own)
        assert_allclose(precision[block] @ prior.covariance[block], np.eye(len(own)), rtol=0, atol=1e-9)
        outside = precision.copy()
        outside[block] = 0.0
        assert not outside.any()


def test_every_component_is_in_some_model():
    free = family_prior("mono", default_noise("mono"), free_anchor_factor=True).free
    assert [name for name, some in zip(COMPONENTS, free.any(axis=0), strict=True) if not some] == []
