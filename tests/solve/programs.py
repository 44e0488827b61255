"""The compiled programs that the estimator's tests share: each compiles once for every shape and choice of terms."""

import dataclasses

import jax
import jax.numpy as jnp
from solve.chain_session import Session, session

from jaxgeo.graph.noise import odometry_noise
from jaxgeo.graph.pose_graph import PoseGraph, Terms, residuals, zero_increments
from jaxgeo.solve.adjoint import rebased
from jaxgeo.solve.measurement_space import damped_step
from jaxgeo.solve.posterior import globals_covariance, pose_covariance, posterior
from jaxgeo.solve.solver import SOLVER, solve_graph

# White noise, log-scale, bias and surveyed rotations, all at once.
EVERYTHING = Terms(rotation=True, log_scale=True, bias=True)
NOISE_OF_EVERYTHING = odometry_noise(
    [0.02, 0.03, 0.025], [0.003, 0.002, 0.004], 0.003, 0.2, [0.01, 0.02, 0.015], [0.002, 0.001, 0.0015]
)

solve = jax.jit(solve_graph)


@jax.jit
def optimum(graph: PoseGraph) -> PoseGraph:
    """The graph about its optimum, as exact as float64 allows: it goes on where the cost is flat to rounding.

    By undamped steps, which converge from the coarse fit of these sessions.
    """

    def step(_: int, at: PoseGraph) -> PoseGraph:
        state = SOLVER.init(residuals, zero_increments(at), at, {}, None, None, frozenset())
        return rebased(at, *damped_step(state, at))

    return jax.lax.fori_loop(0, 16, step, graph)


@jax.jit
def covariances(at_optimum: PoseGraph) -> tuple[jax.Array, jax.Array]:
    """Of every pose and of the globals."""
    post = posterior(at_optimum, at_optimum.base, at_optimum.base_globals)
    n = at_optimum.chain.length_m.shape[0]
    return pose_covariance(post, jnp.arange(n)), globals_covariance(post)


def session_of_everything(n: int = 100, seed: int = 0) -> Session:
    made = session(n, 7, seed, lever_m=1.0, sigma_rot_rad=0.02)
    return dataclasses.replace(made, noise=NOISE_OF_EVERYTHING)
