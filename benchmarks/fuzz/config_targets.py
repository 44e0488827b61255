"""Configs, rigs, overrides and lists of sessions; damage that knows the schema's own keys."""

import functools
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from benchmarks.fuzz import checks
from benchmarks.fuzz.target import Target
from jaxgeo.cli.campaign_sessions import config_paths
from jaxgeo.config.fields import Section
from jaxgeo.config.load import dump_config, load_config, read_config
from jaxgeo.config.placement import PlacementConfig
from jaxgeo.config.schema import SessionConfig
from jaxgeo.io.rig_yaml import read_rig
from jaxgeo.io.yaml_file import read_yaml

_POSES = b"""name: small
crs: EPSG:2169
simulated: true
seed: 3
origin_enh_m: [79300, 76800.5, 300]
survey:
  points: {A: {N: 76850.1, E: 79300, h: 312, sigma_m: 0.01}, B: {N: 76851, E: 79310}}
  height_m: 312.5
  sigma_m: [0.01, 0.01, 0.02]
  ignore: [B]
sightings: {kind: poses, file: sightings.csv, delimiter: ",", columns: {stamp_s: 0, x: px}, sigma_m: 0.01}
visits: {gap_s: 2.0, min_count: 2, order: [A, B]}
trajectories:
  icp:
    file: icp.tum
    format: tum
    odometry: lidar
    noise: {sigma_trans_m_per_sqrt_m: 0.01, sigma_bias_rot_rad_per_m: [0, 0, 1e-4]}
    reference: {file: truth.kitti, format: kitti, rate_hz: 10, frame: grid, t_body_reference_m: [0, 0, 0.1]}
noise: {mode: learned, observations: both, values: {sigma_log_scale: 0.01}}
coarse: {scale: false, gravity: true}
anchors: {loss: huber, loss_width: 2.5, extra_sigma_m: 0.01}
solver: {max_steps: 20}
evaluate: {leave_one_out: false, subsets: 0}
report: {interactive: false}
"""
_IMAGES = b"""name: images
crs: EPSG:2169
survey: {file: survey.csv, delimiter: ";", columns: {name: 0, E: 1}}
rig:
  cameras:
    cam0: {model: pinhole, intrinsics_px: [600, 600, 320, 240], distortion_model: none, t_body_cam_m: [0, 0, 0]}
sightings:
  kind: images
  source: {kind: folder, path: images, rate_hz: 10, start_s: 5.0, camera: cam0}
  marker_size_m: {default: 0.3, "7": 0.2}
  families: [apriltag_36h11]
  decoder: both
  mask: {hsv: {low: [30, 40, 40], high: [90, 255, 255]}, polarity: auto, open_px: 3}
  gates: {max_hamming: 1, min_side_px: 12, ids: [1, 2]}
  workers: 2
visits: {locations: {"7": A}}
scans: {path: scans, kind: folder, rate_hz: 10, T_body_lidar: {t_m: [0, 0, 1], quat_wxyz: [1, 0, 0, 0]}, method: kiss}
rgbd: {path: r.bag, kind: bag, topics: {color: /c, depth: /d}, depth_unit_m: 0.0002}
mapping: {voxel_m: 0.05, clouds: ply}
trajectories: {icp: {computed: odometry}, dense: {computed: mapping, of: icp}}
noise: {mode: fixed, use: fixed, file: noise.json, trajectory: icp}
basemap: photo.tif
"""
_CORNERS = b"""name: corners
crs: local
survey: {from_trajectory: {file: truth.tum, format: tum, rows: {A: 5, B: 35}, sigma_m: 0.05}}
rig: {file: rig.yaml}
sightings: {kind: corners, file: corners.csv, camera_names: {"0": cam0}, marker_size_m: 0.15, pixel_sigma_px: 0.5}
trajectories: {vio: &vio {file: icp.kitti, format: kitti, times: times.txt, odometry: vio}, again: *vio}
"""
_CONTROL = b"""name: stops
crs: EPSG:2169+5773
sightings: {kind: control_points, file: stops.csv, lever_arm_m: [3, 0, 0], names: [A, B], survey_sigma_m: 0.02}
trajectories: {g: {file: a.g2o, format: g2o, rate_hz: 5, odometry: wheel}}
"""
_TRUTH = b"""name: truth
crs: EPSG:2169
survey: {points: {A: {N: 1, E: 2, h: 3}}}
sightings: {kind: from_trajectory, file: t.tum, format: tum, visits: [{location: A, row: 5}]}
trajectories: {icp: {file: icp.tum, format: tum, odometry: mono}}
"""
_PLAN = b"""name: plan
crs: EPSG:2169
path: {waypoints: {file: way.csv, delimiter: ";", height_m: 300, speed_m_s: 1.5}}
noise: {odometry: lidar, values: {sigma_turn_rad_per_sqrt_rad: 0.01}}
anchors:
  count: [4, 5]
  reach_m: 10
  areas: areas.geojson
  areas_crs: wgs84
  standing: {points: {A: {N: 76850, E: 79300, h: 300}}}
sighting: {range_m: 10, sigma_one_m: 0.05, rate_hz: 5, dwell_s: 2, floor_m: 0.01, passes: one}
survey: {sigma_m: [0.01, 0.01, 0.02]}
search: {starts: 8, watched: 16, exhaustive: 100}
criterion: worst
layout: {file: survey.csv, columns: {name: 0}}
"""
_PLAN_OF_RUN = b"""name: plan
crs: EPSG:2169
path: {run: {folder: out/walk, trajectory: icp}}
noise: {odometry: vio, file: noise.json, trajectory: icp}
anchors: {count: 6, candidates: {file: places.csv, height_m: 300, ignore: [B]}}
sighting: {range_m: 10, sigma_m: 0.02}
"""
_RIG = b"""cameras:
  cam0:
    model: pinhole
    intrinsics_px: [603.924, 603.166, 665.041, 554.34]
    distortion_model: equidistant
    distortion: [-0.0122741, -0.0100319, 0.00752173, -0.00247881]
    resolution_px: [1280, 1024]
    T_rig_cam: {t_m: [0.0, 0.0, 0.0], rotvec_rad: [0.0, 0.0, 0.1]}
  cam1:
    intrinsics_px: [600, 600, 320, 240]
    distortion_model: radtan
    distortion: [0, 0, 0, 0]
    t_body_cam_m: [0, 0, 0]
    R_body_cam: [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]
  cam2:
    intrinsics_px: [600, 600, 320, 240]
    distortion_model: none
    t_body_cam_m: [0, 0, 0]
    quat_body_cam_wxyz: [1, 0, 0, 0]
T_rig_body: {t_m: [0.02, 0.02, -0.02], rotvec_rad: [0, 0, -3.13883257]}
"""


