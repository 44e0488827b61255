"""What is drawn once for a session is found again: the odometry's scale and its constant bias."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import RigidTransform
from solve.chain_session import Session, chained, drifted, graph_of, trajectory_of, transforms, walk
from solve.programs import EVERYTHING, NOISE_OF_EVERYTHING, covariances, optimum, session_of_everything

N = 100
BIAS = np.array([0.02, -0.01, 0.015, 0.002, -0.003, 0.001])


def estimate(made: Session) -> tuple[np.ndarray, np.ndarray]:
    """Bias and log-scale, and their standard deviations."""
    graph = optimum(graph_of(made, EVERYTHING))
    glob = graph.base_globals
    found = np.array([*glob.bias_trans, *glob.bias_rot, glob.log_scale], dtype=float)
    return found, np.sqrt(np.diagonal(covariances(graph)[1]))


def with_noise(made: Session, **values: float) -> Session:
    noise = NOISE_OF_EVERYTHING
    for name, value in values.items():
        noise = eqx.tree_at(lambda n, name=name: getattr(n, name), noise, jnp.full_like(getattr(noise, name), value))
    return dataclasses.replace(made, noise=noise)


def test_scale_of_odometry_that_is_not_metric():
    """Odometry of 0.8 of the true lengths: its translations must grow by 1 / 0.8."""
    made = session_of_everything(N)
    short = dataclasses.replace(made.trajectory, position_m=0.8 * made.trajectory.position_m)
    made = with_noise(dataclasses.replace(made, trajectory=short), sigma_log_scale=0.5, sigma_bias_trans_m_per_m=1e-4)
    found, sigma = estimate(made)
    assert sigma[6] < 0.01
    assert abs(found[6] - np.log(1.0 / 0.8)) < 3.0 * sigma[6]


def test_constant_bias():
    made = session_of_everything(N)
    truth = walk(N)
    step = transforms(trajectory_of(drifted(truth, made.noise, 3, size=0.3)))
    step = step[:-1].inv() * step[1:]
    length = np.linalg.norm(step.translation, axis=1)
    # `T_k = T_(k-1) O_k Exp(d b)`; SciPy's exponential coordinates are rotation first.
    missed = RigidTransform.from_exp_coords(length[:, None] * BIAS[[3, 4, 5, 0, 1, 2]])
    biased = trajectory_of(chained(step * missed.inv()))
    found, sigma = estimate(with_noise(dataclasses.replace(made, trajectory=biased), sigma_log_scale=1e-4))
    prior = np.array([*[0.01, 0.02, 0.015], *[0.002, 0.001, 0.0015]])
    assert np.all(sigma[:6] < prior)
    assert np.all(np.abs(found[:6] - BIAS) < 3.0 * sigma[:6])
    # Rotation bias is seen well: an estimate of zero would not pass.
    assert np.all(sigma[3:6] < 0.5 * np.abs(BIAS[3:6]))
