"""What must not matter does not: held-out coordinates, origin, map frame, padding, how many folds go at once."""

import dataclasses

import equinox as eqx
import hypothesis
import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import RigidTransform, Rotation
from solve.chain_session import NOISE, Session, compiled_fold_graph, real_poses, session, trajectory_of, transforms
from solve.programs import EVERYTHING

import jaxgeo.graph.anchor_table
import jaxgeo.graph.chain
from jaxgeo.graph.anchor_table import AnchorTable, anchor_table
from jaxgeo.graph.chain import Chain, chain_of
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.solve.correct import Settings
from jaxgeo.solve.fold import Fold, FoldOptions, solve_folds

N, K = 100, 7
WIDTH, OPTIONS = jnp.asarray(3.0), Settings().fold_options(NOISE)


@pytest.fixture(scope="module")
def made() -> Session:
    return session(N, K, lever_m=1.0, sigma_rot_rad=0.02)


def inputs(made: Session) -> tuple[Chain, AnchorTable]:
    chain = chain_of(made.trajectory)
    return chain, anchor_table(made.anchors, chain)


def solved(made: Session, use: np.ndarray | None = None) -> Fold:
    chain, table = inputs(made)
    return one_fold(chain, table, made.noise, np.asarray(table.real) if use is None else use)


def one_fold(chain: Chain, table: AnchorTable, noise: OdometryNoise, use: np.ndarray) -> Fold:
    """With its poses: the same compiled program as `correct`'s."""
    found, first = solve_folds(chain, table, noise, jnp.asarray(use)[None], WIDTH, OPTIONS, 1)
    return eqx.tree_at(lambda f: f.solution.poses, jax.tree.map(lambda x: x[0], found), first)


def poses(fold: Fold) -> RigidTransform:
    """In the local frame."""
    return RigidTransform.from_translation(np.asarray(fold.origin_m)) * real_poses(fold.solution.poses, N)


def assert_same(a: Fold, b: Fold, atol: float = 1e-9) -> None:
    assert_allclose(poses(a).as_matrix(), poses(b).as_matrix(), rtol=0, atol=atol)
    for name in ("point_m", "coarse_point_m", "error_covariance_m2"):
        assert_allclose(getattr(a, name)[:K], getattr(b, name)[:K], rtol=0, atol=atol, err_msg=name)


def moved_where(table: AnchorTable, held_out: np.ndarray) -> AnchorTable:
    """The held-out anchors elsewhere and turned anyhow."""
    turned = jnp.asarray(Rotation.random(len(held_out), rng=np.random.default_rng(0)).as_matrix())
    out = jnp.asarray(held_out)
    return eqx.tree_at(
        lambda t: (t.surveyed_m, t.rotation),
        table,
        (
            table.surveyed_m + 100.0 * out[:, None].astype(float),
            jnp.where(out[:, None, None], turned, table.rotation),
        ),
    )


@pytest.mark.parametrize("held_out", [[0], [3], [2, 6]])
def test_coordinates_of_held_out_anchors_reach_nothing(made, held_out):
    """Not a bit of anything that a fold returns."""
    chain, table = inputs(made)
    out = np.isin(np.arange(table.real.shape[0]), held_out)
    use = np.asarray(table.real) * ~out
    found = [one_fold(chain, t, made.noise, use) for t in (table, moved_where(table, out))]
    for a, b in zip(*(jax.tree.leaves(f) for f in found), strict=True):
        assert np.array_equal(a, b)
    # Nor with rotations, scale and bias: the graph itself is the same.
    graphs = [
        compiled_fold_graph(chain, t, made.noise, jnp.asarray(use), WIDTH, FoldOptions(terms=EVERYTHING))
        for t in (table, moved_where(table, out))
    ]
    for a, b in zip(*(jax.tree.leaves(g) for g in graphs), strict=True):
        assert np.array_equal(a, b)
    # While they matter where they are used.
    assert not np.array_equal(found[0].point_m, solved(made).point_m)


