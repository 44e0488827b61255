"""The reference study's two findings on where anchors stand, predicted before anything is measured, and achieved.

(1) More anchors, smaller held-out errors. (2) A location on the line of its neighbours is held by them, and has a
smaller held-out error than one at the rim. Both follow from the prior covariance of the path alone; simulated sessions
of the study's layout, corrected under the noise that they were drawn from, say whether they come true.
"""

import dataclasses
import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from scipy.stats import rankdata

from calibration.transfer import transferred_folds
from eval.bootstrap import resampled_rows
from eval.collinearity import near_collinear, neighbours
from eval.montecarlo.regimes import Regime
from eval.montecarlo.sessions import GAP_S
from eval.montecarlo.settings import SOLVE
from eval.placement.plan import Plan, place_at_stamp, plan_of, wandering
from eval.placement.plan_drift import carried, covariance_of, own_covariance
from eval.placement.plan_visits import Sight, Visits
from eval.placement.predicted import Watched, posterior_of
from jaxgeo.associate import cut_visits, label_visits, make_anchors
from jaxgeo.data import Anchors
from jaxgeo.graph.anchor_table import anchor_table
from jaxgeo.graph.chain import chain_of
from jaxgeo.graph.components import NoiseEnsemble
from jaxgeo.simulate import Layout, simulate_session
from jaxgeo.simulate.layout import LOCATIONS, SURVEYED_ENH_M
from jaxgeo.simulate.session import ORIGIN_ENH_M, SURVEY_SIGMA_M, VISIT_SIGMA_M, SimulatedSession
from jaxgeo.simulate.true_noise import true_noise

LEAST = 3
_SURVEYED = dict(zip(LOCATIONS, SURVEYED_ENH_M, strict=True))


@dataclasses.dataclass(frozen=True)
class Spread:
    """A figure, and the range that it is in: over choices of anchors where predicted, over sessions where achieved."""

    value: float
    low: float
    high: float


@dataclasses.dataclass(frozen=True)
class CountRow:
    """RMS held-out error of the median choice of k locations.

    `predicted`: with the 16 to 84 % range over choices; `achieved`: with a 95 % bootstrap interval over sessions.
    """

    k: int
    choices: int
    predicted: Spread
    achieved: Spread


@dataclasses.dataclass(frozen=True)
class Findings:
    """Of one regime and layout.

    Attributes:
        counts: (1); each location is held out of all others where k is one fewer than there are.
        near: the near-collinear locations.
        near_predicted_m, others_predicted_m: leave one location out, mean over locations of their RMS;
            `ratio_predicted`.
        near_achieved_m, others_achieved_m, ratio_achieved: the same achieved, with intervals over sessions.
        order: rank correlation over all choices of four of predicted and achieved RMS.
        best, worst: choices of four as predicted: names, predicted and achieved RMS.
        failed: folds that did not settle, which are left out.
    """

    regime: str
    layout: str
    sessions: int
    counts: tuple[CountRow, ...]
    near: tuple[str, ...]
    near_predicted_m: float
    others_predicted_m: float
    near_achieved_m: Spread
    others_achieved_m: Spread
    ratio_achieved: Spread
    order: Spread
    best: tuple[tuple[str, ...], float, float]
    worst: tuple[tuple[str, ...], float, float]
    failed: int

    @property
    def ratio_predicted(self) -> float:
        return self.near_predicted_m / self.others_predicted_m


def findings(regime: Regime, layout: Layout, sessions: int, seed: int) -> Findings:
    """Simulate, predict, correct with every choice of three or more locations, and compare."""
    names, choices, predicted, squared = (), np.zeros((0, 0), bool), [], []
    failed = 0
    for number in range(sessions):
        session = simulate_session(seed + number, layout, drift={"odometry": regime.drawn(seed + number)})
        anchors = _anchors(session)
        names = tuple(dict.fromkeys(anchors.location))
        choices = _choices(len(names))
        predicted.append(
            predicted_m2(session, anchors, true_noise(session.truth, session.truth, regime.drift), choices)
        )
        own = achieved_m2(session, anchors, regime, choices)
        failed += int(np.isnan(own).all(axis=1).sum())
        squared.append(own)
    left_out = ~choices[:, [names.index(name) for name in layout.order]]
    return _found(regime, layout, names, choices, left_out, np.array(predicted), np.array(squared), failed)


