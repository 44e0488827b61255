import json
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import pytest
import typer
from mapping.corrected_files import ORIGIN, write_corrected
from scipy.spatial.transform import Rotation

from jaxgeo.cli.warp import WarpOptions, record_path, warp_cloud
from jaxgeo.cli.warp_command import warp
from jaxgeo.data import Trajectory
from jaxgeo.errors import JaxgeoError
from jaxgeo.io import write_tum
from jaxgeo.io.clouds import CloudChunk, cloud_writer, open_cloud

N_POSES, N_POINTS = 60, 2_500
TURN = Rotation.from_euler("z", 1.1)


def before() -> Trajectory:
    """Round a circle of 20 m radius, once, as an odometry has it."""
    angle = np.linspace(0.0, 2.0 * np.pi, N_POSES)
    position_m = 20.0 * np.column_stack([np.cos(angle), np.sin(angle), 0.02 * angle])
    attitude = Rotation.from_euler("z", angle[:, None])
    return Trajectory(1.7e9 + 0.5 * np.arange(N_POSES), position_m, attitude.as_quat(scalar_first=True))


def after() -> Trajectory:
    """The same, turned into the grid and straightened: at its end 1 m and 2 degrees off what it was."""
    share = np.linspace(0.0, 1.0, N_POSES)[:, None]
    given = before()
    attitude = Rotation.from_euler("z", np.radians(2.0) * share) * TURN * rotation_of(given)
    position_m = TURN.apply(given.position_m) + share * [1.0, 0.0, 0.2] + [40.0, 30.0, 5.0]
    return Trajectory(given.stamp_s, position_m, attitude.as_quat(scalar_first=True))


def rotation_of(trajectory: Trajectory) -> Rotation:
    return Rotation.from_quat(trajectory.quat_wxyz, scalar_first=True)


POSE = np.random.default_rng(0).integers(0, N_POSES, N_POINTS)
BODY_M = np.random.default_rng(1).uniform(-4.0, 4.0, (N_POINTS, 3))
EXPECTED_ENH_M = rotation_of(after())[POSE].apply(BODY_M) + after().position_m[POSE] + ORIGIN


@pytest.fixture
def session(tmp_path: Path) -> Path:
    write_tum(tmp_path / "icp.tum", before())
    write_corrected(tmp_path / "out", after(), simulated=True)
    return tmp_path


def write_cloud(path: Path, **columns: np.ndarray) -> Path:
    points_m = rotation_of(before())[POSE].apply(BODY_M) + before().position_m[POSE]
    with cloud_writer(path, {name: v.dtype for name, v in columns.items()}, np.zeros(3), None) as writer:
        writer.append(CloudChunk(points_m, columns))
    return path


def warped(session: Path, cloud: Path, **options) -> Path:
    return warp_cloud(cloud, session / "icp.tum", session / "out", WarpOptions(**options), quiet=True)


@pytest.mark.parametrize("suffix", [".ply", ".laz"])
@pytest.mark.parametrize("by", ["stamp", "index"])
def test_every_point_lands_where_its_pose_saw_it(session: Path, by: str, suffix: str) -> None:
    seen = {"stamp_s": before().stamp_s[POSE]} if by == "stamp" else {"pose_index": POSE.astype(np.int32)}
    cloud = write_cloud(session / f"map{suffix}", classification=(POSE % 7).astype(np.uint8), **seen)
    out = warped(session, cloud, chunk=1000, crs="EPSG:2169+5774")
    las = laspy.read(out)
    assert out == session / "map_grid.laz"
    # The cloud was rounded to millimetres when it was written and again now
    np.testing.assert_allclose(las.xyz, EXPECTED_ENH_M, atol=0.0017 if suffix == ".laz" else 0.0005 + 1e-9)
    np.testing.assert_array_equal(las.classification, POSE % 7)
    assert b"SIMULATED DATA" in b"".join(
        v.record_data for v in las.header.vlrs if v.user_id == "LASF_Spec" and v.record_id == 3
    )
    record = json.loads(record_path(out).read_text())
    assert (record["by"], record["simulated"], record["points"]["written"]) == (by, True, N_POINTS)
    assert record["frame"]["crs"] == "EPSG:2169+5774"
    assert record["frame"]["origin_enh_m"] == ORIGIN.tolist()
    assert 0.2 < record["from_one_rigid_transform_m"]["rms"] < record["from_one_rigid_transform_m"]["max"] < 1.5
    assert sorted(p.name for p in session.iterdir()) == sorted(
        [cloud.name, "icp.tum", "map_grid.laz", "map_grid.warp.json", "out"]
    )


def test_without_stamps_the_nearest_poses_carry(session: Path, capsys: pytest.CaptureFixture) -> None:
    out = warp_cloud(write_cloud(session / "map.ply"), session / "icp.tum", session / "out", WarpOptions())
    away_m = np.linalg.norm(laspy.read(out).xyz - EXPECTED_ENH_M, axis=1)
    assert np.median(away_m) < 0.1
    said = capsys.readouterr()
    assert (
        "by nearest: the poses nearest to each point (it has no stamp_s; it has no pose_index) (simulated" in said.out
    )
    assert "warning: " in said.err
    assert "may have been seen in another pass" in said.err  # where the circle closes


