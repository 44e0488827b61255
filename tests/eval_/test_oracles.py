"""The evaluation's figures against others' programs and plain loops: evo, GTSAM, NumPy."""

import dataclasses
import itertools

import jax.numpy as jnp
import numpy as np
import pytest
from eval_.small_problem import SETTINGS, problem
from eval_.test_reference import as_evo, drifted, walk
from evo.core import metrics
from evo.core.geometry import umeyama_alignment
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation
from solve.chain_session import NOISE, compiled_fold_graph, session
from solve.gtsam_peer import gtsam_graph, gtsam_solve, gtsam_values

from eval.loo import correct_and_hold_out
from eval.reference import relative_errors
from eval.subsets import fixed_subsets, similarity_subsets
from jaxgeo.data import Anchors, Trajectory
from jaxgeo.geometry import umeyama
from jaxgeo.graph.anchor_table import anchor_table
from jaxgeo.graph.chain import chain_of
from jaxgeo.solve.correct import Settings
from jaxgeo.solve.fold import FoldOptions

N = 100
FOLDED = ("A", "B", "C", "D", "E", "F", "A")


# --- trajectories against a reference: evo ---


@pytest.mark.parametrize(
    ("distance_m", "delta", "unit"),
    [(5.0, 5.0, metrics.Unit.meters), (17.3, 17.3, metrics.Unit.meters), (0.0, 1, metrics.Unit.frames)],
    ids=["5 m", "17.3 m", "successive poses"],
)
def test_consecutive_relative_errors_as_evo(distance_m, delta, unit):
    reference, estimate = walk(), drifted(walk())
    (found,) = relative_errors(estimate, reference, [distance_m], pairs="consecutive")
    for relation, ours in (
        (metrics.PoseRelation.translation_part, found.translation_rmse_m),
        (metrics.PoseRelation.rotation_angle_rad, found.rotation_rmse_rad),
    ):
        rpe = metrics.RPE(relation, delta, unit, all_pairs=False, pairs_from_reference=True)
        rpe.process_data((as_evo(reference), as_evo(estimate)))
        assert found.count == len(rpe.error)
        assert_allclose(ours, rpe.get_statistic(metrics.StatisticsType.rmse), rtol=1e-9)


def test_relative_errors_of_all_and_of_consecutive_pairs_are_not_the_same():
    every, consecutive = (
        relative_errors(drifted(walk()), walk(), [5.0], pairs=pairs)[0] for pairs in ("all", "consecutive")
    )
    assert every.count > 10 * consecutive.count > 100
    assert every.translation_rmse_m != pytest.approx(consecutive.translation_rmse_m, rel=1e-6)


@pytest.mark.parametrize("scale", [True, False], ids=["scale", "no scale"])
@pytest.mark.parametrize("mirrored", [False, True], ids=["", "mirrored"])
def test_umeyama_as_evo(scale, mirrored):
    rng = np.random.default_rng(3)
    source = rng.uniform(-20, 20, (12, 3))
    target = 1.3 * Rotation.random(rng=rng).apply(source) + [400.0, -200.0, 30.0] + rng.normal(0, 0.5, (12, 3))
    if mirrored:
        target[:, 2] *= -1.0
    turn, shift, factor = umeyama_alignment(source.T, target.T, scale)
    found = umeyama(jnp.asarray(source), jnp.asarray(target), scale=scale)
    assert_allclose(found.sim3.rotation, turn, atol=1e-10)
    assert_allclose(found.sim3.scale, factor if scale else 1.0, rtol=1e-12)
    assert_allclose(found.sim3.translation_m, shift, atol=1e-8)
    left = target - (factor * source @ turn.T + shift)
    assert_allclose(found.rms_m, np.sqrt(np.mean(np.sum(left**2, axis=1))), rtol=1e-10)


# --- the similarity's choices: plain loops ---


def umeyama_loop(source: np.ndarray, target: np.ndarray, scale: bool) -> tuple[float, np.ndarray, np.ndarray]:
    """Umeyama (1991), equations 34 to 43, point by point."""
    n = len(source)
    mean_x, mean_y = sum(source) / n, sum(target) / n
    covariance = sum(np.outer(y - mean_y, x - mean_x) for x, y in zip(source, target, strict=True)) / n
    variance = sum(np.dot(x - mean_x, x - mean_x) for x in source) / n
    u, d, vt = np.linalg.svd(covariance)
    s = np.eye(3)
    if np.linalg.det(u @ vt) < 0:
        s[2, 2] = -1.0
    turn = u @ s @ vt
    factor = np.trace(np.diag(d) @ s) / variance if scale else 1.0
    return factor, turn, mean_y - factor * turn @ mean_x


