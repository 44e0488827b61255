"""A loop, two sets of noise, and the problem of placing markers along it."""

import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from eval.placement.plan import Plan, plan_of
from eval.placement.plan_visits import Sight
from eval.placement.predicted import watched
from eval.placement.problem import Problem
from eval.placement.region import region_of
from jaxgeo.data import Trajectory
from jaxgeo.graph.components import LOG_TURN, WANDER_TRANS, NoiseEnsemble, ensemble_of
from jaxgeo.graph.noise_defaults import default_noise

N = 600
SIGHTING_M, SURVEY_M = 0.05, 0.02
SIGHT = Sight(jnp.asarray(6.0), jnp.asarray(SIGHTING_M), jnp.full(3, SURVEY_M), jnp.asarray(12.0))


def loop(n: int = N) -> Trajectory:
    """An ellipse that comes back to its start, up and down a little, heading along it."""
    at = np.linspace(0.0, 2.0 * np.pi, n)
    position = np.column_stack([30.0 * np.cos(at), 20.0 * np.sin(at), 0.5 * np.sin(2.0 * at)])
    heading = np.arctan2(20.0 * np.cos(at), -30.0 * np.sin(at))
    turn = Rotation.from_rotvec(np.outer(heading, [0.0, 0.0, 1.0]))
    return Trajectory(0.1 * np.arange(n), position, turn.as_quat(scalar_first=True))


def one_set() -> NoiseEnsemble:
    return ensemble_of(default_noise("lidar"))


def two_sets() -> NoiseEnsemble:
    """The default noise; and the same with a wander and a wrong scale of the turns."""
    sigma = np.repeat(np.asarray(one_set().sigma), 2, axis=0)
    sigma[1, WANDER_TRANS], sigma[1, LOG_TURN] = 0.004, 0.003
    return NoiseEnsemble(jnp.asarray(sigma), jnp.array([0.6, 0.4]), jnp.asarray(25.0))


def small_plan(wanders: bool = False) -> Plan:
    """The loop at few knots."""
    return plan_of(loop(), wanders=wanders, most_knots=128)


def small_problem(**changes) -> Problem:
    """Sixteen points watched, the default noise."""
    plan, noise = small_plan(), one_set()
    parts = {
        "plan": plan,
        "noise": noise,
        "watch": watched(plan, noise, 16),
        "sight": SIGHT,
        "region": region_of(4.0),
        "standing_m": jnp.zeros((0, 3)),
        "beside_m": jnp.zeros(()),
        "passes": 2,
        "criterion": "path",
        "robust": "mixture",
    }
    return Problem(**(parts | changes))
