"""Corners of a planned path: which column is which, and the trajectory that follows them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from jaxgeo.errors import TrajectoryError
from jaxgeo.io.input_warning import InputWarning
from jaxgeo.io.waypoints_csv import followed, read_waypoints

CORNERS_ENH_M = np.array([[79300.0, 76800.0, 340.0], [79360.0, 76800.0, 341.0], [79360.0, 76840.0, 339.5]])


def written(folder, text):
    path = folder / "path.csv"
    path.write_text(text)
    return path


def refusal(path, **options):
    with pytest.raises(TrajectoryError) as error:
        read_waypoints(path, **{"crs": "EPSG:2169", **options})
    return str(error.value)


@pytest.mark.parametrize("order", ["ENh", "NEh", "hNE"])
def test_names_of_columns_decide_which_is_which(tmp_path, order):
    rows = "\n".join(",".join(str(corner["ENh".index(axis)]) for axis in order) for corner in CORNERS_ENH_M)
    path = read_waypoints(written(tmp_path, f"{','.join(order)}\n{rows}\n"), crs="EPSG:2169", speed_m_s=2.0)
    for corner in CORNERS_ENH_M:
        assert np.abs(path.position_m - corner).sum(axis=1).min() == 0.0
    length_m = np.linalg.norm(np.diff(CORNERS_ENH_M, axis=0), axis=1).sum()
    assert path.stamp_s[-1] == pytest.approx(length_m / 2.0)


def test_one_height_for_all(tmp_path):
    file = written(tmp_path, "E,N\n0,0\n10,0\n")
    path = read_waypoints(file, crs="local", height_m=7.5)
    assert (path.position_m[:, 2] == 7.5).all()
    assert "height_m" in refusal(file, crs="local")


def test_a_place_given_twice_counts_once_and_is_said(tmp_path):
    file = written(tmp_path, "E,N,h\n0,0,0\n0,0,0\n10,0,0\n")
    with pytest.warns(InputWarning, match="1 of 3 rows"):
        path = read_waypoints(file, crs="local")
    assert (np.diff(path.stamp_s) > 0).all()


@given(
    st.lists(st.tuples(*(st.floats(-500.0, 500.0),) * 3), min_size=2, max_size=8),
    st.floats(0.1, 20.0),
)
def test_it_goes_along_the_lines_at_one_speed_and_looks_ahead(corners, speed_m_s):
    corner_m = np.array(corners)
    corner_m[:, 0] += 1000.0 * np.arange(len(corners))  # no two at one place
    path = followed(corner_m, speed_m_s)
    step = np.diff(path.position_m, axis=0)
    length = np.linalg.norm(step, axis=1)
    np.testing.assert_allclose(length / np.diff(path.stamp_s), speed_m_s, rtol=1e-6)
    ahead = Rotation.from_quat(path.quat_wxyz[:-1], scalar_first=True).apply([1.0, 0.0, 0.0])
    level = step[:, :2] / np.linalg.norm(step[:, :2], axis=1, keepdims=True)
    np.testing.assert_allclose(ahead, np.column_stack([level, np.zeros(len(step))]), atol=1e-9)
    assert length.sum() == pytest.approx(np.linalg.norm(np.diff(corner_m, axis=0), axis=1).sum())


def test_straight_up_keeps_the_heading():
    path = followed(np.array([[0.0, 0.0, 0.0], [0.0, 5.0, 0.0], [0.0, 5.0, 3.0], [5.0, 5.0, 3.0]]), 1.0)
    yaw = Rotation.from_quat(path.quat_wxyz, scalar_first=True).as_euler("ZYX")[:, 0]
    rising = (np.diff(path.position_m[:, 2]) > 0).nonzero()[0]
    np.testing.assert_allclose(yaw[rising], np.pi / 2)
    np.testing.assert_allclose(yaw[-1], 0.0, atol=1e-12)
    lift = followed(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 3.0]]), 1.0)
    assert (lift.quat_wxyz[:, 0] == 1.0).all()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x,y,h\n0,0,0\n1,1,1\n", "no column for E, N"),
        ("E,N,h\n0,0,0\n1,,1\n", "path.csv:3: the corner has no N"),
        ("E,N,h\n0,0,0\n1,a,1\n", "path.csv:3: column 'N' holds 'a'"),
        ("E,N,h\n0,0,0\n1,1e12,1\n", "path.csv:3"),
        ("E,N,h\n0,0,0\n", "1 place(s)"),
        ("E,N,N,h\n0,0,0,0\n1,1,1,1\n", "N twice"),
    ],
)
def test_what_is_refused(tmp_path, text, said):
    assert said in refusal(written(tmp_path, text))
