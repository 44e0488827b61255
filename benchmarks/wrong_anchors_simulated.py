"""Faults put into simulated sessions of the reference study's UAV-like drift, and what was said of each.

The noise is learned from the very session that holds the fault. One session a seed, seven cases of it:

    clean, mislabelled (one of seven visits at another location), exchanged (two visits' labels), shifted (one visit's
    survey, by exactly `SHIFT_SDS` standard deviations of its own leave-one-out prediction along a random direction),
    missed (six visits for seven names), extra (eight for seven, a stop anywhere), jumped (no anchor is wrong: the
    odometry is off by as much as the shift, from the middle between two visits on)
"""

import dataclasses
import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from calibration.calibrate import LearnSettings
from calibration.faults import (
    Finding,
    Session,
    Site,
    align,
    fault_words,
    find_fault,
    gate,
    relabelled,
    session_of,
    site_of,
)
from calibration.faults import hypotheses as of
from calibration.faults.predict import predict
from jaxgeo.associate import cut_visits, make_anchors
from jaxgeo.data import Anchors, Trajectory, Visit
from jaxgeo.graph.noise_defaults import default_noise
from jaxgeo.simulate import UAV, Layout, SimulatedSession, paper_drift, scaled, simulate_session
from jaxgeo.simulate.layout import LOCATIONS, ORDER, ORIGIN_ENH_M
from jaxgeo.solve.correct import Settings

# The defaults of LiDAR odometry, and the simulator's constant error of a visit's sightings.
SETTINGS, LEARN = Settings(extra_sigma_m=0.03), LearnSettings("lidar", default_noise("lidar"))
GAP_S = 5.0
SHIFT_SDS = 6.0
# An extra stop: sightings, their scatter, and seconds that the session is longer.
STOP = (120, 0.12, 40.0)
Row = dict[str, Any]


def simulated_rows(seed: int, drift: float = 1.0, only_clean: bool = False) -> Iterator[Row]:
    """One row a fault, under `drift` times the study's; with `only_clean` the first alone."""
    drifts = {"icp": scaled(paper_drift(UAV)["icp"], drift)}
    made = simulate_session(seed, UAV, drift=drifts)
    visits = cut_visits(made.sightings, GAP_S)
    site, anchors = site_of(made.survey, ORIGIN_ENH_M), _anchors(made, visits, ORDER)
    random = np.random.default_rng([seed, 11])

    def asked(labelled: Anchors) -> Session:
        return session_of(made.trajectories["icp"], labelled, site, SETTINGS, LEARN)

    yield _found("clean", asked(anchors), of.right(ORDER))
    if only_clean:
        return
    j = int(random.integers(len(ORDER)))
    name = str(random.choice([other for other in LOCATIONS if other != ORDER[j]]))
    told = of.replaced(ORDER, {j: name})
    yield _found("mislabelled", asked(relabelled(anchors, told, site)), of.Hypothesis("mislabelled", (j,), ORDER))
    pairs = [h for h in of.exchanged(ORDER) if len(h.visits) == 2]
    pair = pairs[int(random.integers(len(pairs)))]
    session = asked(relabelled(anchors, pair.places, site))
    yield _found("exchanged", session, of.Hypothesis("exchanged", pair.visits, ORDER))
    shifted, shift_m = _shifted(asked(anchors), random)
    yield shifted
    missed = int(random.integers(len(ORDER)))
    left = [visit for i, visit in enumerate(visits) if i != missed]
    truth = of.Hypothesis("missed", (missed,), tuple(n for i, n in enumerate(ORDER) if i != missed))
    yield _aligned("missed", made, left, site, truth)
    at = int(random.integers(1, len(ORDER)))
    name = str(random.choice([other for other in LOCATIONS if other not in ORDER[at - 1 : at + 1]]))
    more = simulate_session(seed, _with_stop(at, name), drift=drifts)
    truth = of.Hypothesis("extra", (at,), (*ORDER[:at], name, *ORDER[at:]))
    yield _aligned("extra", more, cut_visits(more.sightings, GAP_S), site, truth)
    after = int(random.integers(len(ORDER) - 1))
    jumped = _jumped(made.trajectories["icp"], anchors.pose_index[after : after + 2], shift_m)
    session = session_of(jumped, anchors, site, SETTINGS, LEARN)
    yield _found("jumped", session, of.jumps(ORDER)[after])


