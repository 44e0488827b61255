"""The simulated session: the study's layout, errors of the size asked for, and files that hold it all."""

import dataclasses
import json

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from jaxgeo.config import load_config
from jaxgeo.errors import InputError
from jaxgeo.graph.components import COMPONENTS
from jaxgeo.io.sightings_csv import read_pose_sightings
from jaxgeo.io.survey_csv import read_survey
from jaxgeo.io.tum import read_tum
from jaxgeo.simulate import (
    UAV,
    UGV,
    Drift,
    Layout,
    paper_drift,
    raw_revisit_gaps_m,
    simulate_session,
    write_session_files,
)
from jaxgeo.simulate.layout import ORDER, ORIGIN_ENH_M

NO_DRIFT = {"icp": Drift()}


@pytest.fixture(scope="module")
def session():
    return simulate_session(3)


def arrays(session):
    trajectories = [session.truth, *session.trajectories.values()]
    values = [a for t in trajectories for a in (t.stamp_s, t.position_m, t.quat_wxyz)]
    s = session.sightings
    return [
        *values,
        s.stamp_s,
        s.t_body_marker_m,
        s.quat_body_marker_wxyz,
        s.covariance,
        *session.marker_enh_m.values(),
    ]


def poses(trajectory):
    rotation = Rotation.from_quat(trajectory.quat_wxyz, scalar_first=True)
    return RigidTransform.from_components(trajectory.position_m, rotation)


def seen_at_m(session, trajectory):
    """Sightings composed with the nearest pose of a trajectory: marker positions in its map."""
    at = np.abs(trajectory.stamp_s[:, None] - session.sightings.stamp_s).argmin(axis=0)
    return poses(trajectory)[at].apply(session.sightings.t_body_marker_m)


def test_a_seed_is_a_session_bit_for_bit(session):
    again, other = simulate_session(3), simulate_session(4)
    assert all(np.array_equal(a, b) for a, b in zip(arrays(session), arrays(again), strict=True))
    assert not np.array_equal(session.sightings.t_body_marker_m, other.sightings.t_body_marker_m)
    assert not np.array_equal(session.trajectories["icp"].position_m, other.trajectories["icp"].position_m)


def test_errors_draw_from_streams_of_their_own(session):
    quieter = simulate_session(3, drift={"icp": Drift()}, visit_sigma_m=0.0)
    assert np.array_equal(quieter.truth.position_m, session.truth.position_m)
    assert np.array_equal(quieter.sightings.stamp_s, session.sightings.stamp_s)


def test_sessions_of_one_seed_share_the_site_and_nothing_else(session):
    assert UAV.stream != UGV.stream
    other = simulate_session(3, dataclasses.replace(UAV, stream=UGV.stream))
    for name, marker_m in session.marker_enh_m.items():
        np.testing.assert_array_equal(marker_m, other.marker_enh_m[name])
    np.testing.assert_array_equal(session.truth.position_m, other.truth.position_m)
    assert not np.array_equal(session.sightings.t_body_marker_m, other.sightings.t_body_marker_m)
    assert not np.array_equal(session.trajectories["icp"].position_m, other.trajectories["icp"].position_m)


@pytest.mark.parametrize(("layout", "speed_m_s"), [(UAV, (0.8, 1.2)), (UGV, (0.55, 0.85))], ids=["UAV", "UGV"])
def test_the_walk_is_one_that_a_person_can_make(layout, speed_m_s):
    truth = simulate_session(3, layout, drift=NO_DRIFT).truth
    step_s = np.diff(truth.stamp_s)
    speed = np.linalg.norm(np.diff(truth.position_m, axis=0), axis=1) / step_s
    rotation = poses(truth).rotation
    turn = (rotation[:-1].inv() * rotation[1:]).magnitude() / step_s
    assert len(truth) == {"UAV": 1800, "UGV": 1829}[layout.name]
    np.testing.assert_allclose(step_s.sum(), {"UAV": 319.1, "UGV": 362.4}[layout.name])
    np.testing.assert_allclose(step_s, step_s.mean(), rtol=1e-5)
    assert speed.max() < 1.5
    assert speed_m_s[0] < np.median(speed[speed > 0.3]) < speed_m_s[1]
    assert turn.max() < 1.0


