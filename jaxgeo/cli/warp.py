"""`jaxgeo warp`: a cloud made with a trajectory, carried with that trajectory's correction."""

import dataclasses
import hashlib
import math
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from jaxgeo import __version__
from jaxgeo.cli.progress import Progress
from jaxgeo.errors import CloudError, InputError
from jaxgeo.export.json_text import json_text
from jaxgeo.georef import LOCAL
from jaxgeo.io.atomic import check_output_folder, write_lines
from jaxgeo.io.clouds.chunk import NORMAL, CloudChunk
from jaxgeo.io.clouds.source import CHUNK, SUFFIXES, CloudSource, open_cloud
from jaxgeo.io.clouds.writer import cloud_writer
from jaxgeo.io.input_warning import InputWarning
from jaxgeo.io.trajectory_file import read_trajectory
from jaxgeo.mapping.carried_after import CorrectedTrajectory, read_corrected
from jaxgeo.mapping.carried_by import BY, Chosen, choose_by, place_finder
from jaxgeo.mapping.carried_extent import Extent, MeanCorrection, check_one_frame, check_same_motion, mean_correction
from jaxgeo.mapping.carried_near import carry_near, reach_of, stations_of
from jaxgeo.mapping.carry import PoseCorrections, carry, pose_corrections, turn

Carrier = Callable[[CloudChunk, Extent], CloudChunk]


@dataclasses.dataclass(frozen=True)
class WarpOptions:
    """Of the command line; see there."""

    out: Path | None = None
    by: str | None = None
    crs: str | None = None
    trajectory: str | None = None
    format: str = "tum"
    times: Path | None = None
    rate_hz: float | None = None
    scale: float = 1.0
    hold_s: float | None = None
    drop_outside: bool = False
    chunk: int = CHUNK


def warp_cloud(cloud: Path, before: Path, after: Path, options: WarpOptions, quiet: bool = False) -> Path:
    """Carry the cloud, write it and its record, say what was done; returns where it lies.

    Raises:
        InputError: cloud or trajectories are unusable or do not fit each other. Then nothing is written.
    """
    out = _target(cloud, options)
    with warnings.catch_warnings(record=True) as caught, Progress(quiet) as progress:
        warnings.simplefilter("always", InputWarning)
        progress.phase("read", cloud.name)
        target = read_corrected(after, options.trajectory, options.crs)
        given = read_trajectory(before, options.format, times=options.times, rate_hz=options.rate_hz)
        corrections = pose_corrections(given, target.trajectory, options.scale)
        check_same_motion(corrections)
        source = open_cloud(cloud)
        if options.by is not None and options.by not in BY:
            raise InputError(f"--by {options.by!r}; expected one of {', '.join(BY)}.")
        chosen = choose_by(source, corrections, options.by, options.hold_s, options.chunk)  # type: ignore[arg-type]
        _check_outside(source, chosen, options)
        progress.phase("carry", cloud.name)
        mean = mean_correction(corrections)
        extent = _write(out, source, target, _carrier(corrections, chosen, mean), options, progress)
        _say_losses(source, extent, chosen)
        said = list(dict.fromkeys(str(w.message) for w in caught if issubclass(w.category, InputWarning)))
        progress.phase("record")
        record = _record(cloud, before, out, target, corrections, chosen, mean, extent)
        write_lines(record_path(out), json_text(record | {"warnings": said}).splitlines())
    if not quiet:
        for text in said:
            print(f"warning: {text}", file=sys.stderr)
        print(_summary(out, target, corrections, chosen, extent))
        print(out)
    return out


def record_path(out: Path) -> Path:
    """Beside the cloud and called after it, so that several clouds may lie in one folder."""
    return out.with_name(f"{out.stem}.warp.json")


def _target(cloud: Path, options: WarpOptions) -> Path:
    out = options.out or cloud.with_name(f"{cloud.stem}_grid.laz")
    if out.suffix.lower() not in SUFFIXES:
        raise CloudError(f"--out {out}: suffix {out.suffix!r}; a cloud is written as {', '.join(SUFFIXES)}.")
    if out.resolve() == cloud.resolve():
        raise CloudError(f"--out {out}: is the cloud itself; expected another file. Carried twice, it would be wrong.")
    check_output_folder(out.parent)
    return out


def _check_outside(source: CloudSource, chosen: Chosen, options: WarpOptions) -> None:
    if chosen.n_outside and not options.drop_outside:
        held = f" (held {chosen.hold_s:.3g} s beyond its ends: --hold)" if chosen.by == "stamp" else ""
        raise CloudError(
            f"{source.path}: {chosen.n_outside:,} of {source.n_points:,} points were seen by no pose of the "
            f"trajectory: {chosen.why}{held}. --drop-outside leaves them out; --by nearest carries them with the poses "
            "nearest to them."
        )


def _carrier(corrections: PoseCorrections, chosen: Chosen, mean: MeanCorrection) -> Carrier:
    """From a chunk of the cloud to what is left of it, in the frame of the trajectory after."""
    carried = _by_nearest(corrections) if chosen.by == "nearest" else _by_column(corrections, chosen)

    def carrier(chunk: CloudChunk, extent: Extent) -> CloudChunk:
        chunk = chunk.rows(np.flatnonzero(np.isfinite(chunk.points_m).all(axis=1)))
        check_one_frame(corrections, chunk.points_m)
        done, kept = carried(chunk, extent)
        extent.add(done.points_m, mean.apply(kept.points_m))
        return done

    return carrier


