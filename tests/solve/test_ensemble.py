"""A known ensemble: one set is the pose graph, its small system is dense kriging, several sets are a mixture."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from solve.dense_drift import dense_covariance_between
from solve.revisited_session import LOCATIONS, OPTIONS, WIDTH, moved, revisited_session, tables

from jaxgeo.graph.components import BOUNDED, COMPONENTS, N_COMPONENTS, NoiseEnsemble, ensemble_of
from jaxgeo.graph.noise import odometry_noise
from jaxgeo.graph.pose_graph import Terms, at_anchors
from jaxgeo.solve.anchor_system import AnchorSystem, anchor_system, chain_linearised
from jaxgeo.solve.ensemble import SetSolution, solve_set
from jaxgeo.solve.ensemble_fold import (
    CHUNK,
    SETTLED_M,
    EnsembleFold,
    covariance_at,
    marker_m,
    move,
    solve_ensemble,
)
from jaxgeo.solve.fold import FoldOptions, solve_fold
from jaxgeo.solve.linearise import Edges
from jaxgeo.solve.measurement_space import farthest_m
from jaxgeo.solve.posterior import pose_covariance, posterior

NOISE = odometry_noise([0.1, 0.12, 0.08], [0.004, 0.003, 0.005], 0.003, 0.02, 0.004, 0.0004)
SEVEN = tuple("ABCDEFG")
# All components at once, of the size of the white noise's displacements; `anchor_factor` adds 0.25 to every variance.
EVERYTHING = (0.1, 0.12, 0.08, 0.004, 0.003, 0.005, 0.003, 0.02, 0.01, 0.004, 0.0004, 0.02, 0.02, 0.001, 0.1, 0.5)
EXACT_ANCHORS = (*EVERYTHING[:15], 0.0)
CORRELATION_M = 11.0


def solved(made, *sigmas, weight=(1.0, 0.0, 0.0), use=None) -> EnsembleFold:
    """Of three sets always, so that one program serves: fewer are repeated, without weight."""
    chain, table = tables(made)
    sets = np.resize(np.array(sigmas, dtype=float), (3, N_COMPONENTS))
    noise = NoiseEnsemble(jnp.asarray(sets), jnp.asarray(np.array(weight)), jnp.asarray(CORRELATION_M))
    fold = solve_ensemble(chain, table, noise, table.real if use is None else use, WIDTH, OPTIONS)
    assert bool(fold.settled)
    return fold


def only(component: int) -> np.ndarray:
    """One component, and enough rotation noise for the chain to be able to move."""
    sigma = 0.3 * np.array(EVERYTHING) * (np.arange(N_COMPONENTS) < 7)
    sigma[component] = 3.0 * EVERYTHING[component]
    return sigma


@pytest.fixture(scope="module")
def revisited():
    return revisited_session(1, noise=NOISE)


@pytest.fixture(scope="module")
def pose_graph():
    """Every location visited once: the same anchors by both solvers, one of them held out."""
    made = revisited_session(2, noise=NOISE, locations=SEVEN)
    chain, table = tables(made)
    use = table.real.at[3].set(0.0)
    options = FoldOptions(terms=Terms(log_scale=True, bias=True))
    fold, graph = solve_fold(chain, table, NOISE, use, WIDTH, options)
    (sigma,) = ensemble_of(NOISE).sigma
    return fold, graph, solved(made, sigma, use=use)


def test_one_set_is_the_pose_graph(pose_graph):
    fold, _, found = pose_graph
    state, theirs = found.state, fold.solution.poses
    for a, b in zip((*state.poses.t, *state.poses.quat), (*theirs.t, *theirs.quat), strict=True):
        assert_allclose(a, b, rtol=0, atol=1e-6)
    assert_allclose(state.log_scale, fold.solution.glob.log_scale, rtol=0, atol=1e-7)
    assert abs(float(state.log_scale)) > 1e-4
    assert_allclose(found.point_m, fold.point_m, rtol=0, atol=1e-6)
    assert_allclose(found.origin_m, fold.origin_m)
    assert_allclose(found.error_covariance_m2, fold.error_covariance_m2, rtol=1e-4, atol=1e-10)


def test_covariances_of_one_set_are_those_of_the_pose_graph(pose_graph):
    fold, graph, found = pose_graph
    index = jnp.asarray(np.linspace(0, 119, CHUNK).round().astype(int))

    @jax.jit
    def expected(graph, solution):
        return pose_covariance(posterior(graph, solution.poses, solution.glob), index)

    theirs = np.asarray(expected(graph, fold.solution))
    sigma = np.sqrt(np.diagonal(theirs, axis1=1, axis2=2))
    off = (np.asarray(covariance_at(found, index)) - theirs) / (sigma[:, :, None] * sigma[:, None])
    assert np.abs(off).max() < 1e-4


@pytest.mark.parametrize("component", range(N_COMPONENTS), ids=COMPONENTS)
def test_the_poses_are_where_the_small_system_predicts(revisited, component):
    """Forces through the chain, edge by edge, against the anchors' dense system: one fixed point."""
    found = solved(revisited, only(component))
    k = len(LOCATIONS)
    point = np.asarray(marker_m(found.state, found.observed) + found.origin_m[None])[:k]
    assert_allclose(point, np.asarray(found.point_m)[:k], rtol=0, atol=2e-6)
    # And the component did something.
    without = only(component)
    without[component] = 0.0 if component > 6 else 0.5 * without[component]
    assert np.abs(point - np.asarray(solved(revisited, without).point_m)[:k]).max() > 1e-5


