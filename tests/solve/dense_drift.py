"""Covariances of unit noise of every component, the slow way: each single noise and what it does to each pose."""

import numpy as np
from jax.typing import ArrayLike
from scipy.spatial.transform import Rotation

from jaxgeo.graph.components import COMPONENTS
from jaxgeo.graph.pose_graph import PoseGraph
from jaxgeo.solve.drift import BLOCKS
from jaxgeo.solve.linearise import Edges


def influences(edges: Edges) -> np.ndarray:
    """`G_k`, (n, 6, 6), of every edge."""
    a, b = (np.moveaxis(np.array(part), -1, 0) for part in (edges.a, edges.b))
    return np.block([[a, b], [np.zeros_like(a), a]])


def unit_noises(edges: Edges, graph: PoseGraph) -> dict[str, list[np.ndarray]]:
    """For every component its unit noises, each as (n, 6) effects on the edges; `kernel` says what they share."""
    g = influences(edges)
    n = len(g)
    d, turn = np.array(graph.chain.length_m), np.array(graph.chain.turn_rad)
    quat = np.stack([np.array(c) for c in graph.chain.odometry.quat], axis=1)
    omega = np.concatenate([np.zeros((n, 3)), Rotation.from_quat(quat, scalar_first=True).as_rotvec()], axis=1)
    scale = np.concatenate([np.stack([np.array(c) for c in edges.scale_column], axis=1), np.zeros((n, 3))], axis=1)
    white = [np.sqrt(d)[:, None] * g[:, :, i] for i in range(6)]
    turned = [np.sqrt(turn)[:, None] * g[:, :, i] for i in (3, 4, 5)]
    bias = [d[:, None] * g[:, :, i] for i in range(6)]
    found = dict(zip(COMPONENTS[:6], ([w] for w in white), strict=True))
    found["turn_rad_per_sqrt_rad"] = turned
    found["log_scale"] = found["wander_log_scale"] = [scale]
    found["log_turn"] = [np.einsum("nij,nj->ni", g, omega)]
    found["bias_trans_m_per_m"] = found["wander_trans_m_per_m"] = bias[:3]
    found["bias_rot_rad_per_m"] = found["wander_rot_rad_per_m"] = bias[3:]
    return found


def kernel(name: str, distance_m: np.ndarray, correlation_m: float) -> np.ndarray:
    """(n, n) correlation between the noises of the edges."""
    n = len(distance_m)
    if name.startswith("wander"):
        length = distance_m[-1] / BLOCKS
        block = np.searchsorted(np.arange(1, BLOCKS) * length, distance_m - 1e-9 * length)
        return np.exp(-np.abs(block[:, None] - block[None]) * length / correlation_m)
    return np.eye(n) if "sqrt" in name else np.ones((n, n))


def dense_covariance_between(
    left: ArrayLike,
    here: np.ndarray,
    right: ArrayLike,
    there: np.ndarray,
    edges: Edges,
    graph: PoseGraph,
    corr_m: float,
) -> np.ndarray:
    """As `drift.covariance_between`: for each component `sum_(k <= i) sum_(l <= j) J e_k rho_kl (L e_l)'`."""
    left, right = np.asarray(left), np.asarray(right)
    distance = np.cumsum(np.array(graph.chain.length_m))
    n = len(distance)
    upto = [(np.arange(n)[None] <= index[:, None]).astype(float) for index in (here, there)]
    noises = unit_noises(edges, graph)
    rows = left.shape[0] * left.shape[1], right.shape[0] * right.shape[1]
    out = np.zeros((len(COMPONENTS), *rows))
    for c, name in enumerate(COMPONENTS):
        for effect in noises.get(name, []):
            moved = [
                np.einsum("pda,na,pn->pdn", j, effect, u).reshape(-1, n)
                for j, u in zip((left, right), upto, strict=True)
            ]
            out[c] += moved[0] @ kernel(name, distance, corr_m) @ moved[1].T
    near = np.exp(-np.abs(distance[here][:, None] - distance[there][None]) / corr_m)
    bounded = np.einsum("pda,qea,pq->pdqe", left[..., :3], right[..., :3], near)
    out[COMPONENTS.index("bounded_m")] = bounded.reshape(rows)
    return out
