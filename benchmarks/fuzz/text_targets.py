"""Readers of tables, graphs, GeoJSON and JSON, with small valid files for each."""

import functools
import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.fuzz import checks
from benchmarks.fuzz.target import Target
from jaxgeo.detect.tune import read_labelled
from jaxgeo.graph.components import COMPONENTS
from jaxgeo.io.areas_geojson import read_areas
from jaxgeo.io.control_points import read_control_points
from jaxgeo.io.euroc import read_euroc
from jaxgeo.io.frames.stamp_table import read_stamp_table
from jaxgeo.io.g2o_graph import read_g2o_graph
from jaxgeo.io.g2o_poses import read_g2o_poses
from jaxgeo.io.item_stamps import is_stamp_list, listed_stamps
from jaxgeo.io.kitti import read_kitti
from jaxgeo.io.noise_json import read_noise
from jaxgeo.io.npy_poses import read_npy_poses
from jaxgeo.io.rgbd.associations import read_associations
from jaxgeo.io.row_stamps import row_stamps
from jaxgeo.io.rtabmap.pose_export import read_rtabmap_poses
from jaxgeo.io.rtabmap.toro_poses import read_toro_poses
from jaxgeo.io.sightings_csv import read_corner_sightings, read_pose_sightings
from jaxgeo.io.survey_csv import read_survey
from jaxgeo.io.trajectory_file import read_trajectory
from jaxgeo.io.tum import read_indexed_tum, read_tum
from jaxgeo.io.waypoints_csv import read_waypoints
from jaxgeo.mapping.carried_after import read_corrected