@jax.jit
def linearised(found: EnsembleFold, sigma: jax.Array) -> tuple[Edges, AnchorSystem, SetSolution]:
    chain = chain_linearised(found.state, found.observed.graph)
    system = anchor_system(found.state, chain, found.observed)
    return chain.edges, system, solve_set(system, sigma)


def dense_prediction(found: EnsembleFold, sigma, use, survey):
    """Kriging in metres: nothing whitened, the survey's error in common for visits of one location."""
    observed, graph = found.observed, found.observed.graph
    edges, system, ours = linearised(found, jnp.asarray(sigma))
    index, point = np.asarray(graph.anchors.pose_index), np.asarray(system.point_jacobian)
    k = len(index)
    per_component = dense_covariance_between(point, index, point, index, edges, graph, CORRELATION_M)
    prior = np.einsum("c,cxy->xy", np.asarray(sigma) ** 2, per_component)
    rotation = np.asarray(at_anchors(found.state.poses, graph).rotation)
    seen = rotation @ survey[1] @ np.swapaxes(rotation, 1, 2)
    location = np.asarray(observed.location)
    noise = np.einsum("kl,kab->kalb", location[:, None] == location[None], survey[0]).reshape(3 * k, 3 * k)
    noise = noise + np.einsum("kl,kab->kalb", np.eye(k), seen).reshape(3 * k, 3 * k)
    noise = noise * (1.0 + np.asarray(sigma)[-1] ** 2)
    rows = np.flatnonzero(np.repeat(use, 3) > 0)
    gauge = point.reshape(-1, 6)
    measured = np.asarray(graph.anchors.measured_m).reshape(-1)
    off = measured[rows] - np.asarray(system.point_m).reshape(-1)[rows]
    inverse = np.linalg.inv((prior + noise)[np.ix_(rows, rows)])
    h = gauge[rows]
    gauge_covariance = np.linalg.inv(h.T @ inverse @ h)
    delta = gauge_covariance @ h.T @ inverse @ off
    gain = prior[:, rows] @ inverse
    mean = np.asarray(system.point_m) + (gauge @ delta + gain @ (off - h @ delta)).reshape(k, 3)
    lever = gauge - gain @ h
    covariance = prior - gain @ prior[rows] + lever @ gauge_covariance @ lever.T
    blocks = covariance.reshape(k, 3, k, 3)[np.arange(k), :, np.arange(k)]
    return mean, blocks, ours


@pytest.mark.parametrize("survey_factor", [1.0, 3000.0])
def test_the_small_system_is_dense_kriging(revisited, survey_factor):
    """All components; visits of A share their survey's error, which may be far larger than everything else."""
    made = moved(revisited, 0, 0.0, survey_factor)
    _, table = tables(made)
    use = table.real.at[3].set(0.0)
    found = solved(made, EVERYTHING, use=use)
    survey = np.asarray(table.survey_covariance_m2), np.asarray(table.lever_covariance_m2)
    mean, covariance, ours = dense_prediction(found, EVERYTHING, use, survey)
    k = len(LOCATIONS)
    assert_allclose(ours.point_m[:k], mean[:k], rtol=0, atol=1e-6)
    assert_allclose(ours.point_covariance_m2[:k], covariance[:k], rtol=1e-4, atol=1e-8)


