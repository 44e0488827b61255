"""A small session to be pushed piece by piece: a true walk, its odometry, markers beside it, sightings of them."""

import dataclasses

import numpy as np
from scipy.spatial.transform import RigidTransform
from solve.chain_session import NOISE, drifted, trajectory_of, walk

from jaxgeo.associate import cut_visits, label_visits, make_anchors
from jaxgeo.data import Anchors, Sightings, Survey, Trajectory
from jaxgeo.georef import LocalFrame
from jaxgeo.online import OnlineGeoreference, OnlineSettings

N = 100
GAP_S = 0.35
# Where each visit begins; the last two are of markers seen before.
VISITS = {"A": (3, 88), "B": (20,), "C": (36, 93), "D": (52,), "E": (70,)}
LENGTH = 4
SETTINGS = OnlineSettings(gap_s=GAP_S, capacity=128, capacity_anchors=7)
# Far from the zero of the grid, as a national one is.
FRAME = LocalFrame.create("local", np.array([70_000.0, 80_000.0, 300.0]))


@dataclasses.dataclass(frozen=True)
class Session:
    truth: RigidTransform
    trajectory: Trajectory
    sightings: Sightings
    survey: Survey


def session(seed: int = 0) -> Session:
    """Markers 2 m beside the path, seen at four successive poses and once between two."""
    rng = np.random.default_rng(seed)
    truth = walk(N)
    trajectory = trajectory_of(drifted(truth, NOISE, seed))
    marker_m = {name: truth[first[0] + 1].apply(rng.uniform(-2.0, 2.0, 3)) for name, first in VISITS.items()}
    rows = [(name, i + k) for name, firsts in VISITS.items() for i in firsts for k in range(LENGTH)]
    rows.sort(key=lambda row: row[1])
    seen = np.array([truth[i].inv().apply(marker_m[name]) for name, i in rows])
    n = len(rows)
    sightings = Sightings(
        stamp_s=trajectory.stamp_s[[i for _, i in rows]],
        marker=np.array([name for name, _ in rows]),
        t_body_marker_m=seen + 0.02 * rng.standard_normal((n, 3)),
        quat_body_marker_wxyz=np.full((n, 4), np.nan),
        covariance=np.tile(np.diag([4e-4] * 3 + [0.0] * 3), (n, 1, 1)),
        ambiguous=np.zeros(n, dtype=bool),
        reprojection_px=np.full(n, np.nan),
        source=np.array([f"row {i}" for i in range(n)]),
    )
    surveyed = np.array(list(marker_m.values())) + 0.02 * rng.standard_normal((len(marker_m), 3))
    none = np.full((len(marker_m), 4), np.nan)
    survey = Survey(
        tuple(marker_m), surveyed + FRAME.origin_enh_m, np.full((len(marker_m), 3), 0.02), none, none[:, :3], "local"
    )
    return Session(truth, trajectory, sightings, survey)


def batch_anchors(made: Session, until: int = N) -> Anchors:
    """The anchors of the batch job, of the poses before `until` and the visits that they have seen the end of."""
    trajectory = prefix(made, until)
    ended = [
        visit
        for visit in cut_visits(made.sightings, GAP_S)
        if trajectory.stamp_s[-1] - visit.end_s > GAP_S or until == N
    ]
    labelled, _ = label_visits(ended, made.survey)
    anchors, _ = make_anchors(trajectory, made.sightings, labelled, made.survey, origin_enh_m=FRAME.origin_enh_m)
    return anchors


def prefix(made: Session, n: int) -> Trajectory:
    t = made.trajectory
    return Trajectory(t.stamp_s[:n], t.position_m[:n], t.quat_wxyz[:n])


def push_pose(georeference: OnlineGeoreference, made: Session, i: int) -> None:
    t = made.trajectory
    georeference.push_odometry(t.stamp_s[i], t.position_m[i], t.quat_wxyz[i])


def replayed(georeference: OnlineGeoreference, made: Session, until: int = N) -> list[int]:
    """Poses and sightings in the order of their stamps, an update after each; the poses at which it solved."""
    at = []
    for i in range(until):
        georeference.push_sightings(
            made.sightings.take(np.flatnonzero(made.sightings.stamp_s == made.trajectory.stamp_s[i]))
        )
        push_pose(georeference, made, i)
        update = georeference.update()
        if update is not None and update.steps:
            at.append(i)
    return at