def test_the_uav_is_carried_above_the_ground_and_the_ugv_along_it():
    height_m = {}
    for layout in (UAV, UGV):
        session = simulate_session(3, layout, drift=NO_DRIFT)
        at = np.abs(session.truth.stamp_s[:, None] - session.sightings.stamp_s).argmin(axis=0)
        marker_m = np.repeat([session.marker_enh_m[name][2] for name in ORDER], layout.counts)
        height_m[layout.name] = np.mean(session.truth.position_m[at, 2] - marker_m)
    assert 2.4 < height_m["UAV"] < 2.8
    assert 0.3 < height_m["UGV"] < 0.7


@pytest.mark.parametrize("layout", [UAV, UGV], ids=["UAV", "UGV"])
def test_layout_is_the_studys(layout):
    session = simulate_session(3, layout, drift=NO_DRIFT)
    assert sum(layout.counts) == {"UAV": 1374, "UGV": 1153}[layout.name]
    cuts = np.flatnonzero(np.diff(session.sightings.stamp_s) > 5.0) + 1
    visits = np.split(np.arange(len(session.sightings)), cuts)
    assert tuple(map(len, visits)) == layout.counts
    composed = seen_at_m(session, session.truth)
    for location, rows, scatter_m in zip(ORDER, visits, layout.repeatability_m, strict=True):
        centre = composed[rows].mean(axis=0)
        assert np.linalg.norm(centre - session.marker_enh_m[location]) < 0.2
        rms = np.sqrt(np.mean(np.sum((composed[rows] - centre) ** 2, axis=1)))
        np.testing.assert_allclose(rms, scatter_m, rtol=0.2)
    assert np.all(session.sightings.t_body_marker_m[:, 0] > 1.0), "the marker is ahead of the rig"


def test_without_noise_the_sightings_meet_the_markers():
    session = simulate_session(1, drift={"icp": Drift()}, survey_sigma_m=0.0, visit_sigma_m=0.0, sighting_noise=0.0)
    composed = seen_at_m(session, session.truth)
    marker = np.repeat([session.marker_enh_m[name] for name in ORDER], UAV.counts, axis=0)
    # The nearest pose is up to 0.1 s away: what is left is what the rig moved in that time.
    assert np.abs(composed - marker).max() < 0.08
    surveyed = dict(zip(session.survey.name, session.survey.enh_m - ORIGIN_ENH_M, strict=True))
    assert all(np.array_equal(surveyed[name], session.marker_enh_m[name]) for name in surveyed)
    # The marker's z axis points at the rig, its y axis up.
    attitude = Rotation.from_quat(session.sightings.quat_body_marker_wxyz, scalar_first=True)
    assert np.all(attitude.apply([0.0, 0.0, 1.0])[:, 0] < -0.7)
    assert np.all(attitude.apply([0.0, 1.0, 0.0])[:, 2] > 0.9)


def test_without_drift_the_odometry_is_the_truth():
    session = simulate_session(1, drift={"icp": Drift()})
    truth, icp = poses(session.truth), poses(session.trajectories["icp"])
    np.testing.assert_allclose((truth[0] * icp).as_matrix(), truth.as_matrix(), atol=1e-10)


def test_log_scale_shrinks_the_steps():
    session = simulate_session(1, drift={"mono": Drift(log_scale=0.2)})
    truth, mono = session.truth.position_m, session.trajectories["mono"].position_m
    ratio = np.linalg.norm(truth[900] - truth[0]) / np.linalg.norm(mono[900] - mono[0])
    np.testing.assert_allclose(np.log(ratio), 0.2, rtol=1e-9)


def test_icp_drifts_more_than_dense_and_both_by_metres(session):
    truth = session.truth.position_m
    revisit_m = {}
    for name, trajectory in session.trajectories.items():
        first, *_, last = np.split(seen_at_m(session, trajectory), np.cumsum(UAV.counts)[:-1])
        revisit_m[name] = np.linalg.norm(first.mean(axis=0) - last.mean(axis=0))
        np.testing.assert_array_equal(trajectory.position_m[0], 0.0)
    assert 0.3 < revisit_m["dense"] < 0.6 * revisit_m["icp"]
    assert revisit_m["icp"] > 2.0
    assert np.ptp(truth, axis=0).max() < 100.0


