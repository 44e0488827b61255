"""`jaxgeo odometry`: LiDAR scans to a drifting trajectory."""

import dataclasses
import importlib.metadata
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jaxgeo import __version__
from jaxgeo.cli.progress import Progress
from jaxgeo.errors import InputError
from jaxgeo.export.csv_text import csv_text
from jaxgeo.export.json_text import json_text
from jaxgeo.io.atomic import check_output_folder, output_folder
from jaxgeo.io.input_warning import InputWarning
from jaxgeo.io.scans.source import open_scans
from jaxgeo.io.tum import write_tum
from jaxgeo.odometry.lidar_odometry import Odometry, OdometrySettings, estimate_odometry

COLUMNS = ("stamp_s", "inlier_share", "deviation_m", "deviation_rad", "lost", "ms")
LIBRARIES = {"gicp": "small_gicp", "kiss": "kiss_icp"}


@dataclasses.dataclass(frozen=True)
class Source:
    """Where the scans are: the arguments of `open_scans`."""

    path: Path
    kind: str | None = None
    stamps: Path | None = None
    rate_hz: float | None = None
    start_s: float | None = None
    topic: str | None = None
    skip_unreadable: bool = False


def run_odometry(
    source: Source,
    out: Path,
    settings: OdometrySettings,
    T_body_lidar: Float[np.ndarray, "4 4"] | None = None,
    *,
    quiet: bool = False,
) -> Odometry:
    """Read the scans, estimate, write trajectory, table and record, say how it went.

    Raises:
        JaxgeoError: as `open_scans` and `estimate_odometry`.
    """
    check_output_folder(out)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", InputWarning)
        scans = open_scans(
            source.path,
            kind=source.kind,  # type: ignore[arg-type]
            stamps=source.stamps,
            rate_hz=source.rate_hz,
            start_s=source.start_s,
            topic=source.topic,
            point_times=settings.deskew,
            on_bad="skip" if source.skip_unreadable else "raise",
        )
        with Progress(quiet) as progress, progress.count("scans", scans.n_scans) as bar:
            found = estimate_odometry(scans, settings, T_body_lidar, lambda scan, tracked: bar.done())
    said = [str(w.message) for w in caught if issubclass(w.category, InputWarning)] + list(found.warnings)
    with output_folder(out) as folder:
        write_tum(folder / "trajectory.tum", found.trajectory)
        (folder / "odometry.csv").write_text(_table(found), encoding="utf-8")
        (folder / "odometry.json").write_text(
            json_text(_record(found, source, settings, T_body_lidar, len(scans.bad), said)), encoding="utf-8"
        )
    if not quiet:
        for text in said:
            print(f"warning: {text}", file=sys.stderr)
        print(summary(found))
        print(out)
    return found


def summary(found: Odometry) -> str:
    """One line: scans, path, how much matched, and the time a scan takes beside the time there is for it."""
    ms = 1e3 * found.seconds
    return (
        f"{len(found)} scans, {path_length_m(found):.1f} m; {int(found.lost.sum())} lost; inlier share "
        f"{np.median(found.inlier_share):.2f} (median), {found.inlier_share.min():.2f} (least); "
        f"{ms.mean():.1f} ms a scan (longest {ms.max():.0f}), the sensor's period {1e3 * period_s(found):.0f} ms"
    )


def path_length_m(found: Odometry) -> float:
    """Length of the way from pose to pose."""
    return float(np.linalg.norm(np.diff(found.trajectory.position_m, axis=0), axis=1).sum())


def period_s(found: Odometry) -> float:
    """Median time between two scans."""
    return float(np.median(np.diff(found.trajectory.stamp_s)))


def body_lidar_of(text: str | None) -> Float[np.ndarray, "4 4"] | None:
    """The pose of `x,y,z,qx,qy,qz,qw` in metres, as a matrix; None for None.

    Raises:
        InputError: not seven numbers, or no rotation.
    """
    if text is None:
        return None
    try:
        values = np.array([float(word) for word in text.split(",")])
    except ValueError:
        values = np.empty(0)
    if values.shape != (7,) or not np.isfinite(values).all():
        raise InputError(
            f"--T-body-lidar: {text!r}, expected seven numbers x,y,z,qx,qy,qz,qw (metres, unit quaternion)."
        )
    norm = float(np.linalg.norm(values[3:]))
    if abs(norm - 1.0) > 1e-3:
        raise InputError(
            f"--T-body-lidar: the quaternion {text.split(',', 3)[3]!r} has length {norm:.4g}, expected 1. The order is "
            "x,y,z,qx,qy,qz,qw."
        )
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat(values[3:]).as_matrix()
    T[:3, 3] = values[:3]
    return T


def _table(found: Odometry) -> str:
    columns = (
        found.trajectory.stamp_s,
        found.inlier_share,
        found.deviation_m,
        found.deviation_rad,
        found.lost.astype(int),
        1e3 * found.seconds,
    )
    return csv_text(
        ["jaxgeo odometry: each scan of trajectory.tum; deviations are from the motion before it"],
        COLUMNS,
        zip(*(column.tolist() for column in columns), strict=True),
    )


def _record(
    found: Odometry,
    source: Source,
    settings: OdometrySettings,
    T_body_lidar: Float[np.ndarray, "4 4"] | None,
    n_unreadable: int,
    said: list[str],
) -> dict[str, Any]:
    library = LIBRARIES[settings.method]
    return {
        "source": dataclasses.asdict(source),
        "settings": dataclasses.asdict(settings),
        "T_body_lidar": T_body_lidar,
        "versions": {"jaxgeo": __version__, library: importlib.metadata.version(library)},
        "voxel_m": found.voxel_m,
        "n_scans": len(found),
        "n_unreadable": n_unreadable,
        "n_lost": int(found.lost.sum()),
        "path_m": path_length_m(found),
        "period_s": period_s(found),
        "ms_per_scan": {
            "mean": float(1e3 * found.seconds.mean()),
            "median": float(1e3 * np.median(found.seconds)),
            "longest": float(1e3 * found.seconds.max()),
        },
        "inlier_share": {"median": float(np.median(found.inlier_share)), "least": float(found.inlier_share.min())},
        "warnings": said,
    }
