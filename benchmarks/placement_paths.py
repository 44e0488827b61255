"""Real paths with candidates for anchors on them: surveyed tags, or places where the truth passes by."""

import dataclasses
import warnings
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from benchmarks.layouts import APART_M, KIND, NEAR_M, RATE_HZ, SEQUENCES, SIGMA_M, anchors_at
from calibration.calibrate import LearnSettings
from eval.placement.criteria import Robust
from eval.placement.known_visits import KnownVisits, known_visits
from eval.placement.plan import place_at_stamp, plan_of, wandering
from eval.placement.plan_visits import Sight
from eval.placement.planned import SEARCH_BESIDE_M
from eval.placement.predicted import watched
from jaxgeo.associate import make_anchors
from jaxgeo.cli.ingest import ingest
from jaxgeo.cli.noise import learn_settings, noise_of
from jaxgeo.cli.progress import Progress
from jaxgeo.cli.session import settings_of
from jaxgeo.config import load_config
from jaxgeo.data import Anchors, Trajectory
from jaxgeo.graph.components import NoiseEnsemble, ensemble_of
from jaxgeo.graph.noise_defaults import default_noise
from jaxgeo.io import InputWarning
from jaxgeo.io.kitti import read_kitti
from jaxgeo.solve.correct import Settings
from jaxgeo.solve.ensemble_fold import CORRELATION_SHARE

ROOT = Path(__file__).resolve().parents[1]
# Places along a path whose truth is known at which an anchor may stand.
CANDIDATES = 48
# One visit of a tag, each axis, in a plan that knows nothing yet of how the tags will be seen.
TAG_SIGMA_M = 0.05
# Points of the path whose accuracy a plan makes good.
WATCHED = 128


@dataclasses.dataclass(frozen=True)
class RealPath:
    """A session, and where anchors may stand.

    Attributes:
        odometry: as measured, its own frame; `kind` of it.
        anchors: every visit of every candidate, which are its locations, local frame.
        judged: (k,) visits by which a choice that leaves their location out is judged.
        truth: of every pose, local frame; None where there is none.
        sigma_m, survey_sigma_m: of a visit and of the survey, each axis, as a plan assumes them.
    """

    name: str
    kind: str
    odometry: Trajectory
    anchors: Anchors
    judged: Int[np.ndarray, "j"]
    settings: Settings
    learn: LearnSettings
    truth: Trajectory | None
    sigma_m: float
    survey_sigma_m: float

    @property
    def candidates(self) -> int:
        return int(self.anchors.location_index.max()) + 1


def tag_path() -> RealPath:
    """TagSLAM's session as its config has it: candidates are the surveyed tags that were seen."""
    config = load_config(ROOT / "configs" / "tagslam_test11.yaml", [])
    with Progress(quiet=True) as progress, warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        data = ingest(config, progress)
        odometry, source = data.trajectories["vio"], config.trajectories["vio"]
        anchors, _ = make_anchors(
            odometry, data.sightings, data.visits, data.survey, origin_enh_m=data.frame.origin_enh_m
        )
    survey = float(np.sqrt(np.mean(np.diagonal(anchors.survey_covariance_m2, axis1=1, axis2=2))))
    return RealPath(
        name="TagSLAM test 11",
        kind=source.odometry,
        odometry=odometry,
        anchors=anchors,
        judged=np.arange(len(anchors)),
        settings=settings_of(config),
        learn=learn_settings(config, source, noise_of(source, config), None),
        truth=None,
        sigma_m=TAG_SIGMA_M,
        survey_sigma_m=survey,
    )


def truth_path(name: str, sequence: str, data: Path) -> RealPath:
    """LiDAR odometry with a truth: candidates evenly along it, seen exactly on every pass."""
    estimate, true = (read_kitti(data / file, rate_hz=RATE_HZ) for file in SEQUENCES[sequence])
    origin_m = true.position_m.mean(axis=0).round()
    visits = candidate_visits(true.position_m, CANDIDATES)
    rows = np.concatenate(visits)
    location = np.repeat(np.arange(CANDIDATES), [len(some) for some in visits])
    order = np.argsort(rows, kind="stable")
    anchors = anchors_at(true, rows[order], location[order], origin_m)
    noise = default_noise(KIND)
    return RealPath(
        name=name,
        kind=KIND,
        odometry=estimate,
        anchors=anchors,
        judged=np.unique(anchors.location_index, return_index=True)[1],
        settings=Settings(),
        learn=LearnSettings(KIND, noise),
        truth=Trajectory(true.stamp_s, true.position_m - origin_m, true.quat_wxyz),
        sigma_m=SIGMA_M,
        survey_sigma_m=SIGMA_M,
    )


def candidate_visits(truth_m: Float[np.ndarray, "n 3"], count: int) -> list[Int[np.ndarray, "_"]]:
    """Rows, sorted, at which a path passes each of `count` places evenly along it."""
    way = way_m(truth_m)
    found = []
    for row in np.searchsorted(way, np.linspace(0.0, way[-1], count)):
        distance_m = np.linalg.norm(truth_m - truth_m[row], axis=1)
        passes = []
        while distance_m.min() < NEAR_M:
            passes.append(int(np.argmin(distance_m)))
            distance_m = np.where(np.abs(way - way[passes[-1]]) > APART_M, distance_m, np.inf)
        found.append(np.sort(passes))
    return found


def way_m(position_m: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """How far along a path its poses are."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(position_m, axis=0), axis=1))])


def known_of(path: RealPath, shape: Trajectory, noise: NoiseEnsemble, robust: Robust = "mixture") -> KnownVisits:
    """The candidates as a plan sees them that follows `shape`: the odometry itself, or the truth.

    Nothing of the survey is in it: a candidate is where the shape has it at each visit.
    """
    plan = plan_of(shape, wanders=wandering(noise))
    anchors = path.anchors
    turn = Rotation.from_quat(shape.quat_wxyz[anchors.pose_index], scalar_first=True)
    point = shape.position_m[anchors.pose_index] + turn.apply(anchors.lever_arm_m)
    place = np.asarray(place_at_stamp(plan, jnp.asarray(shape.stamp_s[anchors.pose_index])))
    of = [np.flatnonzero(anchors.location_index == i) for i in range(path.candidates)]
    sight = Sight(
        jnp.asarray(np.inf), jnp.asarray(path.sigma_m), jnp.full(3, path.survey_sigma_m), jnp.asarray(APART_M)
    )
    return known_visits(
        [place[rows] for rows in of],
        [point[rows] for rows in of],
        plan,
        noise,
        watched(plan, noise, WATCHED, beside_m=SEARCH_BESIDE_M),
        sight,
        robust=robust,
    )


def default_sets(kind: str) -> NoiseEnsemble:
    """The documented default of a kind of odometry."""
    return ensemble_of(default_noise(kind))


def prior_sets(path: RealPath) -> NoiseEnsemble:
    """What learning starts from: every noise model at its prior's medians, all of one weight."""
    span_m = way_m(path.odometry.position_m)[-1]
    family = path.learn.family
    sigma = np.exp(family.mean + family.per_log_span * np.log(span_m)) * family.free
    weight = np.full(len(sigma), 1.0 / len(sigma))
    return NoiseEnsemble(jnp.asarray(sigma), jnp.asarray(weight), jnp.asarray(CORRELATION_SHARE * span_m))
