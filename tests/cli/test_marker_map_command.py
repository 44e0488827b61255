"""`jaxgeo marker-map`: the photographs' room, files, messages and exit codes."""

import json

import matplotlib.image
import numpy as np
import pytest

from jaxgeo.cli.main import main
from jaxgeo.data import CornerSightings
from jaxgeo.io.sightings_csv import write_corner_sightings
from jaxgeo.io.tum import read_tum
from tests.data_root import data_root
from tests.solve.marker_room import SIDE_M, sighted
from tests.solve.marker_room import room_rig as rig_of_room

RIG = """cameras:
  cam0: {model: pinhole, intrinsics_px: [INTRINSICS], distortion_model: none, distortion: [],
         t_body_cam_m: [T], rotvec_body_cam_rad: [W]}
"""


def rig_file(folder, intrinsics="700, 710, 400, 300", t="0.1, -0.05, 0.2", w="0.1, -0.2, 0.05"):
    path = folder / "rig.yaml"
    path.write_text(RIG.replace("INTRINSICS", intrinsics).replace("T]", f"{t}]").replace("W]", f"{w}]"))
    return path


def room_table(folder, keep=lambda corners: slice(None)):
    corners, *_ = sighted(rig_of_room(), 0.2)
    rows = keep(corners)
    parts = (corners.stamp_s, corners.camera, corners.marker, corners.corners_px, corners.source)
    write_corner_sightings(folder / "corners.csv", CornerSightings(*(part[rows] for part in parts)))
    return folder / "corners.csv"


def arguments(table, rig, out, side=SIDE_M):
    return ["marker-map", str(table), "--rig", str(rig), "--size", str(side), "--out", str(out)]


def test_files_of_a_room(tmp_path, capsys):
    out = tmp_path / "map"
    assert main([*arguments(room_table(tmp_path), rig_file(tmp_path), out), "--origin", "m1", "--refine-camera"]) == 0
    assert "frame: marker m1" in capsys.readouterr().out
    rows = [line.split(",") for line in (out / "marker_map.csv").read_text().splitlines() if line[0] != "#"]
    assert [row[0] for row in rows[1:]] == ["m0", "m1", "m2", "m3", "m4"]
    own = dict(zip(rows[0], rows[2], strict=True))
    assert float(own["x"]) == 0.0
    assert float(own["qw"]) == 1.0
    assert float(own["cov_00"]) == 0.0
    numbers = json.loads((out / "marker_map.json").read_text())
    assert len(read_tum(out / "image_poses.tum")) == numbers["images"] == len(numbers["by_image"]) == 10
    assert 0.05 < numbers["reprojection_median_px"] < 0.4
    assert numbers["refined_camera"]["distortion_model"] == "radtan"
    picture = matplotlib.image.imread(out / "marker_map.png")
    assert picture.shape[1] > 1000
    assert picture.std() > 0.05


@pytest.mark.parametrize(
    ("keep", "more", "code", "message"),
    [
        (lambda c: np.flatnonzero(c.marker == "m2"), [], 3, "only marker 'm2' was seen"),
        (lambda c: np.flatnonzero((c.marker == "m2") ^ (c.stamp_s < 4)), [], 3, "2 groups that no image links"),
        (lambda c: slice(None), ["--origin", "m9"], 2, "the origin 'm9' is not among the markers seen"),
        (lambda c: slice(None), ["--only", "m9"], 2, "no marker 'm9' (--only)"),
        (lambda c: slice(None), ["--pixel-sigma", "-1"], 2, "the pixel sigma is -1.0; expected a number above zero"),
    ],
)
def test_what_cannot_be_mapped(tmp_path, capsys, keep, more, code, message):
    table = room_table(tmp_path, keep)
    assert main([*arguments(table, rig_file(tmp_path), tmp_path / "map"), *more]) == code
    assert message in capsys.readouterr().err
    assert not (tmp_path / "map").exists()


def test_the_photographs(tmp_path):
    """Corners found by `jaxgeo detect` in every second of the 72 photographs; 20 markers on the walls of a room."""
    photographs = data_root() / "tags" / "swatbotics_mapping"
    if not photographs.is_dir():
        pytest.skip(f"REAL DATA MISSING: {photographs}")
    half = tmp_path / "half"
    half.mkdir()
    for path in sorted(photographs.glob("*.JPG"))[::2]:
        (half / path.name).symlink_to(path)
    found = tmp_path / "found"
    detect = ["detect", str(half), "--family", "apriltag_36h11", "--rate", "1", "--overlays", "0", "--quiet"]
    assert main([*detect, "--out", str(found)]) == 0
    rig = rig_file(tmp_path, "765.00, 764.18, 393.72, 304.66", "0, 0, 0", "0, 0, 0")
    assert main([*arguments(found / "corners.csv", rig, tmp_path / "map", 0.127), "--quiet"]) == 0
    numbers = json.loads((tmp_path / "map" / "marker_map.json").read_text())
    assert (numbers["markers"], numbers["images"]) == (20, 36)
    assert numbers["sightings"] > 110
    assert numbers["reprojection_median_px"] < 0.45
    assert len(numbers["outliers"]) <= 6