def test_origin(made):
    """Coordinates with few bits, so that the shift itself is exact."""
    coarse_bits = np.round(made.anchors.surveyed_enh_m * 1024.0) / 1024.0
    shift = np.array([77_000.0, 5_491_000.0, 2_000.0])
    near, far = (
        solved(dataclasses.replace(made, anchors=dataclasses.replace(made.anchors, surveyed_enh_m=coarse_bits + by)))
        for by in (0.0, shift)
    )
    assert np.array_equal(np.asarray(near.origin_m) + shift, far.origin_m)
    for a, b in zip(jax.tree.leaves(near.solution), jax.tree.leaves(far.solution), strict=True):
        assert_allclose(a, b, rtol=0, atol=1e-9)
    assert_allclose(np.asarray(near.point_m)[:K] + shift, far.point_m[:K], rtol=0, atol=2e-9)


@hypothesis.given(seed=st.integers(0, 10_000), distance_m=st.sampled_from([0.0, 1.0, 1e3, 1e5]))
def test_frame_of_the_map(made, seed, distance_m):
    rng = np.random.default_rng(seed)
    frame = RigidTransform.from_components(distance_m * rng.standard_normal(3), Rotation.random(rng=rng))
    elsewhere = trajectory_of(frame * transforms(made.trajectory))
    # At 1e5 m and more, positions themselves are rounded to 1e-11 m.
    assert_same(solved(made), solved(dataclasses.replace(made, trajectory=elsewhere)), atol=2e-9)


def test_order_of_two_anchors_on_one_pose(made):
    a = made.anchors
    tie = a.pose_index.copy()
    tie[3] = tie[2]
    tied = dataclasses.replace(a, pose_index=tie)
    swap = np.array([0, 1, 3, 2, 4, 5, 6])
    swapped = dataclasses.replace(
        tied,
        lever_arm_m=a.lever_arm_m[swap],
        lever_covariance_m2=a.lever_covariance_m2[swap],
        surveyed_enh_m=a.surveyed_enh_m[swap],
        survey_covariance_m2=a.survey_covariance_m2[swap],
    )
    found = [solved(dataclasses.replace(made, anchors=x)) for x in (tied, swapped)]
    assert_allclose(poses(found[0]).as_matrix(), poses(found[1]).as_matrix(), rtol=0, atol=1e-9)
    assert_allclose(np.asarray(found[0].point_m)[swap], found[1].point_m[:K], rtol=0, atol=1e-9)


def test_padding_and_many_folds_at_once(made, monkeypatch):
    """Three folds, two at a time, in larger buckets: each is the single fold of the common buckets."""
    _, table = inputs(made)
    use = np.tile(np.asarray(table.real), (3, 1))
    use[1, 2] = use[2, 5] = 0.0
    expected = [solved(made, row) for row in use]
    monkeypatch.setattr(jaxgeo.graph.chain, "pose_bucket", lambda n: 160)
    monkeypatch.setattr(jaxgeo.graph.anchor_table, "anchor_bucket", lambda k: 10)
    chain, table = inputs(made)
    assert (chain.length_m.shape, table.real.shape) == ((160,), (10,))
    wider = jnp.asarray(np.pad(use, ((0, 0), (0, 2))))
    found, first = solve_folds(chain, table, made.noise, wider, WIDTH, OPTIONS, 2)
    for i, single in enumerate(expected):
        one = jax.tree.map(lambda x, i=i: x[i], found)
        for name in ("point_m", "coarse_point_m", "error_covariance_m2"):
            assert_allclose(getattr(one, name)[:K], getattr(single, name)[:K], rtol=0, atol=1e-9, err_msg=name)
        assert_allclose(one.gauge_sigma, single.gauge_sigma, rtol=1e-9)
        assert_allclose(one.solution.cost, single.solution.cost, rtol=1e-9)
        assert int(one.solution.steps) == int(single.solution.steps)
    here = real_poses(first, N).as_matrix()
    assert_allclose(here, real_poses(expected[0].solution.poses, N).as_matrix(), rtol=0, atol=1e-9)