def test_normals_turn_and_ply_keeps_the_origin(session: Path) -> None:
    normals = dict(zip(("nx", "ny", "nz"), np.tile([1.0, 0.0, 0.0], (N_POINTS, 1)).T.astype(np.float32), strict=True))
    cloud = write_cloud(session / "map.ply", pose_index=POSE.astype(np.int32), **normals)
    source = open_cloud(warped(session, cloud, out=session / "new" / "there.ply"))
    chunk = next(source.chunks())
    turned = rotation_of(after())[POSE] * rotation_of(before())[POSE].inv()
    np.testing.assert_allclose(chunk.normal, turned.apply([1.0, 0.0, 0.0]), atol=1e-6)
    np.testing.assert_allclose(chunk.points_m + source.origin_enh_m, EXPECTED_ENH_M, atol=1e-9)
    assert source.crs == "EPSG:2169"


def test_points_that_no_pose_saw(session: Path, capsys: pytest.CaptureFixture) -> None:
    stamp_s = before().stamp_s[POSE]
    stamp_s[:20] += 100.0
    cloud = write_cloud(session / "map.ply", stamp_s=stamp_s)
    with pytest.raises(JaxgeoError, match=r"map\.ply: 20 of 2,500 points were seen by no pose.*--drop-outside"):
        warped(session, cloud)
    assert not (session / "map_grid.laz").exists()
    options = WarpOptions(drop_outside=True, chunk=1000)
    out = warp_cloud(cloud, session / "icp.tum", session / "out", options)
    np.testing.assert_allclose(laspy.read(out).xyz, EXPECTED_ENH_M[20:], atol=0.0005 + 1e-9)
    assert "warning: " in (said := capsys.readouterr().err)
    assert "20 of 2,500 points are left out" in said
    assert json.loads(record_path(out).read_text())["points"] == {"written": 2480, "outside": 20, "of_unknown_pass": 0}


def test_points_that_are_no_numbers_are_counted(session: Path) -> None:
    with cloud_writer(session / "map.ply", {"pose_index": np.dtype("i4")}, np.zeros(3), None) as writer:
        writer.append(
            CloudChunk(np.array([[1.0, 2.0, 3.0], [np.nan, 0.0, 0.0]]), {"pose_index": np.zeros(2, np.int32)})
        )
    record = json.loads(record_path(warped(session, session / "map.ply")).read_text())
    assert record["points"]["written"] == 1
    assert "1 of 2 points are left out: not finite" in record["warnings"][0]


def cut(session: Path) -> None:
    file = session / "map.ply"
    file.write_bytes(file.read_bytes()[:-5])


def other_clock(session: Path) -> None:
    given = before()
    write_tum(session / "icp.tum", Trajectory(given.stamp_s - 1.7e9, given.position_m, given.quat_wxyz))


def no_rows(session: Path) -> None:
    (session / "out" / "trajectory.tum").write_text("# nothing\n")


@pytest.mark.parametrize(
    ("spoil", "options", "message"),
    [
        (cut, {}, r"map\.ply: the header announces 2500 vertices"),
        (other_clock, {}, r"0 of 60 poses before have the stamp of one of the 60 poses after"),
        (no_rows, {}, r"trajectory\.tum: no data rows"),
        (None, {"by": "index"}, "cannot be carried by index: it has no pose_index"),
        (None, {"by": "time"}, "--by 'time'; expected one of stamp, index, nearest"),
        (None, {"crs": "EPSG:32632"}, "is in EPSG:2169, but --crs says EPSG:32632"),
        (None, {"trajectory": "vio"}, "holds the trajectory 'icp', not 'vio'"),
        (None, {"out": Path("cloud.e57")}, r"--out cloud\.e57: suffix '\.e57'"),
        (None, {"scale": 9.0}, "differ by .* times as long: .*--scale"),
    ],
)
def test_refusals_leave_nothing(
    session: Path, spoil: Callable[[Path], None] | None, options: dict, message: str
) -> None:
    cloud = write_cloud(session / "map.ply", stamp_s=before().stamp_s[POSE])
    if spoil is not None:
        spoil(session)
    there = sorted(session.rglob("*"))
    with pytest.raises(JaxgeoError, match=message) as refused:
        warped(session, cloud, **options)
    assert refused.value.exit_code == 2
    assert sorted(session.rglob("*")) == there


def test_the_cloud_itself_is_not_overwritten(session: Path) -> None:
    cloud = write_cloud(session / "map.laz", stamp_s=before().stamp_s[POSE])
    with pytest.raises(JaxgeoError, match="is the cloud itself"):
        warped(session, cloud, out=session / "out" / ".." / "map.laz")


def test_the_command_line(session: Path, capsys: pytest.CaptureFixture) -> None:
    cloud = write_cloud(session / "map.ply", stamp_s=before().stamp_s[POSE])
    app = typer.Typer()
    app.command()(warp)
    given = [str(cloud), "--before", str(session / "icp.tum"), "--after", str(session / "out"), "--quiet"]
    app([*given, "--out", str(session / "a.las"), "--hold", "0.5", "--trajectory", "icp"], standalone_mode=False)
    assert len(laspy.read(session / "a.las").points) == N_POINTS
    said = capsys.readouterr()
    assert (said.out, said.err) == ("", "")
