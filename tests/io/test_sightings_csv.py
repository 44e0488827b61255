from pathlib import Path

import numpy as np
import pytest
from data_root import data_root
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation

from jaxgeo.data import Sightings
from jaxgeo.errors import SightingError
from jaxgeo.io import (
    read_corner_sightings,
    read_pose_sightings,
    read_rig,
    write_corner_sightings,
    write_pose_sightings,
)

TAGSLAM = {"stamp_s": 0, "camera": 1, "marker": 2} | {
    f"{uv}{i}": 4 + 2 * i + j for i in range(4) for j, uv in enumerate("uv")
}
CORNER_HEADER = "stamp_s,camera,marker,u0,v0,u1,v1,u2,v2,u3,v3\n"
SQUARE = "10,10,20,10,20,20,10,20"
RIG = read_rig(
    {
        "cameras": {
            "cam0": {
                "intrinsics_px": [500, 500, 320, 240],
                "distortion_model": "none",
                "t_body_cam_m": [0.1, 0.2, 0.3],
                "rotvec_body_cam_rad": [0.0, 0.0, np.pi / 2],
            }
        }
    }
)


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "sightings.csv"
    path.write_text(text)
    return path


def test_real_corners_read_and_survive_a_round_trip(tmp_path: Path) -> None:
    path = data_root() / "tagslam/test_11/tag_detections.csv"
    raw = np.loadtxt(path, delimiter=",")
    read = read_corner_sightings(path, columns=TAGSLAM, camera_names={0: "cam0", "1": "cam1"})
    np.testing.assert_array_equal(read.stamp_s, raw[:, 0])
    np.testing.assert_array_equal(read.corners_px.reshape(-1, 8), raw[:, 4:])
    assert (read.camera == np.where(raw[:, 1] == 0, "cam0", "cam1")).all()
    assert (read.marker == raw[:, 2].astype(int).astype(str)).all()
    assert read.source[0] == "tag_detections.csv:2"
    write_corner_sightings(tmp_path / "again.csv", read)
    again = read_corner_sightings(tmp_path / "again.csv")
    for field in ("stamp_s", "camera", "marker", "corners_px"):
        np.testing.assert_array_equal(getattr(again, field), getattr(read, field))


def test_rows_are_sorted_by_stamp_and_keep_their_source(tmp_path: Path) -> None:
    rows = "".join(f"{stamp},{camera},7,{SQUARE}\n" for stamp, camera in [(2, "b"), (1, "b"), (2, "a"), (1, "a")])
    read = read_corner_sightings(write(tmp_path, CORNER_HEADER + rows))
    assert read.stamp_s.tolist() == [1, 1, 2, 2]
    assert read.camera.tolist() == ["b", "a", "b", "a"]
    assert read.source.tolist() == [f"sightings.csv:{line}" for line in (3, 5, 2, 4)]


def test_camera_and_marker_may_be_left_out(tmp_path: Path) -> None:
    path = write(tmp_path, CORNER_HEADER.replace("camera,marker,", "") + f"1,{SQUARE}\n")
    read = read_corner_sightings(path, camera="cam0")
    assert (read.camera.tolist(), read.marker.tolist()) == (["cam0"], [""])
    with pytest.raises(SightingError, match="names no camera column, and `camera` is not given"):
        read_corner_sightings(path)
    with pytest.raises(SightingError, match="has a camera column; expected either"):
        read_corner_sightings(write(tmp_path, CORNER_HEADER + f"1,c,7,{SQUARE}\n"), camera="cam0")