def _found(
    regime: Regime,
    layout: Layout,
    names: tuple[str, ...],
    choices: Bool[np.ndarray, "c n"],
    left_out: Bool[np.ndarray, "c k"],
    predicted_m2: Float[np.ndarray, "s c k"],
    achieved_m2: Float[np.ndarray, "s c k"],
    failed: int,
) -> Findings:
    held = left_out[None] & np.isfinite(achieved_m2)
    predicted_m2 = np.where(left_out[None], predicted_m2, np.nan)
    achieved_m2 = np.where(held, achieved_m2, np.nan)
    draws = resampled_rows(len(achieved_m2), seed=0)

    counts, size = [], choices.sum(axis=1)
    promised, per_session = np.sqrt(_mean(predicted_m2, axis=(0, 2))), _mean(achieved_m2, axis=2)
    for k in range(LEAST, len(names)):
        some = size == k
        of_choices = Spread(*np.quantile(promised[some], [0.5, 0.16, 0.84]).tolist())
        median = np.array([_median_choice(per_session[rows][:, some]) for rows in draws])
        achieved = _spread(_median_choice(per_session[:, some]), median)
        counts.append(CountRow(k, int(some.sum()), of_choices, achieved))
    surveyed = np.array([_SURVEYED[name] for name in names])
    near = near_collinear(neighbours(names, surveyed))
    alone = np.flatnonzero(size == len(names) - 1)
    is_near = np.array([names[int(np.flatnonzero(~choices[row])[0])] in near for row in alone])
    # Each location once, however often it was visited.
    own_m2 = _mean(achieved_m2[:, alone], axis=2)
    drawn = np.array([[_over_locations(own_m2[rows][:, some]) for some in (is_near, ~is_near)] for rows in draws])
    four = np.flatnonzero(size == 4)
    promise, truth = promised[four], np.sqrt(_mean(per_session[:, four], axis=0))
    orders = [rank_correlation(promise, _mean(per_session[rows][:, four], axis=0)) for rows in draws]
    ends = [
        (tuple(np.array(names)[choices[four[i]]].tolist()), float(promise[i]), float(truth[i]))
        for i in (int(np.argmin(promise)), int(np.argmax(promise)))
    ]
    return Findings(
        regime=regime.name,
        layout=layout.name,
        sessions=len(achieved_m2),
        counts=tuple(counts),
        near=tuple(name for name in names if name in near),
        near_predicted_m=_over_locations(_mean(predicted_m2[:, alone[is_near]], axis=2)),
        others_predicted_m=_over_locations(_mean(predicted_m2[:, alone[~is_near]], axis=2)),
        near_achieved_m=_spread(_over_locations(own_m2[:, is_near]), drawn[:, 0]),
        others_achieved_m=_spread(_over_locations(own_m2[:, ~is_near]), drawn[:, 1]),
        ratio_achieved=_spread(
            _over_locations(own_m2[:, is_near]) / _over_locations(own_m2[:, ~is_near]), drawn[:, 0] / drawn[:, 1]
        ),
        order=_spread(rank_correlation(promise, truth), np.array(orders)),
        best=ends[0],
        worst=ends[1],
        failed=failed,
    )


def predicted_m2(
    session: SimulatedSession, anchors: Anchors, noise: NoiseEnsemble, choices: Bool[np.ndarray, "c n"]
) -> Float[np.ndarray, "c k"]:
    """Variance of every visit's held-out error, all axes: of the marker, its survey and its sighting."""
    plan = plan_of(session.truth, wanders=wandering(noise))
    place = place_at_stamp(plan, jnp.asarray(anchors.stamp_s))
    point = jnp.asarray(np.array([session.marker_enh_m[name] for name in anchors.location]))
    sight = Sight(
        jnp.asarray(np.inf),
        jnp.asarray(visit_sigma_m(session.layout)),
        jnp.full(3, SURVEY_SIGMA_M),
        jnp.asarray(np.inf),
    )
    visits = Visits(place, point, jnp.ones(len(anchors)), jnp.asarray(anchors.location_index))
    use = jnp.asarray(choices[:, anchors.location_index].astype(float))
    variance = np.asarray(_left_out_m2(visits, use, plan, noise, sight))
    return variance + 3.0 * (SURVEY_SIGMA_M**2 + float(sight.sigma_m) ** 2)


