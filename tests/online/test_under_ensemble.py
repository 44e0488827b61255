"""The same under a noise ensemble, every component in one of its sets: on the way under their mean variances."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from online.online_session import FRAME, SETTINGS, N, batch_anchors, prefix, replayed, session

from jaxgeo.data import Anchors, Trajectory
from jaxgeo.graph.anchor_table import anchor_table
from jaxgeo.graph.chain import chain_of
from jaxgeo.graph.components import COMPONENTS, NoiseEnsemble
from jaxgeo.online import OnlineGeoreference
from jaxgeo.solve.correct import Settings
from jaxgeo.solve.ensemble_correct import EnsembleCorrection, ensemble_correction
from jaxgeo.solve.ensemble_fold import solve_ensemble

# So poorly surveyed that it matters whether two visits of one location share its survey's error.
MADE = session()
POORLY_M = np.full_like(MADE.survey.sigma_m, 0.15)
MADE = dataclasses.replace(MADE, survey=dataclasses.replace(MADE.survey, sigma_m=POORLY_M))
WHITE = {f"trans_{axis}_m_per_sqrt_m": 0.025 for axis in "xyz"} | {
    f"rot_{axis}_rad_per_sqrt_m": 0.003 for axis in "xyz"
}
CONSTANT = {"turn_rad_per_sqrt_rad": 0.003, "log_scale": 0.02, "log_turn": 0.01} | {
    "bias_trans_m_per_m": 2e-3,
    "bias_rot_rad_per_m": 4e-4,
}
FORGETTING = {"wander_log_scale": 0.02, "wander_trans_m_per_m": 3e-3, "wander_rot_rad_per_m": 4e-4}
FORGETTING |= {"bounded_m": 0.05, "anchor_factor": 0.5}


def ensemble(*sets: dict[str, float], correlation_m: float = 60.0) -> NoiseEnsemble:
    sigma = np.array([[values.get(name, 0.0) for name in COMPONENTS] for values in sets])
    weight = np.arange(1.0, 1.0 + len(sets))
    return NoiseEnsemble(jnp.asarray(sigma), jnp.asarray(weight / weight.sum()), jnp.asarray(correlation_m))


def mean_set(noise: NoiseEnsemble) -> NoiseEnsemble:
    """One set of the mean variances."""
    sigma = jnp.sqrt(noise.weight @ noise.sigma**2)
    return NoiseEnsemble(sigma[None], jnp.ones(1), noise.correlation_m)


def batch(trajectory: Trajectory, anchors: Anchors, noise: NoiseEnsemble) -> EnsembleCorrection:
    chain = chain_of(trajectory)
    table = anchor_table(anchors, chain)
    options = Settings().ensemble_options()
    fold = solve_ensemble(chain, table, noise, table.real, jnp.asarray(3.0), options)
    return ensemble_correction(trajectory, chain, fold)


# Wander is a step function in the batch solve, of 64 steps, and drawn edge by edge between anchors.
@pytest.mark.parametrize(
    ("sets", "margin"),
    [([WHITE, WHITE | CONSTANT], 1e-2), ([WHITE | CONSTANT, WHITE | FORGETTING], 2e-2)],
    ids=["white and constant", "wander and bounded"],
)
def test_on_the_way_it_is_the_batch_answer_of_the_mean_and_in_the_end_of_all_sets(sets, margin):
    noise = ensemble(*sets)
    found = OnlineGeoreference(MADE.survey, FRAME, noise, SETTINGS)
    until = 97
    replayed(found, MADE, until)
    now = found.current()
    expected = batch(prefix(MADE, until), batch_anchors(MADE, until), mean_set(noise))
    sigma = np.sqrt(np.diag(expected.covariance[-1]))
    assert_allclose(now.position_m, expected.corrected.position_m[-1], atol=margin * sigma[:3].max())
    assert_allclose(
        now.covariance / np.outer(sigma, sigma), expected.covariance[-1] / np.outer(sigma, sigma), atol=margin
    )
    for i in range(until, N):
        found.push_sightings(MADE.sightings.take(np.flatnonzero(MADE.sightings.stamp_s == MADE.trajectory.stamp_s[i])))
        found.push_odometry(MADE.trajectory.stamp_s[i], MADE.trajectory.position_m[i], MADE.trajectory.quat_wxyz[i])
        found.update()
    result = found.finish()
    whole = batch(MADE.trajectory, batch_anchors(MADE), noise)
    assert_allclose(result.corrected.position_m, whole.corrected.position_m, atol=1e-3)
    assert_allclose(result.covariance, whole.covariance, rtol=1e-3, atol=1e-7)
    assert result.log_scale == pytest.approx(whole.log_scale, abs=1e-5)