def test_a_corner_sigma_becomes_a_covariance_and_survives_a_round_trip(tmp_path: Path) -> None:
    header = CORNER_HEADER.replace("\n", ",family,sigma_px\n")
    rows = [f"{stamp},cam0,7,{SQUARE},36h11,{sigma}\n" for stamp, sigma in ((2, "0.25"), (1, ""), (3, "0.5"))]
    read = read_corner_sightings(write(tmp_path, header + "".join(rows)))
    assert read.covariance_px2 is not None
    assert np.isnan(read.covariance_px2[0]).all()
    np.testing.assert_array_equal(read.covariance_px2[1:], np.array([0.0625, 0.25])[:, None, None] * np.eye(8))
    write_corner_sightings(tmp_path / "again.csv", read)
    again = read_corner_sightings(tmp_path / "again.csv")
    assert again.covariance_px2 is not None
    np.testing.assert_allclose(again.covariance_px2, read.covariance_px2, rtol=1e-15)
    np.testing.assert_array_equal(again.corners_px, read.corners_px)
    none = read_corner_sightings(write(tmp_path, header + rows[1]))
    assert none.covariance_px2 is None
    for bad in ("0", "-0.1"):
        with pytest.raises(
            SightingError, match=rf"sightings\.csv:2: sigma_px is {bad}; expected the standard deviation"
        ):
            read_corner_sightings(write(tmp_path, header + f"1,cam0,7,{SQUARE},36h11,{bad}\n"))


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("1,c,7,nan,10,20,10,20,20,10,20", r"sightings\.csv:3: column 'u0' holds 'nan'; expected a finite number"),
        ("1,c,7,10,10,10,10,20,20,10,20", r"sightings\.csv:3: two of the four corners coincide"),
        ("1,c,7,10,10,20,20,20,10,10,20", r"sightings\.csv:3: the outline of the four corners crosses itself"),
        ("1,c,7,10,10,20,10,20,20,10,2e5", r"sightings\.csv:3: a corner lies beyond 100000 px"),
        (f"1e18,c,7,{SQUARE}", r"sightings\.csv:3: stamp 1e\+18 is not in seconds"),
        (f"1,d,7,{SQUARE}", r"sightings\.csv:3: camera 'd' is not in `camera_names`, which has c"),
        ("1,c,7,10,10,20,10,20,20,10", r"sightings\.csv:3: 10 columns, expected 11"),
        (f"1,c,7,{SQUARE[:-2]}--", r"sightings\.csv:3: column 'v3' holds '--'; expected a number"),
    ],
)
def test_bad_corners(tmp_path: Path, row: str, message: str) -> None:
    path = write(tmp_path, f"{CORNER_HEADER}1,c,7,-27.5,10,20,10,20,20,10,20\n{row}\n")
    with pytest.raises(SightingError, match=message):
        read_corner_sightings(path, camera_names={"c": "cam0"})


@st.composite
def pose_sightings(draw: st.DrawFn) -> Sightings:
    n = draw(st.integers(1, 4))
    rotated = draw(hnp.arrays(bool, n))
    factor = draw(hnp.arrays(float, (n, 6, 6), elements=st.floats(-1, 1)))
    covariance = factor @ factor.mT + 0.1 * np.eye(6)
    covariance[~rotated, 3:] = 0.0
    covariance[~rotated, :, 3:] = 0.0
    quat_wxyz = draw(hnp.arrays(float, (n, 4), elements=st.floats(0.1, 1)))
    quat_wxyz /= np.linalg.norm(quat_wxyz, axis=1, keepdims=True)
    quat_wxyz[~rotated] = np.nan
    return Sightings(
        stamp_s=np.cumsum(draw(hnp.arrays(float, n, elements=st.floats(0, 1e3)))),
        marker=np.array(draw(st.lists(st.sampled_from(["", "7", "A 1"]), min_size=n, max_size=n))),
        t_body_marker_m=draw(hnp.arrays(float, (n, 3), elements=st.floats(-1e3, 1e3))),
        quat_body_marker_wxyz=quat_wxyz,
        covariance=covariance,
        ambiguous=draw(hnp.arrays(bool, n)),
        reprojection_px=draw(hnp.arrays(float, n, elements=st.sampled_from([0.5, 1 / 3, np.nan]))),
        source=np.array([f"poses.csv:{line}" for line in range(2, n + 2)]),
    )


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=40)
@given(sightings=pose_sightings())
def test_reading_written_poses_changes_nothing(tmp_path: Path, sightings: Sightings) -> None:
    write_pose_sightings(tmp_path / "poses.csv", sightings)
    read = read_pose_sightings(tmp_path / "poses.csv")
    for field in ("stamp_s", "marker", "t_body_marker_m", "ambiguous", "reprojection_px", "source"):
        np.testing.assert_array_equal(getattr(read, field), getattr(sightings, field))
    np.testing.assert_array_equal(read.quat_body_marker_wxyz, sightings.quat_body_marker_wxyz)
    upper = np.triu_indices(6)
    np.testing.assert_array_equal(read.covariance[:, *upper], sightings.covariance[:, *upper])


def test_positions_alone(tmp_path: Path) -> None:
    read = read_pose_sightings(write(tmp_path, "stamp_s,x,y,z\n1,2,3,4\n"), sigma_m=0.1)
    assert np.isnan(read.quat_body_marker_wxyz).all()
    np.testing.assert_allclose(read.covariance[0], np.diag([0.01] * 3 + [0.0] * 3))
    assert np.isnan(read.reprojection_px).all()