def test_files_hold_the_session(session, tmp_path):
    path = write_session_files(session, tmp_path / "made" / "session")
    config = load_config(path)
    assert config.simulated
    assert config.seed == 3
    assert config.visits.order == list(ORDER)
    assert config.origin_enh_m == tuple(ORIGIN_ENH_M)
    assert {file.name for file in path.parent.iterdir()} == {
        *("config.yaml", "survey.csv", "sightings.csv", "icp.tum", "dense.tum", "truth.tum", "truth.json")
    }
    survey = read_survey(config.survey.file, crs=config.crs)
    assert survey.name == session.survey.name
    np.testing.assert_array_equal(survey.enh_m, session.survey.enh_m)
    np.testing.assert_array_equal(survey.sigma_m, session.survey.sigma_m)
    for name, given in config.trajectories.items():
        np.testing.assert_array_equal(read_tum(given.file).position_m, session.trajectories[name].position_m)
        np.testing.assert_array_equal(read_tum(given.reference.file).position_m, session.truth.position_m)
    sightings = read_pose_sightings(config.sightings.file)
    np.testing.assert_array_equal(sightings.t_body_marker_m, session.sightings.t_body_marker_m)
    np.testing.assert_array_equal(sightings.covariance, session.sightings.covariance)


def test_the_seed_makes_the_same_files(session, tmp_path):
    one, two = (write_session_files(simulate_session(3), tmp_path / name).parent for name in "ab")
    for file in one.iterdir():
        assert file.read_bytes() == (two / file.name).read_bytes()


def test_a_session_cannot_be_changed(session):
    with pytest.raises(dataclasses.FrozenInstanceError):
        session.seed = 1


def test_truth_file_says_what_it_was_made_from(tmp_path):
    session = simulate_session(5, UGV, drift=paper_drift(UGV))
    truth = json.loads((write_session_files(session, tmp_path).parent / "truth.json").read_text())
    assert (truth["simulated"], truth["seed"], truth["layout"]["name"]) == (True, 5, "UGV")
    assert truth["trajectories"]["dense"]["drift"]["closures"][2] == {
        "first": 1,
        "second": 7,
        **{"sigma_trans_m": 0.06, "sigma_rot_rad": 0.003},
    }
    assert truth["trajectories"]["icp"]["drift"]["student_dof"] is None
    for name, written in truth["trajectories"].items():
        sigma = np.asarray(session.true_noise(name).sigma[0])
        assert [written["true_noise"][component] for component in COMPONENTS] == sigma.tolist()
        assert written["raw_revisit_gap_m"] == raw_revisit_gaps_m(session, name)
    np.testing.assert_array_equal(truth["marker_enh_m"]["B"], session.marker_enh_m["B"])


def test_raw_revisit_gap_is_the_distance_of_the_visits_means(session):
    first, *_, last = np.split(seen_at_m(session, session.trajectories["icp"]), np.cumsum(UAV.counts)[:-1])
    expected = np.linalg.norm(first.mean(axis=0) - last.mean(axis=0))
    gaps = raw_revisit_gaps_m(session, "icp")
    assert list(gaps) == ["A"]
    np.testing.assert_allclose(gaps["A"], expected, atol=0.01)  # the nearest pose against the interpolated one


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"counts": (10, 10)}, "7 visits in the order, 2 counts"),
        ({"order": (*"ABCDEG", "A")}, "location 'G'; the site has A, B, C"),
        ({"order": (*"AACDEF", "A")}, "neighbours at different locations"),
        ({"duration_s": 100.0}, "the visits alone last 137.4 s of 100 s"),
        ({"counts": (0, 289, 167, 209, 197, 185, 175)}, "a sighting or more a visit"),
    ],
)
def test_a_layout_that_cannot_be_walked_is_refused(change, message):
    with pytest.raises(InputError, match=message):
        dataclasses.replace(UAV, **change)


def test_a_layout_of_ones_own():
    layout = Layout("short", (30, 40, 20), (0.1, 0.1, 0.1), 60.0, 301, 1.4, order=("A", "C", "A"), stream=7)
    session = simulate_session(0, layout, drift=NO_DRIFT)
    assert len(session.truth) == 301
    assert len(session.sightings) == 90
    assert session.order == ("A", "C", "A")
    assert raw_revisit_gaps_m(session, "icp")["A"] < 0.3