def _jumped(trajectory: Trajectory, between: Int[np.ndarray, "2"], jump_m: Float[np.ndarray, "3"]) -> Trajectory:
    position_m = trajectory.position_m.copy()
    position_m[int(between.mean()) :] += jump_m
    return dataclasses.replace(trajectory, position_m=position_m)


def _shifted(session: Session, random: np.random.Generator) -> tuple[Row, Float[np.ndarray, "3"]]:
    j, along = int(random.integers(len(ORDER))), random.standard_normal(3)
    along /= np.linalg.norm(along)
    shift_m = SHIFT_SDS * np.sqrt(along @ predict(session, [j]).covariance_m2[j] @ along) * along
    moved = session.anchors.surveyed_enh_m.copy()
    moved[j] += shift_m
    anchors = dataclasses.replace(session.anchors, surveyed_enh_m=moved)
    table = dataclasses.replace(session.table, surveyed_m=session.table.surveyed_m.at[j].add(shift_m))
    row = _found("shifted", dataclasses.replace(session, anchors=anchors, table=table), of.shifted(ORDER)[j])
    return row | {"shift_m": float(np.linalg.norm(shift_m))}, shift_m


def _found(fault: str, session: Session, truth: of.Hypothesis) -> Row:
    started = time.perf_counter()
    quick = gate(session, ordered=True)
    seconds_gate = time.perf_counter() - started
    found = find_fault(session, ordered=True)
    return (
        {"fault": fault}
        | finding_row(found, truth)
        | {
            "gate_worth": quick.worth,
            "seconds_gate": seconds_gate,
            "seconds": time.perf_counter() - started - seconds_gate,
        }
    )


def finding_row(found: Finding, truth: of.Hypothesis) -> Row:
    """What was said beside what is true; `named` only where visits and their places are right."""
    right = found.named.visits == truth.visits and found.named.places == truth.places
    return {
        "truth": fault_words(truth, found.told),
        "said": fault_words(found.named, found.told),
        "found": found.fault,
        "named": found.fault and right,
        "beside": [fault_words(h, found.told) for h in found.beside],
        "truth_beside": any((h.visits, h.places) == (truth.visits, truth.places) for h in found.beside),
        "open": [fault_words(h, found.told) for h in found.open],
        "truth_open": any(h.places == truth.places for h in found.open),
        "label_alarm": found.label_alarm,
        "position_alarm": found.position_alarm,
        "untested": int(np.sum(~found.tested)),
        "mended_fault": None if found.mended is None else found.mended.fault,
    }


def _aligned(fault: str, made: SimulatedSession, visits: Sequence[Visit], site: Site, truth: of.Hypothesis) -> Row:
    """The visits go by names that mean nothing, as `jaxgeo check` gives them."""
    names = [*ORDER, ORDER[0]][: len(visits)]
    session = session_of(made.trajectories["icp"], _anchors(made, visits, names), site, SETTINGS, LEARN)
    started = time.perf_counter()
    found = align(session, ORDER)
    return {
        "fault": fault,
        "truth": fault_words(truth, ORDER),
        "said": fault_words(found.named, ORDER),
        "found": True,
        "named": found.named.places == truth.places,
        "beside": [fault_words(h, ORDER) for h, _ in found.beside],
        "truth_open": any(h.places == truth.places for h, _ in found.beside),
        "probability": found.probability,
        "seconds": time.perf_counter() - started,
    }


def _anchors(made: SimulatedSession, visits: Sequence[Visit], names: Sequence[str]) -> Anchors:
    labelled = [
        dataclasses.replace(visit, location=name, label=f"{i + 1} ({name})")
        for i, (visit, name) in enumerate(zip(visits, names, strict=True))
    ]
    return make_anchors(made.trajectories["icp"], made.sightings, labelled, made.survey, origin_enh_m=ORIGIN_ENH_M)[0]


def _with_stop(at: int, name: str) -> Layout:
    def inserted(rows: tuple, value: Any) -> tuple:
        return (*rows[:at], value, *rows[at:])

    count, scatter_m, more_s = STOP
    return dataclasses.replace(
        UAV,
        order=inserted(UAV.order, name),
        counts=inserted(UAV.counts, count),
        repeatability_m=inserted(UAV.repeatability_m, scatter_m),
        duration_s=UAV.duration_s + more_s,
    )