_TUM = b"""# stamp x y z qx qy qz qw
1305031102.1758 1.3405 0.6266 1.6575 0.6574 0.6126 -0.2949 -0.3248
1305031102.2758 1.3500 0.6300 1.6600 0.6574 0.6126 -0.2949 -0.3248
1305031102.3758 1.3600 0.6400 1.6700 0 0 0 1
"""
_KITTI = b"""1 0 0 0 0 1 0 0 0 0 1 0
0.9999 0.0118 0.0078 -0.0468 -0.0118 0.9999 0.0021 -0.0283 -0.0078 -0.0022 0.9999 0.8586
0 -1 0 2.5 1 0 0 1e-3 0 0 1 -4
"""
_EUROC = b"""#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []
1403636580838555648,4.688319,-1.786938,0.783338,0.534108,-0.153029,-0.827383,-0.082152
1403636580843555648,4.688177,-1.786770,0.787350,0.534640,-0.152990,-0.826976,-0.082863
1403636580848555648,4.688028,-1.786598,0.791382,0.535178,-0.152945,-0.826562,-0.083605
"""
_UPPER = "1 0 0 0 0 0 2 0 0 0 0 3 0 0 0 4 0 0 5 0 6"
_G2O = f"""VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1
VERTEX_SE3:QUAT 1 1 0 0 0 0 0.3826834324 0.9238795325
VERTEX_SE3:QUAT 7 2.5 1e-3 0 0 0 0 1
FIX 0
EDGE_SE3:QUAT 0 1 1 0 0 0 0 0.3826834324 0.9238795325 {_UPPER}
EDGE_SE3:QUAT 1 7 1.5 0 0 0 0 0 1 {_UPPER}
""".encode()
_G2O_LANDMARKS = f"""PARAMS_SE3OFFSET 0 0 0 0 0 0 0 1
VERTEX_SE3:QUAT 1 0 0 0 0 0 0 1
VERTEX_SE3:QUAT 2 1 0 0 0 0 0 1
VERTEX_SE3:QUAT 3 1 2 3 0 0 0 1
EDGE_SE3:QUAT 1 2 1 0 0 0 0 0 1 {_UPPER}
EDGE_SE3 1 3 0 1 2 3 0 0 0 1
EDGE_SE2 1 2 3
""".encode()
_TORO = b"VERTEX3 1 0 0 0 0 0 0\nVERTEX3 2 1 0 0 0.1 -0.2 3\nVERTEX3 3 2 1 0 0.1 0 -3\nEDGE3 1 2 1 0 0 0 0 0\n"
_TORO_FLAT = b"VERTEX2 1 0 0 0\nVERTEX2 2 1 0 0.5\nVERTEX2 3 2 1 1.5\n"
_SURVEY = b"""name,N,E,h,sigma_N,sigma_E,sigma_h
A,76850.123,79300.456,312.1,0.01,0.01,0.02
B,76851.5,79310,312.5,0.01,0.01,0.02
"C 2",76899,79320.25,311,0.01,0.01,0.02
"""
_SURVEY_TURNED = b"""# made by hand
point; easting; northing; height (m); rx; ry; rz; sigma_rx; sigma_ry; sigma_rz; sigma_m
A; 79300.456; 76850.123; 312.1; 0; 0; 1.5; 0.01; 0.01; 0.01; 0.01
B; 79310; 76851.5; 312.5; ; ; ; ; ; ; 0.02
"""
_CONTROL = b"stamp_s,name,E,N,h\n10.5,A,79300.1,76850,312\n20,B,79310,76851,312.5\n30,A,79300.11,76850,312\n"
_CORNERS = b"""stamp_s,camera,marker,u0,v0,u1,v1,u2,v2,u3,v3,sigma_px
10.5,cam0,7,100,100,150.5,100,150,150,100,150,0.4
10.6,cam1,,100,101,150.5,100,150,150,100,150,
10.4,cam0,8,300,100,350.5,100,350,150,300,150,1e-1
"""
_POSES = b"""stamp_s,marker,x,y,z,qx,qy,qz,qw,sigma_m,sigma_rot_rad,ambiguous,reprojection_px
10.5,7,1,0.5,2,0,0,0,1,0.01,0.02,0,0.3
10.4,8,1.1,0.5,2.1,0,0,0.7071067812,0.7071067812,0.01,0.02,1,
"""
_COV_NAMES = ",".join(f"cov_{i}{j}" for i in range(6) for j in range(i, 6))
_POSES_COV = f"""stamp_s,x,y,z,qw,qx,qy,qz,{_COV_NAMES}
10.5,1,0.5,2,1,0,0,0,{_UPPER.replace(" ", ",")}
11.5,1,0.6,2,1,0,0,0,{_UPPER.replace(" ", ",")}
12.5,1,0.6,2,,,,,{_UPPER.replace(" ", ",")}
""".encode()
_WAYPOINTS = b"name,E,N,h\na,79300,76850,312\nb,79310,76850,312\nc,79310,76850,315\nd,79310,76890,312\n"
_STAMPS = b"stamp_s,file,camera\n10.5,a.png,cam0\n10.6,b.png,cam0\n10.5,c.png,cam1\n"
_STAMPS_NS = b"#timestamp [ns],filename\n1403636579763555584,1403636579763555584.png\n1403636579813555456,b.png\n"
_STAMP_LIST = b"# seconds\n10.5\n10.6\n10.75\n"
_PAIRS = b"# rgb depth\n1.5 rgb/a.png 1.51 depth/a.png\n1.6 rgb/b.png 1.61 depth/b.png\n"
_RING = [[6.1, 49.6], [6.2, 49.6], [6.2, 49.7], [6.1, 49.6]]
_AREAS = json.dumps(
    {
        "type": "FeatureCollection",
        "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::2169"}},
        "features": [
            {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [_RING, _RING]}},
            {"type": "Feature", "geometry": {"type": "GeometryCollection", "geometries": [
                {"type": "MultiPolygon", "coordinates": [[_RING], [[[*point, 300] for point in _RING]]]}]}},
        ],
    }
).encode()  # fmt: skip
_GRID = b"""# corrected trajectory 'icp': body poses
# crs: EPSG:2169 (compound)
stamp_s,E_m,N_m,h_m,qw,qx,qy,qz,sigma_E_m
1.5,79300.5,76850,312,1,0,0,0,0.1
2.5,79301.5,76850,312,1,0,0,0,0.1
"""
_LOCAL = b"""# corrected trajectory 'icp': body poses
# crs: EPSG:2169 (LUREF), origin E=79300 N=76800 h=300 m
1 0 0 0 0 0 0 1
2 1 0 0 0 0 0 1
"""


