"""What the graph says, against SciPy: the chain, the anchors' table, and every residual."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import RigidTransform, Rotation
from solve.chain_session import NOISE, graph_of, real_poses, session, started_badly, transforms
from solve.programs import EVERYTHING, session_of_everything

from jaxgeo.geometry.robust import robust_rho
from jaxgeo.graph.anchor_table import anchor_table
from jaxgeo.graph.chain import chain_of
from jaxgeo.graph.compute_once import compute_once
from jaxgeo.graph.noise import LENGTH_FLOOR_M, edge_variances, odometry_noise
from jaxgeo.graph.pose_graph import Globals, PoseGraph, Terms, log_rotation, residuals, zero_increments

N, K = 100, 7
BIAS = np.array([0.01, -0.02, 0.015, 0.002, -0.001, 0.003])
LOG_SCALE = 0.05

whitened = jax.jit(lambda graph: residuals(zero_increments(graph), graph))


def rows(parts) -> np.ndarray:
    return np.stack([np.asarray(c) for c in parts], axis=-1)


class TestChain:
    def test_edges_are_the_relative_motions(self):
        made = session(N, K)
        chain = chain_of(made.trajectory)
        poses = transforms(made.trajectory)
        step = poses[:-1].inv() * poses[1:]
        assert_allclose(real_poses(chain.odometry, N).as_matrix()[1:], step.as_matrix(), rtol=0, atol=1e-12)
        coordinates = step.as_exp_coords()
        length = np.linalg.norm(coordinates[:, 3:], axis=1) + LENGTH_FLOOR_M
        assert_allclose(np.asarray(chain.length_m)[1:N], length, rtol=1e-12)
        assert_allclose(np.asarray(chain.turn_rad)[1:N], step.rotation.magnitude(), rtol=1e-9)
        origin = np.asarray(chain.map_origin_m)
        assert np.array_equal(origin, np.round(origin))
        assert_allclose(real_poses(chain.start, N).translation + origin, poses.translation, rtol=0, atol=1e-12)

    def test_edge_0_and_padding_are_nothing(self):
        chain = chain_of(session(N, K).trajectory)
        assert chain.length_m.shape == (128,)
        nothing = np.r_[0, N:128]
        assert np.all(np.asarray(chain.length_m)[nothing] == 0.0)
        assert np.all(np.asarray(chain.turn_rad)[nothing] == 0.0)
        assert_allclose(rows(chain.odometry.t)[nothing], 0.0, atol=1e-12)
        assert_allclose(rows(chain.odometry.quat)[nothing], np.eye(4)[[0] * 29], atol=1e-12)
        trans, rot = edge_variances(NOISE, chain.length_m, chain.turn_rad)
        assert np.all(rows((*trans, *rot))[nothing] == 0.0)


def test_variances_of_an_edge():
    noise = odometry_noise([0.1, 0.2, 0.3], 0.01, 0.05)
    trans, rot = edge_variances(noise, jnp.asarray([4.0]), jnp.asarray([0.5]))
    assert_allclose(rows(trans), [[0.04, 0.16, 0.36]])
    assert_allclose(rows(rot), [[4e-4 + 0.00125] * 3])


class TestAnchorTable:
    def test_rotation_is_what_the_marker_implies_for_the_body(self):
        made = session(N, K, sigma_rot_rad=0.02, error_size=0.0)
        half = made.anchors.quat_grid_marker_wxyz.copy()
        half[2] = np.nan
        table = anchor_table(
            dataclasses.replace(made.anchors, quat_grid_marker_wxyz=half), chain_of(made.trajectory), 0.3
        )
        expected = transforms(made.truth).rotation[made.anchors.pose_index].as_matrix()
        expected[2] = np.eye(3)
        assert_allclose(table.rotation[:K], expected, rtol=0, atol=1e-12)
        assert_allclose(table.has_rotation, [1, 1, 0, 1, 1, 1, 1, 0])
        assert_allclose(table.real, [1] * K + [0])
        assert_allclose(table.rotation_covariance_rad2[2], np.eye(3))
        assert_allclose(np.asarray(table.survey_covariance_m2)[:K], made.anchors.survey_covariance_m2)
        more = np.asarray(table.lever_covariance_m2)[:K] - made.anchors.lever_covariance_m2
        assert_allclose(more, np.broadcast_to(0.09 * np.eye(3), (K, 3, 3)), atol=1e-15)

    def test_number_of_anchors_before_a_pose(self):
        made = session(N, K)
        table = anchor_table(made.anchors, chain_of(made.trajectory))
        index = np.asarray(table.pose_index)
        assert_allclose(table.later_than, [(index < i).sum() for i in range(128)])


def disturbed(terms: Terms) -> PoseGraph:
    """Residuals large and of every kind, globals not zero."""
    graph = started_badly(graph_of(session_of_everything(N), terms), N, 1, 0.3, 0.2, 0.4)
    b = [jnp.asarray(v) for v in (*BIAS, LOG_SCALE)]
    glob = Globals((b[0], b[1], b[2]), (b[3], b[4], b[5]), b[6])
    return eqx.tree_at(lambda g: g.base_globals, graph, glob)


def expected_edge_noise(graph: PoseGraph, scale: float) -> np.ndarray:
    """`Log(O(s)^-1 T_(k-1)^-1 T_k)`, translation first."""
    poses, odometry = real_poses(graph.base, N), real_poses(graph.chain.odometry, N)[1:]
    scaled = RigidTransform.from_components(scale * odometry.translation, odometry.rotation)
    coordinates = (scaled.inv() * poses[:-1].inv() * poses[1:]).as_exp_coords()
    return coordinates[:, [3, 4, 5, 0, 1, 2]]


def expected_anchor_rows(graph: PoseGraph) -> np.ndarray:
    a = graph.anchors
    poses = real_poses(graph.base, N)[np.asarray(a.pose_index)[:K]]
    position = poses.apply(np.asarray(a.lever_arm_m)[:K]) - np.asarray(a.measured_m)[:K]
    turned = (Rotation.from_matrix(np.asarray(a.measured_rotation)[:K]).inv() * poses.rotation).as_rotvec()
    parts = [(a.sqrt_information, position), (a.sqrt_information_rotation, turned)]
    return np.concatenate([np.einsum("kij,kj->ki", np.asarray(w)[:K], r) for w, r in parts], axis=1)


@pytest.fixture(scope="module")
def everything() -> PoseGraph:
    return disturbed(EVERYTHING)


class TestResiduals:
    def test_odometry(self, everything):
        found = whitened(everything)
        length = np.asarray(everything.chain.length_m)[1:N, None]
        trans, rot = edge_variances(everything.noise, everything.chain.length_m, everything.chain.turn_rad)
        sigma = np.sqrt(rows((*trans, *rot)))[1:N]
        expected = (expected_edge_noise(everything, np.exp(LOG_SCALE)) - length * BIAS) / sigma
        assert_allclose(rows(found["translation"])[1:N], expected[:, :3], rtol=1e-9, atol=1e-9)
        assert_allclose(rows(found["rotation"])[1:N], expected[:, 3:], rtol=1e-9, atol=1e-9)
        for part in ("translation", "rotation"):
            assert np.all(rows(found[part])[np.r_[0, N:128]] == 0.0)

    def test_globals(self, everything):
        found = whitened(everything)
        noise = everything.noise
        sigma = np.concatenate([noise.sigma_bias_trans_m_per_m, noise.sigma_bias_rot_rad_per_m])
        assert_allclose(np.asarray(found["bias"]), BIAS / sigma, rtol=1e-12)
        assert_allclose(found["log_scale"][0], LOG_SCALE / float(noise.sigma_log_scale), rtol=1e-12)

    def test_anchors(self, everything):
        found = np.asarray(whitened(everything)["anchor"][0])
        assert_allclose(found[:K], expected_anchor_rows(everything), rtol=1e-9, atol=1e-9)
        assert np.all(found[K:] == 0.0)

    def test_robust_anchors(self):
        """The square of the residual is the loss of the plain one's square."""
        graph = disturbed(Terms(rotation=True, loss="cauchy"))
        found = whitened(graph)
        plain = np.sum(expected_anchor_rows(graph) ** 2, axis=1)
        assert np.any(plain > 9.0)
        assert_allclose(np.sum(np.asarray(found["anchor"][0])[:K] ** 2, axis=1), robust_rho(plain, "cauchy", 3.0))

    def test_terms_that_are_left_out(self):
        graph = disturbed(Terms())
        found = whitened(graph)
        assert set(found) == {"translation", "rotation", "anchor"}
        assert_allclose(np.asarray(found["anchor"][0])[:K], expected_anchor_rows(graph)[:, :3], rtol=1e-9, atol=1e-9)
        trans, _ = edge_variances(graph.noise, graph.chain.length_m, graph.chain.turn_rad)
        expected = expected_edge_noise(graph, 1.0)[:, :3] / np.sqrt(rows(trans))[1:N]
        assert_allclose(rows(found["translation"])[1:N], expected, rtol=1e-9, atol=1e-9)


def test_rotation_vectors_of_matrices():
    """Every branch of Shepperd's choice, zero and half a turn."""
    rng = np.random.default_rng(0)
    axis = np.concatenate([np.eye(3), rng.standard_normal((9, 3))])
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    angle = np.array([0.0, 1e-9, 1e-4, 0.5, 2.0, 3.0, np.pi - 1e-6])
    rotvec = (angle[:, None, None] * axis).reshape(-1, 3)
    found = jax.jit(log_rotation)(jnp.asarray(Rotation.from_rotvec(rotvec).as_matrix()))
    assert_allclose(found, rotvec, rtol=0, atol=1e-9)


def test_computed_once_is_the_same_and_differentiates():
    always = jnp.asarray(True)
    x = jnp.asarray([1.0, -2.0])
    assert_allclose(compute_once(always, x), x)

    def cube(v: jax.Array) -> jax.Array:
        return jnp.sum(compute_once(always, v) ** 3)

    assert_allclose(jax.grad(cube)(x), 3.0 * x**2)
    assert_allclose(jax.jacfwd(jax.grad(cube))(x), np.diag(6.0 * x))