def test_poses_in_a_camera_move_to_the_body(tmp_path: Path) -> None:
    path = write(tmp_path, "stamp_s,marker,x,y,z,qx,qy,qz,qw,sigma_rot_rad\n1,7,1,2,3,0,0,0,1,0.2\n2,7,1,2,3,,,,,\n")
    read = read_pose_sightings(path, sigma_m=0.1, camera="cam0", rig=RIG)
    np.testing.assert_allclose(read.t_body_marker_m, [[0.1 - 2, 0.2 + 1, 0.3 + 3]] * 2)
    np.testing.assert_allclose(read.quat_body_marker_wxyz[0], [np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    assert np.isnan(read.quat_body_marker_wxyz[1]).all()
    np.testing.assert_allclose(np.diag(read.covariance[0]), [0.01] * 3 + [0.04] * 3)
    assert not read.covariance[1, 3:].any()


def test_the_covariance_turns_with_the_axes(tmp_path: Path) -> None:
    body = read_pose_sightings(
        write(tmp_path, "stamp_s,x,y,z,qx,qy,qz,qw\n1,1,2,3,0,0,0,1\n"), sigma_m=1, sigma_rot_rad=1
    )
    rng = np.random.default_rng(0)
    factor = rng.normal(size=(1, 6, 6))
    given = Sightings(**{**vars(body), "covariance": factor @ factor.mT})
    write_pose_sightings(tmp_path / "camera.csv", given)
    read = read_pose_sightings(tmp_path / "camera.csv", camera="cam0", rig=RIG)
    # An error drawn in camera axes, applied as the docstring of Sightings says, then seen from the body.
    R_body_cam = Rotation.from_rotvec([0, 0, np.pi / 2]).as_matrix()
    error_cam = factor[0] @ rng.normal(size=(6, 200_000))
    error_body = np.vstack([R_body_cam @ error_cam[:3], R_body_cam @ error_cam[3:]])
    np.testing.assert_allclose(read.covariance[0], np.cov(error_body), atol=0.03 * np.abs(read.covariance).max())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("stamp_s,x,y,z\n1,2,3,4\n", r"sightings\.csv:2: sigma_m is missing; expected a positive number"),
        ("stamp_s,x,y,z,sigma_m\n1,2,3,4,-1\n", r"sightings\.csv:2: sigma_m is -1"),
        (
            "stamp_s,x,y,z,sigma_m,qx,qy,qz,qw\n1,2,3,4,1,0,0,0,1\n",
            r"csv:2: sigma_rot_rad is missing.*or leave the quat",
        ),
        ("stamp_s,x,y,z,sigma_m,qx,qy,qz,qw\n1,2,3,4,1,0,0,0,2\n", r"csv:2: the quaternion has norm 2"),
        ("stamp_s,x,y,z,sigma_m,qx,qy,qz,qw\n1,2,3,4,1,0,0,,1\n", r"csv:2: the quaternion is given in part"),
        ("stamp_s,x,y,z,sigma_m,qx\n1,2,3,4,1,0\n", r"of the quaternion only qx; expected qx, qy, qz, qw or none"),
        ("stamp_s,x,y,z,cov_00\n1,2,3,4,1\n", r"1 of the 21 columns cov_00 \.\. cov_55"),
        ("stamp_s,x,y\n1,2,3\n", r"no column for z; the header has stamp_s, x, y"),
        ("stamp_s,x,y,z,sigma_m\n1,2,3,4e9,1\n", r"csv:2: coordinate 4e\+09 m is beyond"),
    ],
)
def test_bad_poses(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(SightingError, match=message):
        read_pose_sightings(write(tmp_path, text))


def test_covariances_that_are_none(tmp_path: Path) -> None:
    good = read_pose_sightings(write(tmp_path, "stamp_s,x,y,z\n1,2,3,4\n"), sigma_m=0.1)
    covariance = good.covariance.copy()
    covariance[0, 0, 1] = covariance[0, 1, 0] = 0.02
    write_pose_sightings(tmp_path / "bad.csv", Sightings(**{**vars(good), "covariance": covariance}))
    with pytest.raises(SightingError, match=r"bad\.csv:2: the covariance is not positive definite"):
        read_pose_sightings(tmp_path / "bad.csv")


def test_a_camera_must_be_of_the_rig(tmp_path: Path) -> None:
    path = write(tmp_path, "stamp_s,x,y,z\n1,2,3,4\n")
    with pytest.raises(SightingError, match="in camera 'cam1', but the rig has cam0"):
        read_pose_sightings(path, sigma_m=1, camera="cam1", rig=RIG)
    with pytest.raises(SightingError, match="in camera 'cam1', but no rig is given"):
        read_pose_sightings(path, sigma_m=1, camera="cam1")


def test_names_that_would_break_the_table_are_refused(tmp_path: Path) -> None:
    read = read_pose_sightings(write(tmp_path, "stamp_s,x,y,z\n1,2,3,4\n"), sigma_m=0.1)
    with pytest.raises(SightingError, match="name 'a,b' cannot be written"):
        write_pose_sightings(tmp_path / "bad.csv", Sightings(**{**vars(read), "marker": np.array(["a,b"])}))
    assert [file.name for file in tmp_path.iterdir()] == ["sightings.csv"]
