"""`jaxgeo compare`: two georeferenced clouds to distances, pictures and one cloud coloured by session."""

import dataclasses
import json
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from pyproj import CRS
from pyproj.exceptions import CRSError

from eval.cloud_comparison import PERCENT, CloudComparison, compare_clouds, distance_map, thinned
from eval.clouds import CloudDistance
from eval.figures.cloud_distance import distance_histogram_figure, distance_map_figure
from jaxgeo.cli.progress import Progress
from jaxgeo.errors import CloudError
from jaxgeo.export.json_text import json_text
from jaxgeo.io.atomic import check_output_folder, output_folder
from jaxgeo.io.clouds.chunk import COLOUR, CloudChunk
from jaxgeo.io.clouds.source import CloudSource, open_cloud
from jaxgeo.io.clouds.writer import cloud_writer
from jaxgeo.io.input_warning import InputWarning

MANY_POINTS, THINNED_M = 20_000_000, 0.05
ORIGIN_STEP_M = 100.0
# Of the fused cloud, 16 bits a channel: the blue and the orange of the figures.
SESSION_COLOUR = ((0x0000, 0x7272, 0xB2B2), (0xD5D5, 0x5E5E, 0x0000))
_CLOUD = "cloud_{name}"


@dataclasses.dataclass(frozen=True)
class CompareOptions:
    """Of the command line: `names` as `A,B`; see there."""

    names: str | None = None
    trajectory: str | None = None
    voxel_m: float | None = None
    cell_m: float = 0.5
    simulated: bool = False


@dataclasses.dataclass(frozen=True)
class _Cloud:
    name: str
    source: CloudSource
    simulated: bool


def compare_files(first: Path, second: Path, out: Path, options: CompareOptions, quiet: bool) -> None:
    """Compare, print, and write compare.json, the pictures and fused.laz.

    Raises:
        InputError: clouds that cannot be read, in different systems, or empty; nothing is written then.
    """
    check_output_folder(out)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", InputWarning)
        clouds = _clouds(first, second, options)
        crs = _common_crs(*clouds)
        origin = _origin(clouds[0].source)
        simulated = options.simulated or any(cloud.simulated for cloud in clouds)
        with Progress(quiet) as progress:
            progress.phase("read")
            voxel_m = _voxel(clouds, options)
            points = [_points(cloud.source, origin, voxel_m) for cloud in clouds]
            progress.phase("compare")
            found = compare_clouds(points[0], points[1])
            progress.phase("write", str(out))
            facts = _facts(clouds, found, crs, origin, voxel_m, simulated)
            _write(out, clouds, points, found, facts, crs, origin, options.cell_m)
    if not quiet:
        for text in dict.fromkeys(str(w.message) for w in caught):
            print(f"warning: {text}", file=sys.stderr)
        label = " (simulated data)" if simulated else ""
        print("\n".join(_summary(clouds, found)))
        print(f"{clouds[0].name} and {clouds[1].name}{label}: {out / 'compare.json'}")


def _clouds(first: Path, second: Path, options: CompareOptions) -> tuple[_Cloud, _Cloud]:
    files = [_cloud_file(path, options.trajectory) for path in (first, second)]
    names = [path.name if path.is_dir() else path.stem for path in (first, second)]
    if options.names is not None:
        names = [name.strip() for name in options.names.split(",")]
    if len(names) != 2 or not all(names) or names[0] == names[1]:
        raise CloudError(f"the clouds are called {' and '.join(map(repr, names))}: give two names with --names A,B.")
    return tuple(  # type: ignore[return-value]
        _Cloud(name, open_cloud(file), _is_simulated(path))
        for name, file, path in zip(names, files, (first, second), strict=True)
    )


def _cloud_file(path: Path, trajectory: str | None) -> Path:
    """The cloud itself, or that of a run's folder."""
    if not path.is_dir():
        return path
    pattern = _CLOUD.format(name=trajectory or "*")
    there = [file for suffix in (".laz", ".las", ".ply") for file in sorted(path.glob(pattern + suffix))]
    if len(there) != 1:
        found = ", ".join(file.name for file in there) or "none"
        raise CloudError(
            f"{path}: expected one georeferenced cloud ({pattern}.laz, .las or .ply), found {found}. Name the file, or "
            "the trajectory with --trajectory; `jaxgeo run` makes clouds of sessions with scans or RGB-D frames."
        )
    return there[0]


def _is_simulated(path: Path) -> bool:
    """What the run says that a cloud is of."""
    run = (path if path.is_dir() else path.parent) / "run.json"
    try:
        return bool(json.loads(run.read_text(encoding="utf-8"))["simulated"])
    except (OSError, ValueError, KeyError, TypeError):  # no run, or not one of ours
        return False


def _common_crs(first: _Cloud, second: _Cloud) -> str | None:
    """Both clouds' system, `EPSG:<code>[+<code>]`; distances between different ones mean nothing."""
    one, two = (_crs_text(cloud.source) for cloud in (first, second))
    if one is None or two is None:
        for cloud in (first, second):
            if cloud.source.crs is None:
                warnings.warn(
                    f"{cloud.source.path}: says nothing of its coordinate system; it is taken to be the other's.",
                    InputWarning,
                    stacklevel=2,
                )
        return one or two
    if one != two:
        raise CloudError(
            f"{first.source.path} is in {one}, {second.source.path} in {two}: expected one system. Georeference both "
            "sessions in the same one."
        )
    return one


