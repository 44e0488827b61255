"""What a plan promises against what sessions achieve: simulated sessions of the reference study's layout.

Promised: along the true path, from where and when the markers were visited and the standard deviations from which the
regime draws, before anything is measured. Achieved: the corrected path minus the truth, (a) by the estimator told that
noise, (b) by one that learns it from the session itself.
"""

import time
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from benchmarks.placement_paths import way_m
from calibration.calibrate import learn_options
from calibration.learn import learn_fold, prior_arrays
from eval.bootstrap import bootstrap_interval, ratio_of_means
from eval.montecarlo.regimes import Regime, regimes_named
from eval.montecarlo.sessions import GAP_S
from eval.montecarlo.settings import LAYOUT, SOLVE
from eval.placement.plan import place_at_stamp, plan_of, wandering
from eval.placement.plan_visits import Sight, Visits
from eval.placement.predicted import covariance_given, watched
from eval.placement.scored import path_of
from jaxgeo.associate import cut_visits, label_visits, make_anchors
from jaxgeo.data import Anchors, Trajectory
from jaxgeo.graph.anchor_table import anchor_table
from jaxgeo.graph.chain import chain_of
from jaxgeo.simulate import simulate_session
from jaxgeo.simulate.session import ORIGIN_ENH_M, SURVEY_SIGMA_M, VISIT_SIGMA_M, SimulatedSession
from jaxgeo.simulate.true_noise import true_noise
from jaxgeo.solve.ensemble_fold import solve_ensemble

REGIMES = "white,biased,gauss-markov"
WATCHED = 128
# Places along the path at which both sides are printed.
CURVE = 10
STAGES = ("true_noise", "learned_noise")


def simulated(sessions: int, seed: int) -> dict[str, Any]:
    """Each regime on its own, and all together; `sessions` altogether."""
    started = time.perf_counter()
    regimes = regimes_named(REGIMES)
    own, every = {}, []
    for number, regime in enumerate(regimes):
        some = range(number, sessions, len(regimes))
        table = np.array([promised_and_achieved_m2(regime, seed + i) for i in some])
        every.append(table)
        own[regime.name] = {"sessions": len(table)} | summary(table)
    return {
        "simulated": True,
        "layout": LAYOUT.name,
        "sessions": sum(len(table) for table in every),
        "all": summary(np.concatenate(every)),
        "regimes": own,
        "seconds": time.perf_counter() - started,
    }


def promised_and_achieved_m2(regime: Regime, seed: int) -> Float[np.ndarray, "3 m"]:
    """At watched places along the path: position variance, and squared errors in the order of `STAGES`; NaN: failed."""
    session = simulate_session(seed, LAYOUT, drift={"odometry": regime.drawn(seed)})
    trajectory = session.trajectories["odometry"]
    visits, _ = label_visits(cut_visits(session.sightings, GAP_S), session.survey, order=list(session.order))
    anchors, _ = make_anchors(trajectory, session.sightings, visits, session.survey, origin_enh_m=ORIGIN_ENH_M)
    paths = corrected(regime, trajectory, session.truth, anchors)
    way = way_m(session.truth.position_m)
    at = np.linspace(0.0, way[-1], WATCHED)

    def squared(path: Trajectory | None) -> Float[np.ndarray, "m"]:
        if path is None:
            return np.full(WATCHED, np.nan)
        error = path.position_m - session.truth.position_m
        return np.sum([np.interp(at, way, axis) ** 2 for axis in error.T], axis=0)

    return np.stack([promised_m2(regime, session, anchors), *map(squared, paths)])


def promised_m2(regime: Regime, session: SimulatedSession, anchors: Anchors) -> Float[np.ndarray, "m"]:
    """Position variance along the true path."""
    truth = session.truth
    # Per metre of the path that is planned, which is the true one.
    noise = true_noise(truth, truth, regime.drift)
    plan = plan_of(truth, wanders=wandering(noise))
    point = np.array([session.marker_enh_m[name] for name in anchors.location])
    visits = Visits(
        place_at_stamp(plan, jnp.asarray(anchors.stamp_s)),
        jnp.asarray(point),
        jnp.ones(len(anchors)),
        jnp.asarray(anchors.location_index),
    )
    sight = Sight(jnp.asarray(np.inf), jnp.asarray(visit_sigma_m()), jnp.full(3, SURVEY_SIGMA_M), jnp.asarray(np.inf))
    found = _covariance(visits, plan, noise, watched(plan, noise, WATCHED), sight)[0]
    return np.trace(np.asarray(found), axis1=1, axis2=2)


_covariance = eqx.filter_jit(covariance_given)


def visit_sigma_m() -> float:
    """Of a visit's mean sighting, each axis, as the simulator draws it: a constant, and scatter over the count."""
    scatter = np.array(LAYOUT.repeatability_m) ** 2 / 3.0 / np.array(LAYOUT.counts)
    return float(np.sqrt(VISIT_SIGMA_M**2 + scatter.mean()))


def corrected(
    regime: Regime, trajectory: Trajectory, truth: Trajectory, anchors: Anchors
) -> tuple[Trajectory | None, Trajectory | None]:
    """The path as corrected under the regime's noise, and with learned noise; None where it did not settle."""
    chain, width = chain_of(trajectory), jnp.asarray(SOLVE.loss_width)
    table = anchor_table(anchors, chain, SOLVE.extra_sigma_m)
    noise = true_noise(trajectory, truth, regime.drift)
    under = solve_ensemble(chain, table, noise, table.real, width, SOLVE.ensemble_options())
    learned = learn_fold(
        chain, table, prior_arrays(regime.learn.family), table.real, width, learn_options(SOLVE, regime.learn)
    ).fold
    under, learned = (path_of(trajectory, fold) if bool(fold.settled) else None for fold in (under, learned))
    return under, learned


def summary(table: Float[np.ndarray, "s 3 m"]) -> dict[str, Any]:
    """RMS over sessions and path, promised over achieved with an interval over sessions, and along the path."""
    found: dict[str, Any] = {"promised_rms_m": rms(table[:, 0])}
    places = np.linspace(0, table.shape[2] - 1, CURVE).round().astype(int)
    found["curve_share_of_way"] = (places / (table.shape[2] - 1)).tolist()
    found["curve_promised_m"] = [rms(table[:, 0, i]) for i in places]
    for stage, name in enumerate(STAGES, start=1):
        good = np.isfinite(table[:, stage]).all(axis=1)
        promised, achieved = table[good, 0], table[good, stage]
        pairs = np.stack([promised.mean(axis=1), achieved.mean(axis=1)], axis=1)
        found[name] = {
            "failed": int(np.sum(~good)),
            "achieved_rms_m": rms(achieved),
            "predicted_over_achieved": rms(promised) / rms(achieved),
            "interval_95": np.sqrt(bootstrap_interval(pairs, ratio_of_means, seed=0)).tolist(),
            "median_of_sessions": float(np.median(np.sqrt(pairs[:, 0] / pairs[:, 1]))),
            "curve_achieved_m": [rms(achieved[:, i]) for i in places],
        }
    return found


def rms(squared: Float[np.ndarray, "..."]) -> float:
    """Root of the mean of what is squared already."""
    return float(np.sqrt(np.mean(squared)))