def _by_column(
    corrections: PoseCorrections, chosen: Chosen
) -> Callable[[CloudChunk, Extent], tuple[CloudChunk, CloudChunk]]:
    find = place_finder(corrections, chosen)

    def carried(chunk: CloudChunk, extent: Extent) -> tuple[CloudChunk, CloudChunk]:
        inside = find(chunk)[1]
        kept = chunk if inside.all() else chunk.rows(inside)
        place, _ = find(kept)
        normal = None if kept.normal is None else turn(corrections, kept.normal, place)
        return _moved(kept, carry(corrections, kept.points_m, place), normal), kept

    return carried


def _by_nearest(corrections: PoseCorrections) -> Callable[[CloudChunk, Extent], tuple[CloudChunk, CloudChunk]]:
    stations = stations_of(corrections)
    reach_m: float | None = None

    def carried(chunk: CloudChunk, extent: Extent) -> tuple[CloudChunk, CloudChunk]:
        nonlocal reach_m
        if reach_m is None and len(chunk):
            reach_m = reach_of(corrections, stations, chunk.points_m)
        found = carry_near(corrections, stations, chunk.points_m, reach_m or 0.0, chunk.normal)
        extent.add_gaps(found.gap_m[found.twice])
        return _moved(chunk, found.points_m, found.normal), chunk

    return carried


def _moved(chunk: CloudChunk, points_m: np.ndarray, normal: np.ndarray | None) -> CloudChunk:
    turned: dict[str, np.ndarray] = {} if normal is None else dict(zip(NORMAL, normal.T, strict=True))
    kept = {name: turned.get(name, values).astype(values.dtype) for name, values in chunk.columns.items()}
    return CloudChunk(points_m, kept)


def _write(
    out: Path,
    source: CloudSource,
    target: CorrectedTrajectory,
    carrier: Carrier,
    options: WarpOptions,
    progress: Progress,
) -> Extent:
    extent, frame = Extent(), target.frame
    crs = None if frame.crs == LOCAL else frame.crs
    comments = [*(["SIMULATED DATA: not a measurement"] if target.simulated else []), f"jaxgeo {__version__} warp"]
    writer = cloud_writer(
        out,
        source.columns,
        frame.origin_enh_m,
        crs,
        standard_gps_time=source.standard_gps_time,
        comments=comments,
    )
    out.parent.mkdir(parents=True, exist_ok=True)
    n_pieces = math.ceil(source.n_points / options.chunk)
    with progress.count(f"pieces of {options.chunk:,} points", n_pieces) as bar, writer:
        for chunk in source.chunks(options.chunk):
            writer.append(carrier(chunk, extent))
            bar.done()
        if extent.n == 0:
            raise CloudError(f"{source.path}: none of its {source.n_points:,} points is finite and seen by a pose.")
    return extent


def _say_losses(source: CloudSource, extent: Extent, chosen: Chosen) -> None:
    missing = source.n_points - extent.n
    if missing:
        warnings.warn(
            f"{source.path}: {missing:,} of {source.n_points:,} points are left out: not finite, or seen by no pose "
            f"({chosen.n_outside:,}).",
            InputWarning,
            stacklevel=2,
        )
    if extent.n_twice:
        warnings.warn(
            f"{source.path}: {extent.n_twice:,} of {extent.n:,} points may have been seen in another pass of the "
            f"trajectory, and nothing says in which: the other one would have put them {extent.gap_rms_m:.3f} m away "
            f"(RMS; at most {extent.gap_m:.3f} m). A cloud with stamps or pose indices would leave no doubt.",
            InputWarning,
            stacklevel=2,
        )


def _record(
    cloud: Path,
    before: Path,
    out: Path,
    target: CorrectedTrajectory,
    corrections: PoseCorrections,
    chosen: Chosen,
    mean: MeanCorrection,
    extent: Extent,
) -> dict[str, Any]:
    files = {"cloud": cloud, "before": before, "after": target.file, "out": out}
    return {
        "jaxgeo": __version__,
        "simulated": target.simulated,
        "files": {what: {"name": path.name, "sha256": _sha256(path)} for what, path in files.items()},
        "frame": target.frame.as_dict(),
        "by": chosen.by,
        "why": chosen.why,
        "hold_s": chosen.hold_s,
        "scale": corrections.scale,
        "poses": {"before": len(corrections.before_stamp_s), "paired": len(corrections)},
        "points": {"written": extent.n, "outside": chosen.n_outside, "of_unknown_pass": extent.n_twice},
        "between_passes_m": {"rms": extent.gap_rms_m, "max": extent.gap_m} if extent.n_twice else None,
        "one_rigid_transform": {"rotation": mean.rotation, "translation_m": mean.translation_m, "scale": mean.scale},
        "from_one_rigid_transform_m": {"rms": extent.rms_m, "max": extent.largest_m},
    }


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _summary(
    out: Path, target: CorrectedTrajectory, corrections: PoseCorrections, chosen: Chosen, extent: Extent
) -> str:
    label = " (simulated data)" if target.simulated else ""
    east, north, height = target.frame.origin_enh_m.tolist()
    return (
        f"{extent.n:,} points carried with {len(corrections):,} poses, by {chosen.by}: {chosen.why}{label}\n"
        f"from where one rigid transform would have put them: RMS {extent.rms_m:.3f} m, at most "
        f"{extent.largest_m:.3f} m\n"
        f"{target.frame.crs}, origin E {east:g} N {north:g} h {height:g} m; {out.stat().st_size / 1e6:.1f} MB"
    )