def schema_keys() -> tuple[str, ...]:
    """Every key that any section of any config knows."""
    return tuple(sorted({name for section in _sections(Section) for name in section.model_fields}))


def _sections(kind: type[Section]) -> Iterator[type[Section]]:
    for below in kind.__subclasses__():
        yield below
        yield from _sections(below)


@functools.cache
def _scratch() -> tempfile.TemporaryDirectory:
    return tempfile.TemporaryDirectory()


def _check_config(value: Section) -> None:
    """Written out, a config loads back to itself."""
    path = Path(_scratch().name) / "again.yaml"
    path.write_text(dump_config(value), encoding="utf-8")
    assert read_config(path, type(value)) == value


def _check_plan(value: PlacementConfig) -> None:
    """As `_check_config`, where anchors are to be placed: none is what `jaxgeo predict` takes, and no list says it."""
    if value.anchors.count:
        _check_config(value)


def _override(path: Path) -> SessionConfig:
    """The sound config under the overrides in the lines of a file, as an argument list brings them."""
    sound = Path(_scratch().name) / "sound.yaml"
    sound.write_bytes(_POSES)
    return load_config(sound, path.read_bytes().decode("utf-8", "surrogateescape").split("\n"))


def _sessions(path: Path) -> list[Path]:
    """What a damaged list names, beside the config that the sound one does."""
    listed = Path(_scratch().name) / "sessions.txt"
    (listed.parent / "sound.yaml").write_bytes(_POSES)
    listed.write_bytes(path.read_bytes())
    return config_paths([str(listed)])[0]


def _yaml(
    name: str, read: Callable[[Path], Any], check: Callable[[Any], None], *examples: bytes, covers: tuple[str, ...]
) -> Target:
    return Target(name, ".yaml", "yaml", read, check, lambda: examples, covers, keys=schema_keys())


CONFIG_TARGETS = (
    _yaml(
        "config",
        load_config,
        _check_config,
        _POSES,
        _IMAGES,
        _CORNERS,
        _CONTROL,
        _TRUTH,
        covers=("jaxgeo.config.load.load_config", "jaxgeo.config.load.read_config"),
    ),
    _yaml(
        "plan",
        functools.partial(read_config, kind=PlacementConfig),
        _check_plan,
        _PLAN,
        _PLAN_OF_RUN,
        covers=("jaxgeo.config.load.read_config",),
    ),
    Target(
        *("override", ".txt", "text", _override, _check_config),
        lambda: (b"name=other\nvisits.gap_s=3", b"sightings.columns.x=2"),
        ("jaxgeo.config.load.load_config",),
        places=False,
    ),
    Target(
        *("sessions", ".txt", "text", _sessions, checks.nothing),
        lambda: (b"# walks\nsound.yaml\nso*.yaml  # all\n",),
        ("jaxgeo.cli.campaign_sessions.config_paths",),
        places=False,
    ),
    _yaml("rig", read_rig, checks.rig, _RIG, covers=("jaxgeo.io.rig_yaml.read_rig",)),
    _yaml(
        "yaml",
        read_yaml,
        checks.nothing,
        _RIG,
        _POSES,
        _CORNERS,
        covers=("jaxgeo.io.yaml_file.read_yaml", "jaxgeo.io.yaml_text.parse_yaml"),
    ),
)