def _crs_text(source: CloudSource) -> str | None:
    """The codes of what the file says, since WKT may say one thing in several ways; `local` as it is."""
    if source.crs is None or source.crs == "local":
        return source.crs
    try:
        crs = CRS(source.crs)
        parts = crs.sub_crs_list if crs.is_compound else [crs]
        # What the text itself says it is: PROJ does not take WKT 1 for the same where the register puts northing first.
        ids = [part.to_json_dict().get("id", {}) for part in parts]
    except CRSError as failure:
        raise CloudError(f"{source.path}: its coordinate system is not understood: {failure}.") from None
    if any(each.get("authority") != "EPSG" for each in ids):
        raise CloudError(f"{source.path}: {crs.name!r} has no EPSG code, expected a registered system. Convert it.")
    return "EPSG:" + "+".join(str(each["code"]) for each in ids)


def _origin(source: CloudSource) -> Float[np.ndarray, "3"]:
    """Near the data, so that single digits of a millimetre are kept."""
    start = next(source.chunks()).points_m.mean(axis=0) + source.origin_enh_m
    return np.round(start / ORIGIN_STEP_M) * ORIGIN_STEP_M


def _voxel(clouds: tuple[_Cloud, _Cloud], options: CompareOptions) -> float:
    if options.voxel_m is not None:
        return options.voxel_m
    most = max(cloud.source.n_points for cloud in clouds)
    if most <= MANY_POINTS:
        return 0.0
    warnings.warn(
        f"a cloud of {most:,} points: both are thinned to one point in {THINNED_M:g} m first (--voxel).",
        InputWarning,
        stacklevel=2,
    )
    return THINNED_M


def _points(source: CloudSource, origin: Float[np.ndarray, "3"], voxel_m: float) -> Float[np.ndarray, "n 3"]:
    """All points about the origin; thinned as they come, where asked for."""
    kept = np.zeros((0, 3))
    waiting: list[np.ndarray] = []
    for chunk in source.chunks():
        waiting.append(chunk.points_m + (source.origin_enh_m - origin))
        if voxel_m > 0.0:
            both = np.concatenate([kept, *waiting])
            kept, waiting = both[thinned(both, voxel_m)], []
    return np.concatenate([kept, *waiting])


def _facts(
    clouds: tuple[_Cloud, _Cloud],
    found: CloudComparison,
    crs: str | None,
    origin: Float[np.ndarray, "3"],
    voxel_m: float,
    simulated: bool,
) -> dict[str, Any]:
    ways = (found.a_to_b, found.a_to_b_m), (found.b_to_a, found.b_to_a_m)
    a, b = (cloud.name for cloud in clouds)
    return {
        "simulated": simulated,
        "crs": crs,
        "origin_enh_m": origin,
        "voxel_m": voxel_m,
        "clouds": {c.name: {"file": Path(c.source.path).name, "points": c.source.n_points} for c in clouds},
        "distances": {
            f"{one} to {two}": dataclasses.asdict(summary)
            | {"percentiles_m": dict(zip(map("{:g}".format, PERCENT), np.percentile(d, PERCENT), strict=True))}
            for (one, two), (summary, d) in zip(((a, b), (b, a)), ways, strict=True)
        },
    }


def _write(
    out: Path,
    clouds: tuple[_Cloud, _Cloud],
    points: list[Float[np.ndarray, "_ 3"]],
    found: CloudComparison,
    facts: dict[str, Any],
    crs: str | None,
    origin: Float[np.ndarray, "3"],
    cell_m: float,
) -> None:
    (a, b), simulated = clouds, facts["simulated"]
    both_ways = {f"{a.name} to {b.name}": found.a_to_b_m, f"{b.name} to {a.name}": found.b_to_a_m}
    pictures = {
        "distance_map": distance_map_figure(
            distance_map(points[0], found.a_to_b_m, cell_m), a.name, b.name, origin, simulated
        ),
        "distance_map_back": distance_map_figure(
            distance_map(points[1], found.b_to_a_m, cell_m), b.name, a.name, origin, simulated
        ),
        "distance_histogram": distance_histogram_figure(both_ways, simulated),
    }
    with output_folder(out) as folder:
        for name, picture in pictures.items():
            (folder / f"{name}.png").write_bytes(picture.png())
            (folder / f"{name}.pdf").write_bytes(picture.pdf())
        columns = {name: np.dtype(np.uint16) for name in COLOUR}
        with cloud_writer(folder / "fused.laz", columns, origin, None if crs == "local" else crs) as writer:
            for cloud, colour in zip(clouds, SESSION_COLOUR, strict=True):
                for chunk in cloud.source.chunks():
                    painted = {n: np.full(len(chunk), c, np.uint16) for n, c in zip(COLOUR, colour, strict=True)}
                    writer.append(CloudChunk(chunk.points_m + (cloud.source.origin_enh_m - origin), painted))
        (folder / "compare.json").write_text(json_text(facts), encoding="utf-8", newline="\n")


def _summary(clouds: tuple[_Cloud, _Cloud], found: CloudComparison) -> list[str]:
    a, b = (cloud.name for cloud in clouds)

    def line(one: str, two: str, d: CloudDistance) -> str:
        return (
            f"{one} to {two}: {d.n:,} points, mean {100 * d.mean_m:.1f} cm, median {100 * d.median_m:.1f} cm, "
            f"{100 * d.share_within_30cm:.1f} % within 30 cm"
        )

    return [line(a, b, found.a_to_b), line(b, a, found.b_to_a)]
