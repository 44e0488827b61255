"""The pose graph of keyframes: a chain of odometry, and what else ties them."""

import dataclasses
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxgeo.data.relative_poses import RelativePoses
from jaxgeo.geometry.rigid import adjoint, inverse, log, matrices, parts
from jaxgeo.graph.noise import LENGTH_FLOOR_M, OdometryNoise, edge_variances
from jaxgeo.mapping.closure import Closure
from jaxgeo.solve.closure_graph import ClosureSettings, solve_closure_graph

# Beside what grows with distance and turn, each edge errs by what placing a keyframe in time and space costs.
_EDGE_FLOOR_M = 0.005
_EDGE_FLOOR_RAD = 0.001


@dataclasses.dataclass(frozen=True)
class SolvedKeyframes:
    """Keyframes after a solve, the first where it was.

    Attributes:
        T_map_body: (k, 4, 4).
        weight: (m,) of every edge, 0 rejected .. 1 accepted.
        cost: of all edges, rejected ones at what rejecting them costs.
        result: how the solve ended; "converged" or why not.
    """

    T_map_body: Float[np.ndarray, "k 4 4"]
    weight: Float[np.ndarray, "m"]
    cost: float
    result: str


def solve_keyframes(
    T_map_body: Float[np.ndarray, "k 4 4"], edges: RelativePoses, settings: ClosureSettings
) -> SolvedKeyframes:
    """Solve a graph and put the first keyframe back to where it was; a chain alone, made of these poses, is solved."""
    if len(edges) < len(T_map_body):
        return SolvedKeyframes(T_map_body, np.ones(len(edges)), 0.0, "converged")
    found = solve_closure_graph(*parts(T_map_body), edges, settings)
    solved = matrices(np.asarray(found.position_m), np.asarray(found.quat_wxyz))
    return SolvedKeyframes(
        T_map_body[0] @ inverse(solved[0]) @ solved, np.asarray(found.weight), found.total_cost, found.result
    )


def chain_and(
    T_map_body: Float[np.ndarray, "k 4 4"], covariance: Float[np.ndarray, "e 6 6"], closures: Sequence[Closure]
) -> RelativePoses:
    """The steps of the poses as odometry edges with these covariances (k - 1), then the closures."""
    k = len(T_map_body)
    steps = inverse(T_map_body[:-1]) @ T_map_body[1:]
    measured = np.concatenate([steps, *(c.T_first_second[None] for c in closures)])
    information = np.concatenate([np.linalg.inv(covariance), *(c.information[None] for c in closures)])
    first = np.concatenate([np.arange(k - 1), [c.first for c in closures]]).astype(int)
    second = np.concatenate([np.arange(1, k), [c.second for c in closures]]).astype(int)
    return RelativePoses(first, second, *parts(measured), 0.5 * (information + np.swapaxes(information, 1, 2)))


def edge_covariance(
    noise: OdometryNoise, length_m: Float[np.ndarray, "e"], turn: Float[np.ndarray, "e"]
) -> Float[np.ndarray, "e 6 6"]:
    """White covariances of odometry edges of this path length (m) and turned angle (rad), in the body frame."""
    trans, rot = edge_variances(noise, jnp.asarray(np.maximum(length_m, LENGTH_FLOOR_M)), jnp.asarray(turn))
    variance = np.stack([np.asarray(v) for v in (*trans, *rot)], axis=1)
    variance += np.array([_EDGE_FLOOR_M**2] * 3 + [_EDGE_FLOOR_RAD**2] * 3)
    return variance[:, :, None] * np.eye(6)


def squared_residuals(T_map_body: Float[np.ndarray, "k 4 4"], edges: RelativePoses) -> Float[np.ndarray, "m"]:
    """Squared whitened residual of every edge."""
    measured = matrices(edges.t_m, edges.quat_wxyz)
    error = log(inverse(measured) @ inverse(T_map_body[edges.first]) @ T_map_body[edges.second])
    return np.einsum("ma,mab,mb->m", error, edges.information, error)


def carried_covariance(
    T_map_body: Float[np.ndarray, "k 4 4"], covariance: Float[np.ndarray, "e 6 6"]
) -> Float[np.ndarray, "k 6 6"]:
    """Sums over the edges up to each keyframe of their covariances, in the map frame."""
    Ad = adjoint(T_map_body[1:])
    in_map = Ad @ covariance @ np.swapaxes(Ad, 1, 2)
    return np.concatenate([np.zeros((1, 6, 6)), np.cumsum(in_map, axis=0)])


def covariance_between(
    T_map_body: Float[np.ndarray, "k 4 4"], carried: Float[np.ndarray, "k 6 6"], first: int, second: int
) -> Float[np.ndarray, "6 6"]:
    """Covariance of the second keyframe's pose relative to the first's, first <= second, in the second's frame."""
    back = adjoint(inverse(T_map_body[second]))
    return back @ (carried[second] - carried[first]) @ back.T