@eqx.filter_jit
def _left_out_m2(visits: Visits, use, plan: Plan, noise: NoiseEnsemble, sight: Sight):
    places = carried(plan, noise, visits.place, visits.point_m)
    prior = covariance_of(places, places, plan, noise)
    watch = Watched(places, own_covariance(places, plan, noise))

    def one(row):
        own = eqx.tree_at(lambda v: v.seen, visits, row)
        found = posterior_of(own, places.jacobian, prior, prior, noise, watch, sight)
        return jnp.trace(jnp.einsum("q,qmab->mab", noise.weight, found), axis1=1, axis2=2)

    return jax.lax.map(one, use)


def achieved_m2(
    session: SimulatedSession, anchors: Anchors, regime: Regime, choices: Bool[np.ndarray, "c n"]
) -> Float[np.ndarray, "c k"]:
    """Squared distance of every visit's marker from its survey, by choice; NaN where it did not settle."""
    trajectory = session.trajectories["odometry"]
    chain = chain_of(trajectory)
    table = anchor_table(anchors, chain, SOLVE.extra_sigma_m)
    k = len(anchors)
    use = np.zeros((len(choices), table.real.shape[0]))
    use[:, :k] = choices[:, anchors.location_index]
    noise = true_noise(trajectory, session.truth, regime.drift)
    found = transferred_folds(
        chain, table, noise, jnp.asarray(use), jnp.asarray(SOLVE.loss_width), SOLVE.ensemble_options()
    )
    error = np.asarray(found.point_m)[:, :k] - anchors.surveyed_enh_m
    return np.where(np.asarray(found.settled)[:, None], np.sum(error**2, axis=2), np.nan)


def visit_sigma_m(layout: Layout) -> float:
    """Of a visit's mean sighting, each axis, as the simulator draws it: a constant, and scatter over the count."""
    scatter = np.array(layout.repeatability_m) ** 2 / 3.0 / np.array(layout.counts)
    return float(np.sqrt(VISIT_SIGMA_M**2 + scatter.mean()))


def _anchors(session: SimulatedSession) -> Anchors:
    visits, _ = label_visits(cut_visits(session.sightings, GAP_S), session.survey, order=list(session.order))
    anchors, _ = make_anchors(
        session.trajectories["odometry"], session.sightings, visits, session.survey, origin_enh_m=ORIGIN_ENH_M
    )
    return anchors


def _choices(n: int) -> Bool[np.ndarray, "c n"]:
    """Every choice of three locations or more, but not all of them."""
    every = np.array(list(itertools.product([False, True], repeat=n)))
    return every[(every.sum(axis=1) >= LEAST) & (every.sum(axis=1) < n)]


def rank_correlation(a: Float[np.ndarray, "n"], b: Float[np.ndarray, "n"]) -> float:
    """Spearman's."""
    return float(np.corrcoef(rankdata(a), rankdata(b))[0, 1])


def _median_choice(squared: Float[np.ndarray, "s c"]) -> float:
    """RMS over sessions of the choice in the middle; of those that ever settled."""
    each = np.sqrt(_mean(squared, axis=0))
    return float(np.median(each[np.isfinite(each)])) if np.isfinite(each).any() else float("nan")


def _over_locations(squared: Float[np.ndarray, "s n"]) -> float:
    """Mean over locations of their RMS over sessions."""
    return float(_mean(np.sqrt(_mean(squared, axis=0))))


def _spread(value: float, drawn: Float[np.ndarray, "draws"]) -> Spread:
    """With the middle 95 % of what other sessions would have given."""
    return Spread(value, *np.nanquantile(drawn, [0.025, 0.975]).tolist())


def _mean(values: Float[np.ndarray, "..."], axis: int | tuple[int, ...] | None = None) -> Float[np.ndarray, "..."]:
    """Of what is a number; NaN, without a word, where nothing is: a correction that did not settle."""
    known = np.isfinite(values)
    count = known.sum(axis=axis)
    return np.where(count > 0, np.where(known, values, 0.0).sum(axis=axis) / np.maximum(count, 1), np.nan)
