"""The pose between solves, where its mean can be said by hand; its growth is tested against the batch solve."""

import math

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxgeo.graph.components import COMPONENTS, NoiseEnsemble
from jaxgeo.online import joint, pose_log
from jaxgeo.online.drift_state import DriftState, DriftVariances

CORRELATION_M = 20.0


def state(**constants: float | np.ndarray) -> DriftState:
    """At the origin, its axes the grid's, the constants known for sure."""
    errors = np.zeros(joint.N_ERRORS)
    for name, value in constants.items():
        errors[getattr(joint, name)] = value
    sigma = np.zeros((1, len(COMPONENTS)))
    sigma[0, COMPONENTS.index("bounded_m")] = 0.5
    noise = NoiseEnsemble(jnp.asarray(sigma), jnp.ones(1), jnp.asarray(CORRELATION_M))
    quat = jnp.array([1.0, 0.0, 0.0, 0.0])
    last = joint.LastPose(jnp.zeros(3), quat, jnp.asarray(errors[6:]), jnp.zeros((joint.N_ERRORS, joint.N_ERRORS)))
    return DriftState(last, DriftVariances(noise))


def ahead(length_m: float) -> np.ndarray:
    column = np.zeros(pose_log.N_COLUMNS)
    column[pose_log.STEP_T] = [length_m, 0.0, 0.0]
    column[pose_log.STEP_Q] = [1.0, 0.0, 0.0, 0.0]
    column[pose_log.LENGTH] = length_m
    return column


def walked(found: DriftState, steps: int, length_m: float) -> np.ndarray:
    for _ in range(steps):
        found.push(ahead(length_m))
    return found.pose()[0]


def test_scale_and_bias_move_every_metre_alike():
    assert_allclose(walked(state(LOG_SCALE=math.log(1.1)), 10, 1.0), [11.0, 0.0, 0.0], atol=1e-12)
    assert_allclose(walked(state(BIAS_TRANS=np.array([0.0, 0.02, 0.0])), 10, 1.0), [10.0, 0.2, 0.0], atol=1e-12)


def test_a_bias_of_the_heading_walks_a_circle():
    radius_m = 50.0
    found = walked(state(BIAS_ROT=np.array([0.0, 0.0, 1.0 / radius_m])), 1000, radius_m * np.pi / 2000)
    assert_allclose(found, [radius_m, radius_m, 0.0], atol=0.05)


def test_the_bounded_error_and_the_wander_are_forgotten():
    found = state(BOUNDED=np.array([0.0, 0.3, 0.0]))
    assert_allclose(walked(found, 10, 2.0), [20.0, 0.3 * math.exp(-1.0), 0.0], atol=1e-12)
    # Its variance has come back by what was forgotten.
    assert found.pose()[2][1, 1] == pytest.approx(0.25 * (1.0 - math.exp(-2.0)))
    wandered = walked(state(WANDER_TRANS=np.array([0.0, 0.02, 0.0])), 4000, 0.02)
    assert wandered[1] == pytest.approx(0.02 * CORRELATION_M * (1.0 - math.exp(-4.0)), rel=1e-3)
    stretched = walked(state(WANDER_SCALE=0.02), 4000, 0.02)
    assert stretched[0] == pytest.approx(80.0 + 0.02 * CORRELATION_M * (1.0 - math.exp(-4.0)), rel=1e-5)
