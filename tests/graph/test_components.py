"""The order of the components, and what of an ensemble `OdometryNoise` can say."""

import jax.numpy as jnp
import numpy as np
from numpy.testing import assert_allclose

from jaxgeo.graph import components as c
from jaxgeo.graph.noise import odometry_noise


def test_positions_are_those_of_the_names():
    place = {name: i for i, name in enumerate(c.COMPONENTS)}
    assert len(place) == c.N_COMPONENTS
    assert c.COMPONENTS[c.TRANS] == tuple(f"trans_{axis}_m_per_sqrt_m" for axis in "xyz")
    assert c.COMPONENTS[c.ROT] == tuple(f"rot_{axis}_rad_per_sqrt_m" for axis in "xyz")
    assert [name for name in c.COMPONENTS if "sqrt" in name] == list(c.COMPONENTS[: c.N_WHITE])
    named = {
        "turn_rad_per_sqrt_rad": c.TURN,
        "log_scale": c.LOG_SCALE,
        "log_turn": c.LOG_TURN,
        "bias_trans_m_per_m": c.BIAS_TRANS,
        "bias_rot_rad_per_m": c.BIAS_ROT,
        "wander_log_scale": c.WANDER_SCALE,
        "wander_trans_m_per_m": c.WANDER_TRANS,
        "wander_rot_rad_per_m": c.WANDER_ROT,
        "bounded_m": c.BOUNDED,
        "anchor_factor": c.ANCHOR,
    }
    assert {name: place[name] for name in named} == named


def test_noise_to_ensemble_and_back():
    noise = odometry_noise([0.1, 0.2, 0.3], [0.01, 0.02, 0.03], 0.004, 0.05, 0.006, 0.0007)
    ensemble = c.ensemble_of(noise, 7.0)
    assert ensemble.sigma.shape == (1, c.N_COMPONENTS)
    assert_allclose(ensemble.weight, [1.0])
    assert float(ensemble.correlation_m) == 7.0
    back = c.white_noise_of(np.asarray(ensemble.sigma)[0])
    for name, value in vars(noise).items():
        assert_allclose(getattr(back, name), value, rtol=1e-15, err_msg=name)


def test_three_biases_become_one_of_their_root_mean_square():
    noise = odometry_noise(0.1, 0.01, 0.0, 0.0, [0.01, 0.02, 0.02], [0.0, 0.003, 0.0])
    sigma = c.ensemble_of(noise).sigma[0]
    assert_allclose(sigma[jnp.array([c.BIAS_TRANS, c.BIAS_ROT])], [0.01 * 3.0**0.5, 0.003 / 3.0**0.5], rtol=1e-14)
