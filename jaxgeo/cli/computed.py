"""Trajectories that a run makes of its own sensors, kept in its folder and used again while nothing changed."""

import dataclasses
import hashlib
import json
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jaxgeo.cli.input_identity import code_hash, facts_key, file_identities
from jaxgeo.cli.progress import Progress
from jaxgeo.config.recording import RgbdInput, ScansInput, SensorPose
from jaxgeo.config.schema import SessionConfig
from jaxgeo.data import Camera, Rig, Trajectory
from jaxgeo.errors import ConfigError
from jaxgeo.export.json_text import json_text
from jaxgeo.io.atomic import output_folder
from jaxgeo.io.rgbd.rgbd_source import RgbdSource
from jaxgeo.io.rgbd.source import open_rgbd
from jaxgeo.io.scans.scan_source import ScanSource
from jaxgeo.io.scans.source import open_scans
from jaxgeo.io.tum import read_tum, write_tum
from jaxgeo.mapping.dense_map import build_map
from jaxgeo.mapping.map_settings import MapSettings
from jaxgeo.odometry.lidar_odometry import estimate_odometry
from jaxgeo.odometry.settings import OdometrySettings

TRAJECTORY_FILE, ACCOUNT_FILE = "trajectory.tum", "computed.json"
_ODOMETRY_CODE = ("odometry", "io", "io/scans")
_MAPPING_CODE = (*_ODOMETRY_CODE, "mapping", "solve", "graph", "io/rgbd", "io/frames")


@dataclasses.dataclass(frozen=True)
class Computed:
    """A trajectory that was made, where it is kept, and what is to be said of it."""

    trajectory: Trajectory
    folder: Path
    warnings: tuple[str, ...]


def computed_odometry(name: str, config: SessionConfig, folder: Path, progress: Progress) -> Computed:
    """LiDAR odometry of the session's scans.

    Raises:
        InputError: unusable scans, or a library is missing.
    """
    scans = config.scans
    assert scans is not None  # the schema requires it
    facts = {
        "scans": _facts(scans),
        "files": file_identities(_files(scans), folder),
        "code": code_hash(*_ODOMETRY_CODE),
        "library": _version("small_gicp" if scans.method == "gicp" else "kiss-icp"),
    }

    def make() -> tuple[Trajectory, dict[str, Any]]:
        progress.phase("odometry", name)
        source = scan_source(scans)
        settings = OdometrySettings(
            method=scans.method,
            deskew=scans.deskew,
            min_range_m=scans.min_range_m,
            max_range_m=scans.max_range_m,
        )
        with progress.count("scans", source.n_scans) as bar:
            found = estimate_odometry(source, settings, sensor_matrix(scans.T_body_lidar), lambda *_: bar.done())
        account = {
            "scans": len(found),
            "lost": int(found.lost.sum()),
            "ms_per_scan": 1e3 * float(found.seconds.mean()),
            "inlier_share_median": float(np.median(found.inlier_share)),
            "voxel_m": found.voxel_m,
            "warnings": list(found.warnings),
        }
        return found.trajectory, account

    return _kept_or_made(folder, facts_key(facts), make)


