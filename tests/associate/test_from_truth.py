import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxgeo.associate.from_truth import sightings_from_trajectory, survey_from_trajectory
from jaxgeo.data import Trajectory
from jaxgeo.errors import SightingError, SurveyError


def _truth(n=6):
    rng = np.random.default_rng(0)
    return Trajectory(
        stamp_s=100.0 + np.arange(n) * 0.1,
        position_m=rng.normal(size=(n, 3)),
        quat_wxyz=Rotation.random(n, rng=rng).as_quat(scalar_first=True),
    )


def test_the_true_pose_carries_the_sighting_to_the_surveyed_point():
    truth = _truth()
    survey = survey_from_trajectory(truth, {"A": 0, "B": 4}, "local", 0.05)
    sightings = sightings_from_trajectory(truth, [("A", 0), ("B", 4), ("A", 5)], survey, [0.01, 0.02, 0.03])
    rows = [0, 4, 5]
    R = Rotation.from_quat(truth.quat_wxyz[rows], scalar_first=True)
    there = R.apply(sightings.t_body_marker_m) + truth.position_m[rows]
    np.testing.assert_allclose(there, truth.position_m[[0, 4, 0]], atol=1e-12)
    np.testing.assert_allclose(sightings.t_body_marker_m[:2], 0.0, atol=1e-15)
    assert np.linalg.norm(sightings.t_body_marker_m[2]) > 0.1
    np.testing.assert_array_equal(sightings.stamp_s, truth.stamp_s[rows])
    assert sightings.marker.tolist() == ["A", "B", "A"]
    np.testing.assert_allclose(sightings.covariance[0], np.diag([1e-4, 4e-4, 9e-4, 0.0, 0.0, 0.0]))
    assert np.isnan(sightings.quat_body_marker_wxyz).all()
    assert survey.name == ("A", "B")
    assert survey.crs == "local"
    np.testing.assert_array_equal(survey.enh_m, truth.position_m[[0, 4]])
    np.testing.assert_array_equal(survey.sigma_m, 0.05)
    assert np.isnan(survey.quat_grid_marker_wxyz).all()


def test_rows_and_names_outside_are_refused():
    truth = _truth()
    with pytest.raises(SurveyError, match="location 'B': row 6 is not in the truth, which has rows 0 to 5"):
        survey_from_trajectory(truth, {"A": 0, "B": 6}, "local", 0.05)
    with pytest.raises(SurveyError, match="names no rows"):
        survey_from_trajectory(truth, {}, "local", 0.05)
    with pytest.raises(SurveyError, match="sigma_m is 0"):
        survey_from_trajectory(truth, {"A": 0}, "local", 0.0)
    survey = survey_from_trajectory(truth, {"A": 0}, "local", 0.05)
    with pytest.raises(SightingError, match="visit of 'A': row -1 is not in the truth"):
        sightings_from_trajectory(truth, [("A", -1)], survey, 0.01)
    with pytest.raises(SightingError, match="visit of 'C' at row 1: the survey has A"):
        sightings_from_trajectory(truth, [("C", 1)], survey, 0.01)
    with pytest.raises(SightingError, match="names no visits"):
        sightings_from_trajectory(truth, [], survey, 0.01)
    with pytest.raises(SightingError, match="one number above zero, or three"):
        sightings_from_trajectory(truth, [("A", 0)], survey, [0.01, 0.02])