def _noise() -> bytes:
    n = len(COMPONENTS)
    learned = {
        "components": list(COMPONENTS),
        "kind": "lidar",
        "observations": "both",
        "theta_mean": [-3.0 + 0.1 * i for i in range(n)],
        "theta_covariance": (0.5 * np.eye(n) + 0.1).tolist(),
        "ensemble": {"weight": [0.25, 0.75], "sigma": [[0.01] * n, [0.02] * n], "correlation_m": 12.5},
    }
    return json.dumps(
        {"session": "walk", "simulated": False, "trajectories": {"icp": {"fixed": {}, "learned": learned}}}
    ).encode()


def _npy(poses: np.ndarray) -> bytes:
    import io

    file = io.BytesIO()
    np.save(file, poses)
    return file.getvalue()


def _three_poses() -> np.ndarray:
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, 0, 3] = [0.0, 1.0, 2.5]
    return poses


def _table(
    name: str, read: Callable[[Path], Any], check: Callable[[Any], None], *examples: bytes, covers: str, suffix=".csv"
) -> Target:
    return Target(name, suffix, "text", read, check, lambda: examples, (covers,))


def _stamps_beside(path: Path) -> Any:
    return row_stamps("poses.txt", 3, times=path, rate_hz=None)


def _stamp_list(path: Path) -> list[Any]:
    if not is_stamp_list(path):
        return []
    return listed_stamps("scans", 3, path, "scan")[0].tolist()


@functools.cache
def _images() -> tuple[tempfile.TemporaryDirectory, Path]:
    folder = tempfile.TemporaryDirectory()
    for name in ("rgb/a.png", "rgb/b.png", "depth/a.png", "depth/b.png"):
        file = Path(folder.name) / name
        file.parent.mkdir(exist_ok=True)
        file.touch()
    return folder, Path(folder.name)


def _pairs(path: Path) -> Any:
    """Pairs by a damaged list beside the images that the sound one names."""
    beside = _images()[1] / "associations.txt"
    beside.write_bytes(path.read_bytes())
    return read_associations(beside)


@functools.cache
def _picture() -> tuple[tempfile.TemporaryDirectory, Path]:
    folder = tempfile.TemporaryDirectory()
    (Path(folder.name) / "a.png").write_bytes(cv2.imencode(".png", np.zeros((20, 30, 3), np.uint8))[1].tobytes())
    return folder, Path(folder.name)


def _labelled(path: Path) -> Any:
    """The image of a folder under damaged outlines."""
    folder = _picture()[1]
    (folder / "labels.csv").write_bytes(path.read_bytes())
    return read_labelled(folder)


def _check_labelled(value: list[Any]) -> None:
    assert value
    assert all(frame.label.shape == frame.bgr.shape[:2] for frame in value)


_RATE = {"rate_hz": 10.0}
_GRID_CRS = {"crs": "EPSG:2169"}
_IO = "jaxgeo.io"