def test_a_location_of_unknown_coordinates_still_ties_its_visits(revisited):
    """Survey sigma 60 m: moving both visits' coordinates by metres moves nothing, yet the two predictions agree."""
    loose = [solved(moved(revisited, 0, shift, 3000.0), EXACT_ANCHORS) for shift in (0.0, 5.0)]
    assert_allclose(loose[0].point_m, loose[1].point_m, rtol=0, atol=0.02)
    gap = [float(jnp.linalg.norm(fold.point_m[0] - fold.point_m[6])) for fold in loose]
    assert max(gap) < 0.03
    apart = dataclasses.replace(revisited.anchors, location=SEVEN, location_index=np.arange(7))
    untied = solved(moved(dataclasses.replace(revisited, anchors=apart), 0, 0.0, 3000.0), EXACT_ANCHORS)
    assert float(jnp.linalg.norm(untied.point_m[0] - untied.point_m[6])) > 2.0 * max(gap)


def test_several_sets_are_a_mixture_of_their_predictions(revisited):
    """Each set's own solution is linearised elsewhere: they agree to a small share of what keeps them apart."""
    sets = [only(0), only(9), only(BOUNDED)]
    weight = np.array([0.5, 0.2, 0.3])
    both = solved(revisited, *sets, weight=weight)
    single = [solved(revisited, sigma) for sigma in sets]
    k = len(LOCATIONS)
    point = np.stack([np.asarray(fold.point_m)[:k] for fold in single])
    mean = np.einsum("q,qka->ka", weight, point)
    apart = np.abs(point - mean).max()
    assert apart > 0.01
    assert_allclose(np.asarray(both.point_m)[:k], mean, rtol=0, atol=0.02 * apart)
    off = point - mean
    within = np.einsum("q,qkab->kab", weight, np.stack([np.asarray(f.point_covariance_m2)[:k] for f in single]))
    expected = within + np.einsum("q,qka,qkb->kab", weight, off, off)
    assert_allclose(np.asarray(both.point_covariance_m2)[:k], expected, rtol=0, atol=0.02 * np.abs(expected).max())
    # The poses are at the mixture's mean, and their covariance has the spread in it.
    at_markers = np.asarray(marker_m(both.state, both.observed) + both.origin_m[None])[:k]
    assert_allclose(at_markers, np.asarray(both.point_m)[:k], rtol=0, atol=2e-6)
    index = np.zeros(CHUNK, dtype=int)
    index[:k] = np.asarray(both.observed.graph.anchors.pose_index)[:k]
    pose = np.asarray(covariance_at(both, jnp.asarray(index)))[:k]
    rotation = np.asarray(at_anchors(both.state.poses, both.observed.graph).rotation)[:k]
    x, y, z = (rotation @ np.asarray(both.observed.graph.anchors.lever_arm_m)[:k, :, None])[:, :, 0].T
    o = np.zeros(k)
    hat = np.moveaxis(np.array([[o, -z, y], [z, o, -x], [-y, x, o]]), -1, 0)
    reach = np.concatenate([np.broadcast_to(np.eye(3), (k, 3, 3)), -hat], axis=2)
    of_marker = reach @ pose @ np.swapaxes(reach, 1, 2)
    assert_allclose(of_marker, np.asarray(both.point_covariance_m2)[:k], rtol=1e-3, atol=1e-7)


def test_a_set_of_no_weight_changes_nothing(revisited):
    sets = [only(0), only(9), only(BOUNDED)]
    one = solved(revisited, *sets, weight=[1.0, 0.0, 0.0])
    alone = solved(revisited, sets[0])
    assert_allclose(one.point_m, alone.point_m, rtol=0, atol=1e-9)
    assert_allclose(one.point_covariance_m2, alone.point_covariance_m2, rtol=1e-9, atol=1e-12)


def test_poses_between_the_markers_are_at_rest_too():
    # Odometry that turns: the markers are at rest two steps before the poses between them.
    turning = odometry_noise([0.1, 0.12, 0.08], [0.024, 0.018, 0.03], 0.018, 0.02, 0.004, 0.0004)
    sigma = np.array(EVERYTHING)
    sigma[3:6] *= 6.0
    found = solved(revisited_session(1, noise=turning), sigma)
    again, _, _ = jax.jit(move)(found.state, found.observed, found.ensemble)
    assert float(farthest_m(found.state.poses, again.poses)) < SETTLED_M


def test_what_is_held_out_moves_nothing(revisited):
    """To the last bit: coordinates of a location whose anchors are not used."""
    _, table = tables(revisited)
    use = table.real * (table.location != 0).astype(float)
    here, there = (
        solved(moved(revisited, 0, shift, f), EVERYTHING, use=use) for shift, f in ((0.0, 1.0), (100.0, 9.0))
    )
    for name in ("state", "point_m", "point_covariance_m2", "origin_m", "rounds"):
        for a, b in zip(jax.tree.leaves(getattr(here, name)), jax.tree.leaves(getattr(there, name)), strict=True):
            assert np.array_equal(a, b), name
    assert not np.array_equal(here.error_covariance_m2, there.error_covariance_m2)
