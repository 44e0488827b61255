"""The restricted likelihood against the pose graph's own, against dense formulas, and its derivatives."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from solve.chain_session import graph_of, session
from solve.programs import optimum
from solve.revisited_session import LOCATIONS, OPTIONS, WIDTH, moved, revisited_session, tables, without

from calibration.observations import Learnable, ObservationSet, learnable
from calibration.reml import Contrasts, Prior, contrasts, derivatives, hessian, log_predictive, negative_log_posterior
from jaxgeo.graph.anchor_table import AnchorTable
from jaxgeo.graph.components import BIAS_ROT, BIAS_TRANS, LOG_SCALE, N_COMPONENTS, N_WHITE, white_noise_of
from jaxgeo.graph.noise import odometry_noise
from jaxgeo.graph.pose_graph import PoseGraph, Terms
from jaxgeo.solve.anchor_system import AnchorSystem, Observed, State, anchor_system, chain_linearised
from jaxgeo.solve.ensemble_fold import observe, start_of
from jaxgeo.solve.fold import FoldOptions
from jaxgeo.solve.likelihood import negative_log_likelihood

SIGMA = np.array([0.1, 0.12, 0.08, 4e-3, 3e-3, 5e-3, 3e-3, 0.02, 0.01, 4e-3, 4e-4, 0.02, 0.02, 1e-3, 0.1, 0.5])
NOISE = odometry_noise([0.1, 0.12, 0.08], [0.004, 0.003, 0.005], 0.003)
ALL = np.arange(N_COMPONENTS)

system_at = jax.jit(lambda state, observed: anchor_system(state, chain_linearised(state, observed.graph), observed))
contrasts_of = jax.jit(contrasts)
value_of = jax.jit(negative_log_posterior)
predictive_of = jax.jit(log_predictive)


def flat_prior(free=ALL) -> Prior:
    on = jnp.asarray(np.isin(ALL, free).astype(float))
    return Prior(jnp.zeros(N_COMPONENTS), jnp.zeros((N_COMPONENTS, N_COMPONENTS)), on)


def some_prior(free=ALL) -> Prior:
    rng = np.random.default_rng(8)
    root = rng.standard_normal((N_COMPONENTS, N_COMPONENTS)) / 4.0
    on = np.isin(ALL, free).astype(float)
    precision = (root @ root.T + np.eye(N_COMPONENTS)) * on[:, None] * on[None]
    return Prior(jnp.asarray(np.log(SIGMA) + 0.3), jnp.asarray(precision), jnp.asarray(on))


@functools.partial(jax.jit, static_argnames="options")
def observed_of(chain, table: AnchorTable, use, relative, options=OPTIONS) -> tuple[Observed, State]:
    observed, _ = observe(chain, table, use, relative, WIDTH, options)
    return observed, start_of(observed)


def learned_from(made, use, observations: ObservationSet, state: State | None = None):
    chain, table = tables(made)
    masks = learnable(table, use, observations)
    observed, start = observed_of(chain, table, use, masks.relative)
    system = system_at(start if state is None else state, observed)
    return contrasts_of(system, masks), system, masks, start


@pytest.fixture(scope="module")
def made():
    return revisited_session(3, noise=NOISE)


@pytest.fixture(scope="module")
def use(made):
    return tables(made)[1].real


@pytest.fixture(scope="module")
def found(made, use) -> Contrasts:
    return learned_from(made, use, "both")[0]


@pytest.mark.parametrize("rotation", [False, True])
def test_differences_are_those_of_the_pose_graph(rotation):
    """White noise, log-scale and isotropic bias: what both likelihoods know. Positions alone, or rotations too."""
    terms = Terms(rotation=rotation, log_scale=True, bias=True)
    options = {"sigma_rot_rad": 0.02} if rotation else {}
    graph = optimum(graph_of(session(100, 7, lever_m=1.0, **options), terms))
    k = graph.anchors.pose_index.shape[0]
    free = np.array([*range(N_WHITE), LOG_SCALE, BIAS_TRANS, BIAS_ROT])
    ours = eqx.tree_at(lambda g: g.terms, graph, Terms(rotation=rotation, log_scale=True))
    used = jnp.asarray((np.arange(k) < 7).astype(float))
    nothing, place = jnp.zeros((k, 3, 3)), jnp.arange(k)
    observed = Observed(ours, used, jnp.zeros(k), place, nothing, jnp.asarray(100.0), jnp.asarray(10.0))
    zero = jnp.zeros_like(graph.chain.length_m)
    # The optimum holds a bias of the session: noise of the edges as well as any other, here.
    system = system_at(State(graph.base, graph.base_globals.log_scale, (zero, zero, zero)), observed)
    same = jnp.eye(k)
    got = contrasts_of(system, Learnable(jnp.zeros(k), used, jnp.zeros(k), same))
    assert float(got.count) == 7 * (6 if rotation else 3) - 6

    @jax.jit
    def theirs(graph: PoseGraph) -> jax.Array:
        return negative_log_likelihood(graph, graph.base, graph.base_globals)

    values = []
    for seed in range(4):
        sigma = SIGMA * np.exp(np.random.default_rng(seed).normal(0.0, 0.8, N_COMPONENTS)) * np.isin(ALL, free)
        theta = jnp.log(jnp.asarray(np.where(sigma > 0, sigma, 1.0)))
        with_noise = eqx.tree_at(lambda g: g.noise, graph, white_noise_of(sigma))
        values.append((float(value_of(theta, (got, flat_prior(free)))), float(theirs(with_noise))))
    difference = np.diff(np.array(values), axis=0)
    assert np.abs(difference).min() > 0.05
    assert_allclose(difference[:, 0], difference[:, 1], rtol=0, atol=1e-6)


def test_gradient_and_hessian(found):
    for free in (ALL, np.array([0, 1, 2, 7, 14])):
        args = found, some_prior(free)
        theta = jnp.asarray(np.log(SIGMA) + np.random.default_rng(1).normal(0.0, 0.5, N_COMPONENTS))
        closed = jax.jit(derivatives)(theta, args)
        assert_allclose(closed.value, value_of(theta, args), rtol=1e-12)
        gradient = jax.jit(jax.grad(negative_log_posterior))(theta, args)
        assert np.abs(gradient[jnp.asarray(free)]).min() > 1e-6
        assert_allclose(closed.gradient, gradient, rtol=1e-8, atol=1e-9)
        exact = np.array(jax.jit(jax.hessian(negative_log_posterior))(theta, args))
        frozen = np.setdiff1d(ALL, free)
        exact[frozen, frozen] = 1.0
        assert_allclose(jax.jit(hessian)(theta, args), exact, rtol=1e-7, atol=1e-8)


def test_average_information_is_half_observed_and_half_expected(found):
    """Expected: `1/2 tr(M^-1 dM_i M^-1 dM_j)`; the observed one by automatic derivatives in the variances, in which
    M is linear and the two halves are exact; and its mean over data that the noise itself makes is the expected one."""
    prior = flat_prior()
    theta = jnp.log(jnp.asarray(SIGMA))
    variance = SIGMA**2

    def of_variance(v: jax.Array, c: jax.Array) -> jax.Array:
        m = found.base + jnp.einsum("c,cxy->xy", v, found.components)
        return 0.5 * c @ jnp.linalg.solve(m, c) + 0.5 * jnp.linalg.slogdet(m)[1]

    m = np.asarray(found.base) + np.einsum("c,cxy->xy", variance, np.asarray(found.components))
    times = np.linalg.solve(m[None], np.asarray(found.components))
    expected = 0.5 * np.einsum("ixy,jyx->ij", times, times)
    scale = 2.0 * variance[:, None] * 2.0 * variance[None]
    observed_of_variance = jax.jit(jax.hessian(of_variance))
    information = jax.jit(lambda c: derivatives(theta, (eqx.tree_at(lambda f: f.c, found, c), prior)).information)
    rng = np.random.default_rng(4)
    drawn = np.linalg.cholesky(m) @ rng.standard_normal((len(m), 4000))
    c = jnp.asarray(drawn[:, 0])
    half = 0.5 * (np.asarray(observed_of_variance(jnp.asarray(variance), c)) + expected) * scale
    assert_allclose(information(c), half, rtol=1e-6, atol=1e-7 * np.abs(half).max())
    mean = np.mean([np.asarray(i) for i in jax.lax.map(information, jnp.asarray(drawn.T))], axis=0)
    assert_allclose(mean, expected * scale, rtol=0, atol=0.08 * np.abs(expected * scale).max())


def restricted(theta: np.ndarray, system: AnchorSystem, x: np.ndarray, rows: np.ndarray) -> float:
    """`1/2 (log det M + log det X'M^-1 X + c'Pc)`, the nuisances X integrated out: Harville (1974)."""
    m = np.asarray(system.base) + np.einsum("c,cxy->xy", np.exp(2.0 * theta), np.asarray(system.components))
    m, c = m[np.ix_(rows, rows)], np.asarray(system.residual)[rows]
    information = x.T @ np.linalg.solve(m, x)
    off = c - x @ np.linalg.solve(information, x.T @ np.linalg.solve(m, c))
    log_det = np.linalg.slogdet(m)[1] + np.linalg.slogdet(information)[1]
    return 0.5 * (log_det + off @ np.linalg.solve(m, off))


def differences(function) -> np.ndarray:
    thetas = np.log(SIGMA) + np.random.default_rng(2).normal(0.0, 0.7, (4, N_COMPONENTS))
    return np.diff([float(function(theta)) for theta in thetas])


def unknown_position_columns(system: AnchorSystem, visits: list[int]) -> np.ndarray:
    """Moving the location moves what both visits' rows expect, in the rows' whitened units."""
    k, d, _ = system.jacobian.shape
    columns = np.zeros((k, d, 3))
    columns[visits] = np.asarray(system.jacobian)[visits][..., :3]
    return columns.reshape(k * d, 3)


def test_unknown_coordinates_of_a_held_out_location_are_integrated_out(made, use):
    """A is held out, its two visits tie each other: 15 rows of the others and 6 of A, less the frame and A itself."""
    got, system, masks, _ = learned_from(made, without(tables(made)[1], 0), "both")
    assert float(got.count) == 15 + 6 - 6 - 3
    rows = np.flatnonzero(np.repeat(np.asarray(masks.learn), 3) > 0)
    gauge = np.array(system.jacobian)
    # A turned frame moves A's two visits as one, which its unknown position does already.
    gauge[[0, 6]] = 0.0
    x = np.concatenate([gauge.reshape(-1, 6), unknown_position_columns(system, [0, 6])], axis=1)[rows]
    expected = differences(lambda theta: restricted(theta, system, x, rows))
    assert np.abs(expected).min() > 0.05
    ours = differences(lambda theta: value_of(jnp.asarray(theta), (got, flat_prior())))
    assert_allclose(ours, expected, rtol=0, atol=1e-6)
    # A prior of 10 km on the location, instead of none at all.
    wide = x[:, 6:] * 1e4

    def with_prior(theta: np.ndarray) -> float:
        m = np.asarray(system.base).copy()
        m[np.ix_(rows, rows)] += wide @ wide.T
        return restricted(theta, eqx.tree_at(lambda s: s.base, system, jnp.asarray(m)), x[:, :6], rows)

    assert_allclose(ours, differences(with_prior), rtol=0, atol=1e-4)


def test_one_revisit_alone_gives_three_numbers(made, use):
    """However far drift keeps its visits apart at the linearisation: their difference, along every axis."""
    got, system, _, _ = learned_from(made, use, "revisit")
    assert float(jnp.linalg.norm(system.point_m[0] - system.point_m[6])) > 0.05
    assert float(got.count) == 3

    def of_difference(theta: np.ndarray) -> float:
        m = np.asarray(system.base) + np.einsum("c,cxy->xy", np.exp(2.0 * theta), np.asarray(system.components))
        # In metres, and the survey's error, which both share, cancels.
        weight = np.linalg.inv(np.asarray(system.jacobian)[[0, 6], :, :3])
        a = np.zeros((3, m.shape[0]))
        a[:, 0:3], a[:, 18:21] = weight[0], -weight[1]
        c, covariance = a @ np.asarray(system.residual), a @ m @ a.T
        return 0.5 * (c @ np.linalg.solve(covariance, c) + np.linalg.slogdet(covariance)[1])

    ours = differences(lambda theta: value_of(jnp.asarray(theta), (got, flat_prior())))
    assert_allclose(ours, differences(of_difference), rtol=0, atol=1e-6)


def test_a_revisit_s_rotations_are_read_without_the_marker_s():
    """Six numbers of one revisit; a marker surveyed 0.01 rad otherwise changes nothing, but for the logarithm."""
    options = FoldOptions(terms=Terms(rotation=True, log_scale=True))
    made = session(100, 7, lever_m=1.0, sigma_rot_rad=0.02, location=LOCATIONS)
    chain, table = tables(made)
    masks = learnable(table, table.real, "revisit")
    turn = jnp.asarray(Rotation.from_rotvec([0.01, -0.006, 0.004]).as_matrix())
    turned = jnp.where((table.location == 0)[:, None, None], turn[None] @ table.rotation, table.rotation)
    found, values = [], []
    for each in (table, eqx.tree_at(lambda t: t.rotation, table, turned)):
        observed, start = observed_of(chain, each, table.real, masks.relative, options)
        found.append(contrasts_of(system_at(start, observed), masks))
        values.append(differences(lambda theta, f=found[-1]: value_of(jnp.asarray(theta), (f, flat_prior()))))
    assert float(found[0].count) == 6
    assert np.abs(values[0]).min() > 0.1
    assert_allclose(values[0], values[1], rtol=1e-2, atol=1e-2)


def test_revisits_are_read_without_any_coordinates(made, use):
    """Every location moved its own way, at one linearisation: the contrasts stay."""
    got, _, _, state = learned_from(made, use, "revisit")
    other = made
    for location in range(len(set(LOCATIONS))):
        other = moved(other, location, 3.0 * (location + 1))
    there, system, _, _ = learned_from(other, use, "revisit", state)
    _, here, _, _ = learned_from(made, use, "revisit", state)
    # The origin, whole metres, has moved too: of the state, as far as it is a frame's, nothing else was read.
    assert np.abs(np.asarray(system.residual - here.residual)).max() > 10.0
    ours, theirs = (
        differences(lambda theta, f=f: value_of(jnp.asarray(theta), (f, flat_prior()))) for f in (got, there)
    )
    assert_allclose(ours, theirs, rtol=0, atol=1e-6)


def test_anchors_alone_do_not_see_held_out_visits(made):
    """Not their coordinates, nor that they were seen: moved lever arms of the held-out visits change nothing."""
    _, table = tables(made)
    use = without(table, 0)
    got = learned_from(made, use, "anchors")[0]
    assert float(got.count) == 15 - 6
    seen = eqx.tree_at(lambda a: a.lever_arm_m, made.anchors, made.anchors.lever_arm_m.copy())
    seen.lever_arm_m[[0, 6]] += 2.0
    other = type(made)(made.truth, made.trajectory, seen, made.noise)
    for a, b in zip(jax.tree.leaves(got), jax.tree.leaves(learned_from(other, use, "anchors")[0]), strict=True):
        assert np.array_equal(a, b)
    both = [learned_from(m, use, "both")[0] for m in (made, other)]
    assert not np.array_equal(both[0].c, both[1].c)


def test_every_location_as_the_others_predict_it(made, use, found):
    """Differences of restricted likelihoods with and without the location's rows, visits of one location together."""
    system = learned_from(made, use, "both")[1]
    x, location = np.asarray(system.jacobian).reshape(-1, 6), np.asarray(tables(made)[1].location)
    every = np.flatnonzero(np.repeat(np.asarray(use), 3) > 0)
    assert int(found.location_rows.sum()) == len(every)

    def expected(theta: np.ndarray) -> float:
        whole = restricted(theta, system, x[every], every)
        parts = [np.flatnonzero(np.repeat((location != one) & (location >= 0), 3)) for one in range(6)]
        return sum(restricted(theta, system, x[rows], rows) - whole for rows in parts)

    ours = differences(lambda theta: predictive_of(jnp.asarray(theta), (found, flat_prior())))
    assert np.abs(ours).min() > 0.05
    assert_allclose(ours, differences(expected), rtol=0, atol=1e-6)


def test_a_location_that_the_frame_needs_is_not_predicted(made, use):
    """Of three locations each: whatever the noise, none has a density, not even that of rounding."""
    three = jnp.asarray([0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0])
    got = learned_from(made, three, "anchors")[0]
    assert float(got.count) == 3
    assert np.array_equal(
        differences(lambda theta: predictive_of(jnp.asarray(theta), (got, flat_prior()))), np.zeros(3)
    )


def test_nothing_to_learn_from(made, use):
    """No location visited twice: revisits leave no contrast, and the likelihood is flat."""
    chain, table = tables(made)
    single = eqx.tree_at(lambda t: t.location, table, jnp.arange(len(use)))
    masks = learnable(single, use, "revisit")
    observed, start = observed_of(chain, single, use, masks.relative)
    got = contrasts_of(system_at(start, observed), masks)
    assert float(got.count) == 0
    assert np.array_equal(differences(lambda theta: value_of(jnp.asarray(theta), (got, flat_prior()))), np.zeros(3))