TEXT_TARGETS = (
    _table("tum", read_tum, checks.trajectory, _TUM, covers=f"{_IO}.tum.read_tum", suffix=".tum"),
    _table(
        "tum-index",
        functools.partial(read_indexed_tum, **_RATE),
        checks.trajectory,
        b"0 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n2 2 0 0 0 0 0 1\n",
        covers=f"{_IO}.tum.read_indexed_tum",
    ),
    _table(
        "kitti", functools.partial(read_kitti, **_RATE), checks.trajectory, _KITTI, covers=f"{_IO}.kitti.read_kitti"
    ),
    _table("euroc", read_euroc, checks.trajectory, _EUROC, covers=f"{_IO}.euroc.read_euroc"),
    _table(
        "g2o-poses",
        functools.partial(read_g2o_poses, **_RATE),
        checks.trajectory,
        *(_G2O, _G2O_LANDMARKS),
        covers=f"{_IO}.g2o_poses.read_g2o_poses",
        suffix=".g2o",
    ),
    _table(
        "g2o-graph",
        read_g2o_graph,
        checks.graph,
        *(_G2O, _G2O_LANDMARKS),
        covers=f"{_IO}.g2o_graph.read_g2o_graph",
        suffix=".g2o",
    ),
    _table(
        "toro",
        functools.partial(read_toro_poses, **_RATE),
        checks.trajectory,
        *(_TORO, _TORO_FLAT),
        covers=f"{_IO}.rtabmap.toro_poses.read_toro_poses",
        suffix=".graph",
    ),
    _table(
        "rtabmap-export",
        functools.partial(read_rtabmap_poses, **_RATE),
        checks.trajectory,
        *(_TORO, _G2O_LANDMARKS),
        covers=f"{_IO}.rtabmap.pose_export.read_rtabmap_poses",
        suffix=".txt",
    ),
    _table(
        "rtabmap-kitti",
        functools.partial(read_trajectory, format="rtabmap-kitti", **_RATE),
        checks.trajectory,
        _KITTI,
        covers=f"{_IO}.trajectory_file.read_trajectory",
        suffix=".txt",
    ),
    Target(
        "npy-poses",
        ".npy",
        "binary",
        functools.partial(read_npy_poses, **_RATE),
        checks.trajectory,
        lambda: (_npy(_three_poses()), _npy(_three_poses()[:, :3].astype(np.float32))),
        (f"{_IO}.npy_poses.read_npy_poses",),
    ),
    _table(
        "survey",
        functools.partial(read_survey, **_GRID_CRS, sigma_m=0.01),
        checks.survey,
        _SURVEY,
        _SURVEY_TURNED,
        covers=f"{_IO}.survey_csv.read_survey",
    ),
    _table(
        "control-points",
        functools.partial(
            read_control_points, **_GRID_CRS, lever_arm_m=(0.0, 0.0, 0.1), sigma_m=0.01, sighting_sigma_m=0.01
        ),
        checks.control_points,
        _CONTROL,
        covers=f"{_IO}.control_points.read_control_points",
    ),
    _table(
        "corners",
        read_corner_sightings,
        checks.corner_sightings,
        _CORNERS,
        covers=f"{_IO}.sightings_csv.read_corner_sightings",
    ),
    _table(
        "poses",
        functools.partial(read_pose_sightings, sigma_m=0.01, sigma_rot_rad=0.02),
        checks.sightings,
        *(_POSES, _POSES_COV),
        covers=f"{_IO}.sightings_csv.read_pose_sightings",
    ),
    _table(
        "waypoints",
        functools.partial(read_waypoints, **_GRID_CRS, height_m=300.0),
        checks.trajectory,
        *(_WAYPOINTS, b"E;N\n1;2\n3;4\n"),
        covers=f"{_IO}.waypoints_csv.read_waypoints",
    ),
    _table(
        "image-stamps",
        read_stamp_table,
        checks.stamps,
        _STAMPS,
        _STAMPS_NS,
        covers=f"{_IO}.frames.stamp_table.read_stamp_table",
    ),
    _table("times", _stamps_beside, checks.nothing, _STAMP_LIST, covers=f"{_IO}.row_stamps.row_stamps"),
    _table("scan-stamps", _stamp_list, checks.nothing, _STAMP_LIST, covers=f"{_IO}.item_stamps.listed_stamps"),
    Target(
        "associations",
        ".txt",
        "text",
        _pairs,
        checks.stamps,
        lambda: (_PAIRS,),
        (f"{_IO}.rgbd.associations.read_associations",),
        places=False,
    ),
    _table(
        "corrected",
        read_corrected,
        checks.nothing,
        _LOCAL,
        _TUM,
        suffix=".tum",
        covers="jaxgeo.mapping.carried_after.read_corrected",
    ),
    _table(
        "corrected-grid", read_corrected, checks.nothing, _GRID, covers="jaxgeo.mapping.carried_after.read_corrected"
    ),
    Target(
        *("labels", ".csv", "text", _labelled, _check_labelled),
        lambda: (b"image,x0,y0,x1,y1,x2,y2\n# by hand\na.png,1,1,12,1.5,6,9\na.png,20,1,28,1,28,9,20,9\n",),
        ("jaxgeo.detect.tune.read_labelled", "jaxgeo.detect.tune._polygons", "jaxgeo.detect.tune._read"),
        places=False,
    ),
    Target(
        "areas", ".geojson", "json", read_areas, checks.areas, lambda: (_AREAS,), (f"{_IO}.areas_geojson.read_areas",)
    ),
    Target(
        "noise",
        ".json",
        "json",
        functools.partial(read_noise, components=COMPONENTS),
        checks.noise,
        lambda: (_noise(),),
        (f"{_IO}.noise_json.read_noise",),
    ),
)