def computed_mapping(
    name: str, config: SessionConfig, along: Trajectory, rig: Rig | None, folder: Path, progress: Progress
) -> Computed:
    """The loop-closed trajectory of mapping, along another one.

    Raises:
        InputError: unusable sensors, or a library is missing.
    """
    scans, rgbd = config.scans, config.rgbd
    files = [*(_files(scans) if scans else ()), *(_files(rgbd) if rgbd else ())]
    kind = config.trajectories[config.mapped_along(name)].odometry
    facts = {
        "scans": _facts(scans),
        "rgbd": _facts(rgbd),
        "files": file_identities(files, folder.parent),
        "along": hashlib.sha256(_bytes(along)).hexdigest(),
        "odometry": kind,
        "code": code_hash(*_MAPPING_CODE),
    }

    def make() -> tuple[Trajectory, dict[str, Any]]:
        progress.phase("mapping", name)
        found = build_map(
            along,
            scans=scan_source(scans) if scans else None,
            rgbd=rgbd_source(rgbd) if rgbd else None,
            T_body_lidar=sensor_matrix(scans.T_body_lidar) if scans else None,
            camera=rgbd_camera_of(config, rig) if rgbd else None,
            settings=MapSettings(kind),
        )
        account = {
            "keyframes": len(found.keyframes),
            "closures": len(found.closures),
            "accepted": int(found.accepted.sum()),
            "refused": dict(found.refused),
            "warnings": list(found.warnings),
        }
        return found.trajectory, account

    return _kept_or_made(folder, facts_key(facts), make)


def scan_source(scans: ScansInput) -> ScanSource:
    """The scans as the config names them."""
    keys = scans.model_dump(include={"kind", "stamps", "rate_hz", "start_s", "topic"})
    return open_scans(scans.path, **keys)


def rgbd_source(rgbd: RgbdInput) -> RgbdSource:
    """The frames as the config names them."""
    keys = rgbd.model_dump(include={"kind", "stamps", "rate_hz", "start_s", "topics", "depth_unit_m"})
    return open_rgbd(rgbd.path, **keys)


def rgbd_camera_of(config: SessionConfig, rig: Rig | None) -> Camera:
    """The camera of the RGB-D frames.

    Raises:
        ConfigError: it is not in the rig, or the rig has several and none is named.
    """
    assert rig is not None  # the schema requires it
    assert config.rgbd is not None
    name = config.rgbd.camera
    if name is None and len(rig.cameras) == 1:
        return next(iter(rig.cameras.values()))
    if name not in rig.cameras:
        found = "no camera is named" if name is None else f"camera {name!r}"
        raise ConfigError(f"rgbd.camera: {found}; the rig has {', '.join(rig.cameras)}. Name the one that took them.")
    return rig.cameras[name]


def sensor_matrix(pose: SensorPose) -> Float[np.ndarray, "4 4"]:
    """`T_body_sensor`."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat(pose.quat_wxyz, scalar_first=True).as_matrix()
    T[:3, 3] = pose.t_m
    return T


def _kept_or_made(folder: Path, key: str, make: Callable[[], tuple[Trajectory, dict[str, Any]]]) -> Computed:
    """What lies in the folder, if it was made from the same; else made anew and kept."""
    account = _account(folder)
    if account is None or account.get("key") != key:
        trajectory, made = make()
        account = {"key": key, **made}
        with output_folder(folder) as temporary:
            write_tum(temporary / TRAJECTORY_FILE, trajectory)
            (temporary / ACCOUNT_FILE).write_text(json_text(account), encoding="utf-8", newline="\n")
    # Read back, whether made or kept: both times the same numbers.
    return Computed(read_tum(folder / TRAJECTORY_FILE), folder, tuple(account.get("warnings", ())))


def _account(folder: Path) -> dict[str, Any] | None:
    try:
        account = json.loads((folder / ACCOUNT_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):  # not there, or not ours: made anew
        return None
    return account if isinstance(account, dict) and (folder / TRAJECTORY_FILE).exists() else None


def _facts(section: ScansInput | RgbdInput | None) -> dict[str, Any] | None:
    return None if section is None else section.model_dump(mode="json", exclude={"path", "stamps"})


def _files(section: ScansInput | RgbdInput) -> list[Path]:
    return [section.path] if section.stamps is None else [section.stamps, section.path]


def _version(library: str) -> str | None:
    try:
        return version(library)
    except PackageNotFoundError:  # whoever needs it says how to install it
        return None


def _bytes(trajectory: Trajectory) -> bytes:
    return np.column_stack([trajectory.stamp_s, trajectory.position_m, trajectory.quat_wxyz]).tobytes()