@pytest.mark.parametrize("visits", ["all", "first"])
@pytest.mark.parametrize("scale", [True, False], ids=["scale", "no scale"])
def test_similarity_of_every_choice_as_a_plain_loop(visits, scale):
    trajectory, anchors = problem()
    names = tuple(dict.fromkeys(anchors.location))
    marker = [
        trajectory.position_m[i] + Rotation.from_quat(trajectory.quat_wxyz[i], scalar_first=True).apply(lever)
        for i, lever in zip(anchors.pose_index, anchors.lever_arm_m, strict=True)
    ]
    taking_part = [v for v, name in enumerate(anchors.location) if visits == "all" or v == anchors.location.index(name)]
    found = similarity_subsets(trajectory, anchors, Settings(coarse_scale=scale), visits=visits)
    assert [each.k for each in found] == [6, 5, 4, 3]
    for each in found:
        choices = list(itertools.combinations(names, each.k))
        assert len(choices) == len(each.used) == each.n_possible
        for row, chosen in enumerate(choices):
            fitted = [v for v in taking_part if anchors.location[v] in chosen]
            surveyed = anchors.surveyed_enh_m
            factor, turn, shift = umeyama_loop(
                np.array([marker[v] for v in fitted]), np.array([surveyed[v] for v in fitted]), scale
            )
            for v in range(len(anchors)):
                error_m = np.linalg.norm(factor * turn @ marker[v] + shift - surveyed[v])
                inside, outside = each.in_sample_m[row, v], each.held_out_m[row, v]
                if v in fitted:
                    assert inside == pytest.approx(error_m, abs=1e-9)
                    assert np.isnan(outside)
                elif v in taking_part:
                    assert outside == pytest.approx(error_m, abs=1e-9)
                    assert np.isnan(inside)
                else:
                    assert np.isnan(inside)
                    assert np.isnan(outside)


# --- the pose graph's folds: GTSAM ---


def gtsam_markers(trajectory: Trajectory, anchors: Anchors, used: list[int]) -> np.ndarray:
    """All markers as GTSAM's optimum of the graph with only some of the anchors has them, local frame."""
    columns = {f.name: getattr(anchors, f.name) for f in dataclasses.fields(Anchors)}
    few = {n: tuple(c[i] for i in used) if isinstance(c, tuple) else c[np.array(used)] for n, c in columns.items()}
    few["location_index"] = np.unique(few["location_index"], return_inverse=True)[1]
    chain = chain_of(trajectory)
    table = anchor_table(Anchors(**few), chain)
    graph, _, _, origin = compiled_fold_graph(chain, table, NOISE, table.real, jnp.asarray(3.0), FoldOptions())
    values = gtsam_solve(gtsam_graph(graph, len(trajectory), len(used)), gtsam_values(graph, len(trajectory)))
    poses = [values.atPose3(int(i)) for i in anchors.pose_index]
    seen = [pose.transformFrom(lever) for pose, lever in zip(poses, anchors.lever_arm_m, strict=True)]
    return np.array(seen) + np.asarray(origin)


def test_fixed_noise_folds_and_choices_as_gtsam():
    made = session(N, len(FOLDED), lever_m=1.0, location=FOLDED)
    trajectory, anchors = made.trajectory, made.anchors
    _, held_out = correct_and_hold_out(trajectory, anchors, NOISE, SETTINGS)
    for location in dict.fromkeys(FOLDED):
        rest = [v for v, name in enumerate(FOLDED) if name != location]
        found = gtsam_markers(trajectory, anchors, rest)
        for v in (v for v, name in enumerate(FOLDED) if name == location):
            assert_allclose(held_out.point_m[v], found[v], atol=1e-5)
    subsets = fixed_subsets(trajectory, anchors, NOISE, SETTINGS, [3])[0]
    assert not subsets.failed.any()
    for row in range(0, len(subsets.used), 4):
        used = [v for v, i in enumerate(anchors.location_index) if subsets.used[row, i]]
        error_m = np.linalg.norm(gtsam_markers(trajectory, anchors, used) - anchors.surveyed_enh_m, axis=1)
        ours = np.where(np.isnan(subsets.in_sample_m[row]), subsets.held_out_m[row], subsets.in_sample_m[row])
        # Three anchors hold the ends weakly: the cost is flat to a tenth of a millimetre there.
        assert_allclose(ours, error_m, atol=1e-4)
        assert_array_equal(np.flatnonzero(np.isfinite(subsets.in_sample_m[row])), used)
