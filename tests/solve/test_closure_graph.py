import dataclasses

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from solve.closure_grid import closure_grid, with_false_closures

from jaxgeo.data import RelativePoses
from jaxgeo.errors import ConfigError, GraphError, UndeterminedError
from jaxgeo.solve.closure_graph import ClosureSettings, ClosureSolution, solve_closure_graph
from jaxgeo.solve.closure_inputs import check_pieces

GIVEN = ClosureSettings(start="given")


def adjoint(t_m: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Ad of poses, (translation, rotation) order."""
    x, y, z = t_m.T
    o = np.zeros_like(x)
    hat = np.stack([o, -z, y, z, o, -x, -y, x, o], axis=-1).reshape(-1, 3, 3)
    top = np.concatenate([rotation, hat @ rotation], axis=2)
    return np.concatenate([top, np.concatenate([np.zeros_like(rotation), rotation], axis=2)], axis=1)


def reversed_edges(edges: RelativePoses, which: np.ndarray) -> RelativePoses:
    """The same edges, some measured the other way round: `r' = -Ad(Z) r`."""
    rot = Rotation.from_quat(edges.quat_wxyz, scalar_first=True)
    back = np.linalg.inv(adjoint(edges.t_m, rot.as_matrix()))
    turned = back.transpose(0, 2, 1) @ edges.information @ back
    w = which[:, None]
    return RelativePoses(
        np.where(which, edges.second, edges.first),
        np.where(which, edges.first, edges.second),
        np.where(w, -rot.inv().apply(edges.t_m), edges.t_m),
        np.where(w, rot.inv().as_quat(scalar_first=True), edges.quat_wxyz),
        np.where(w[:, :, None], turned, edges.information),
    )


def gtsam_optimum(position: np.ndarray, quat: np.ndarray, edges: RelativePoses) -> tuple[float, np.ndarray, np.ndarray]:
    """Cost and poses of GTSAM's Levenberg-Marquardt; its tangents are rotation first."""
    swap = [3, 4, 5, 0, 1, 2]
    graph, start = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for k in range(len(edges)):
        model = gtsam.noiseModel.Gaussian.Information(edges.information[k][np.ix_(swap, swap)])
        motion = gtsam.Pose3(gtsam.Rot3.Quaternion(*edges.quat_wxyz[k]), edges.t_m[k])
        graph.add(gtsam.BetweenFactorPose3(int(edges.first[k]), int(edges.second[k]), motion, model))
    for i, (p, q) in enumerate(zip(position, quat, strict=True)):
        start.insert(i, gtsam.Pose3(gtsam.Rot3.Quaternion(*q), p))
    graph.add(gtsam.PriorFactorPose3(0, start.atPose3(0), gtsam.noiseModel.Isotropic.Sigma(6, 0.1)))
    settings = gtsam.LevenbergMarquardtParams()
    settings.setRelativeErrorTol(1e-13)
    found = gtsam.LevenbergMarquardtOptimizer(graph, start, settings).optimize()
    poses = [found.atPose3(i) for i in range(len(position))]
    return (
        graph.error(found),
        np.array([x.translation() for x in poses]),
        np.array([x.rotation().matrix() for x in poses]),
    )


def matrices(solution: ClosureSolution) -> np.ndarray:
    return Rotation.from_quat(solution.quat_wxyz, scalar_first=True).as_matrix()


def test_optimum_is_gtsams() -> None:
    position, quat, edges = closure_grid()
    cost, their_position, their_rotation = gtsam_optimum(position, quat, edges)
    found = solve_closure_graph(position, quat, edges, GIVEN)
    assert found.converged
    assert found.start == "given"
    assert found.cost == pytest.approx(cost, rel=1e-7)
    assert found.total_cost == pytest.approx(found.cost, rel=1e-12)
    assert found.start_cost > 5 * found.cost
    np.testing.assert_allclose(found.position_m, their_position, atol=2e-4)
    np.testing.assert_allclose(matrices(found), their_rotation, atol=1e-4)
    np.testing.assert_array_equal(found.weight, 1.0)
    assert 0.5 * found.squared_residual.sum() == pytest.approx(found.cost, rel=1e-12)


def test_chordal_start_forgets_the_given_poses_and_reaches_the_same_optimum() -> None:
    position, quat, edges = closure_grid()
    rng = np.random.default_rng(3)
    wild_position, wild_quat = (
        rng.normal(size=position.shape) * 100,
        Rotation.random(len(quat), rng=rng).as_quat(),
    )
    wild_position[0], wild_quat[0] = position[0], quat[0]
    found = solve_closure_graph(wild_position, wild_quat, edges, ClosureSettings(start="best"))
    expected = solve_closure_graph(position, quat, edges, GIVEN)
    assert found.converged
    assert found.start == "chordal"
    assert found.cost == pytest.approx(expected.cost, rel=1e-7)
    np.testing.assert_allclose(found.position_m, expected.position_m, atol=2e-4)


@pytest.mark.parametrize("start", ["given", "chordal"])
def test_order_and_direction_of_edges_and_the_frame_do_not_matter(start) -> None:
    position, quat, edges = closure_grid()
    settings = ClosureSettings(start=start)
    expected = solve_closure_graph(position, quat, edges, settings)
    rng = np.random.default_rng(4)
    turn, shift = Rotation.random(rng=rng), np.array([300.0, -200.0, 50.0])
    other = reversed_edges(edges, rng.random(len(edges)) < 0.5).take(rng.permutation(len(edges)))
    moved_quat = (turn * Rotation.from_quat(quat, scalar_first=True)).as_quat(scalar_first=True)
    found = solve_closure_graph(turn.apply(position) + shift, moved_quat, other, settings)
    assert found.cost == pytest.approx(expected.cost, rel=1e-7)
    np.testing.assert_allclose(found.position_m, turn.apply(expected.position_m) + shift, atol=2e-4)
    np.testing.assert_allclose(matrices(found), turn.as_matrix() @ matrices(expected), atol=1e-4)


def test_first_pose_stays_where_it_is() -> None:
    position, quat, edges = closure_grid()
    far = np.array([5000.0, 7000.0, 300.0])
    found = solve_closure_graph(position + far, quat, edges, GIVEN)
    np.testing.assert_allclose(found.position_m[0], position[0] + far, atol=1e-9)
    np.testing.assert_allclose(
        matrices(found)[0], Rotation.from_quat(quat[0], scalar_first=True).as_matrix(), atol=1e-12
    )


FALSE = np.arange(64, 112, 4)


def without(edges: RelativePoses, rows: np.ndarray) -> RelativePoses:
    """Some edges of next to no information: the same programs solve it."""
    information = edges.information.copy()
    information[rows] *= 1e-12
    return dataclasses.replace(edges, information=information)


def test_graduated_non_convexity_rejects_false_closures_only() -> None:
    position, quat, edges = closure_grid()
    clean = solve_closure_graph(position, quat, without(edges, FALSE), GIVEN)
    spoiled = with_false_closures(edges, FALSE)
    plain = solve_closure_graph(position, quat, spoiled, GIVEN)
    found = solve_closure_graph(position, quat, spoiled, ClosureSettings(loss="gnc", loss_width=6.0))
    assert found.converged
    np.testing.assert_array_equal(np.flatnonzero(found.weight == 0), FALSE)
    assert found.weight.sum() == len(edges) - len(FALSE)
    np.testing.assert_allclose(found.position_m, clean.position_m, atol=5e-4)
    assert found.cost == pytest.approx(clean.cost, rel=1e-6)
    assert found.total_cost == pytest.approx(found.cost + len(FALSE) * 0.5 * 6.0**2, rel=1e-9)
    assert np.abs(plain.position_m - clean.position_m).max() > 0.3


def test_reweighted_loss_doubts_the_false_ones() -> None:
    position, quat, edges = closure_grid()
    clean = solve_closure_graph(position, quat, without(edges, FALSE[:3]), GIVEN)
    spoiled = with_false_closures(edges, FALSE[:3])
    settings = ClosureSettings(loss="geman_mcclure", loss_width=6.0, start="given")
    found = solve_closure_graph(clean.position_m, clean.quat_wxyz, spoiled, settings)
    assert found.converged
    false = np.isin(np.arange(len(edges)), FALSE[:3])
    assert found.weight[~false].min() > 10 * found.weight[false].max()
    np.testing.assert_array_equal(found.weight[:63], 1.0)  # odometry is trusted
    np.testing.assert_allclose(found.position_m, clean.position_m, atol=0.2)
    half = 0.5 * found.squared_residual
    np.testing.assert_allclose(found.cost, (found.weight * half).sum(), rtol=1e-12)
    assert found.cost <= found.total_cost <= half.sum()


def test_two_sessions_and_closures_that_know_little_of_rotations() -> None:
    """The walk cut in two between rows 31 and 32; GTSAM cannot have zero information, so it gets next to none."""
    position, quat, edges = closure_grid()
    edges = edges.take(np.flatnonzero(~((edges.first == 31) & (edges.second == 32))))
    closure = edges.second - edges.first > 1
    with_rotation, without = edges.information.copy(), edges.information.copy()
    with_rotation[closure, 3:, :] = with_rotation[closure, :, 3:] = 0.0
    without[:] = with_rotation
    with_rotation[closure, 3:, 3:] = 1e-6 * np.eye(3)
    cost, their_position, _ = gtsam_optimum(position, quat, dataclasses.replace(edges, information=with_rotation))
    found = solve_closure_graph(position, quat, dataclasses.replace(edges, information=without), GIVEN)
    assert found.converged
    assert found.cost == pytest.approx(cost, rel=1e-6)
    np.testing.assert_allclose(found.position_m, their_position, atol=1e-3)


def test_an_unconverged_solve_says_so() -> None:
    position, quat, edges = closure_grid()
    found = solve_closure_graph(position, quat, edges, ClosureSettings(start="given", max_steps=1))
    assert found.result == "too many steps"
    assert not found.converged


def test_sessions_whose_every_tie_was_rejected_are_refused() -> None:
    _, _, edges = closure_grid()
    across = (edges.first < 32) & (edges.second >= 32)
    with pytest.raises(
        UndeterminedError, match=r"every closure that ties pose 32 \(and 31 more\) .* 8 of 112 edges are"
    ):
        check_pieces(64, edges, np.where(across, 0.0, 1.0))
    check_pieces(64, edges, np.where(across & (edges.first != 27), 0.0, 1.0))


def replaced(edges: RelativePoses, name: str, row: int, value) -> RelativePoses:
    values = getattr(edges, name).copy()
    values[row] = value
    return dataclasses.replace(edges, **{name: values})


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("second", 3, r"edge 3 \(pose 3 to pose 3\): ties a pose to itself"),
        ("second", 64, r"edge 3 \(pose 3 to pose 64\): expected poses between 0 and 63"),
        ("t_m", np.nan, r"edge 3 .*: holds a number that is not finite"),
        ("quat_wxyz", [2.0, 0, 0, 0], r"edge 3 .*: quaternion .* has length 2; expected 1"),
        ("information", -np.eye(6), r"edge 3 .*: its information matrix has the diagonal \[-1"),
        ("information", np.eye(6) + np.eye(6)[::-1] * 2, r"edge 3 .*: its information matrix has the eigenvalue -1"),
        ("information", np.eye(6) + np.eye(6, k=1), r"edge 3 .*: its information matrix is not symmetric"),
    ],
)
def test_bad_edges(name: str, value, message: str) -> None:
    position, quat, edges = closure_grid()
    with pytest.raises(GraphError, match=message):
        solve_closure_graph(position, quat, replaced(edges, name, 3, value))


def test_graph_in_pieces_and_bad_start() -> None:
    position, quat, edges = closure_grid()
    cut = edges.take(np.flatnonzero((edges.first < 40) == (edges.second < 40)))
    with pytest.raises(
        GraphError, match=r"in 2 pieces: no edges lead from pose 0 to pose 40 \(its piece has 24 poses\)"
    ):
        solve_closure_graph(position, quat, cut)
    position[7, 1] = np.inf
    with pytest.raises(GraphError, match=r"start pose 7: .*expected finite numbers"):
        solve_closure_graph(position, quat, edges)


def test_bad_settings() -> None:
    position, quat, edges = closure_grid()
    for settings, message in (
        (ClosureSettings(loss="hubert"), "loss 'hubert' is unknown; expected one of none, cauchy"),  # type: ignore[arg-type]
        (ClosureSettings(start="warm"), "start 'warm' is unknown; expected one of given, chordal, best"),  # type: ignore[arg-type]
        (ClosureSettings(loss_width=0.0), "robust width 0.0 is not positive"),
        (ClosureSettings(max_steps=0), "max_steps 0 is below 1"),
    ):
        with pytest.raises(ConfigError, match=message):
            solve_closure_graph(position, quat, edges, settings)
