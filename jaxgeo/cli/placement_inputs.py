"""From a placement's config to data: every file read once, everything in the local frame, nothing computed."""

import dataclasses
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from eval.placement.plan_visits import MOST_PASSES
from eval.placement.planned import PlacementInput
from jaxgeo.cli.ingest import upright
from jaxgeo.cli.noise import stored_ensemble
from jaxgeo.cli.placement_areas import distance_to, local_areas
from jaxgeo.config.placement import PlacementConfig, PlacesInput
from jaxgeo.data import Trajectory
from jaxgeo.errors import ConfigError, InputError, SurveyError, TrajectoryError
from jaxgeo.export.basemap import read_basemap
from jaxgeo.export.figure_style import thin
from jaxgeo.georef import LOCAL, LocalFrame, check_in_area, default_origin, read_crs
from jaxgeo.graph.components import COMPONENTS, NoiseEnsemble, ensemble_of
from jaxgeo.graph.noise_defaults import default_noise
from jaxgeo.io import InputWarning, read_survey, read_trajectory, survey_from_points
from jaxgeo.io.noise_json import read_noise
from jaxgeo.io.orthophoto import Orthophoto
from jaxgeo.io.waypoints_csv import read_waypoints
from jaxgeo.mapping.carried_after import read_corrected

# Poses at which the distance of the path to the areas is looked at.
_LOOKED_AT = 2000


@dataclasses.dataclass(frozen=True)
class Places:
    """Named places in the local frame."""

    name: tuple[str, ...]
    point_m: Float[np.ndarray, "n 3"]


@dataclasses.dataclass(frozen=True)
class PlacementInputs:
    """All that a placement needs, local frame.

    Attributes:
        path, path_said: the path, and where it is from in words.
        noise, noise_facts: the ensemble, and what it is.
        given: what is possible and wanted.
        layout: anchors given, of `jaxgeo predict`; empty where there are none.
        simulated: the config says so, or the run that the path is from.
        files: every file read; `warnings` sentences for the user.
    """

    frame: LocalFrame
    path: Trajectory
    path_said: str
    noise: NoiseEnsemble
    noise_facts: dict[str, Any]
    given: PlacementInput
    layout: Places
    basemap: Orthophoto | None
    simulated: bool
    files: tuple[Path, ...]
    warnings: tuple[str, ...]


def placement_inputs(config: PlacementConfig, *, with_layout: bool) -> PlacementInputs:
    """Read everything that the config names; its `layout` only where it is asked about: a plan may be what makes it.

    Raises:
        InputError: whatever is wrong, with its place.
    """
    files: dict[Path, None] = {}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", InputWarning)
        in_grid, said, simulated = _path(config, files)
        if config.crs != LOCAL:  # before its origin, which would be refused in the place of the path
            check_in_area(
                read_crs(config.crs), in_grid.position_m, [f"{said}: pose {i + 1}" for i in range(len(in_grid))]
            )
        origin = default_origin(in_grid.position_m) if config.origin_enh_m is None else np.array(config.origin_enh_m)
        frame = LocalFrame.create(config.crs, origin)
        path = Trajectory(in_grid.stamp_s, frame.to_local(in_grid.position_m), in_grid.quat_wxyz)
        given = _given(config, frame, path, files)
        layout = _places(config, config.layout if with_layout else None, "layout", frame, files)
        noise, noise_facts = _noise(config, files)
        shown = [path.position_m, given.standing_m, layout.point_m]
        basemap = None
        if config.basemap is not None:
            files[config.basemap] = None
            basemap = read_basemap(config.basemap, frame, np.concatenate(shown)[:, :2])
    read = tuple(dict.fromkeys(str(w.message) for w in caught if issubclass(w.category, InputWarning)))
    return PlacementInputs(
        frame=frame,
        path=path,
        path_said=said,
        noise=noise,
        noise_facts=noise_facts,
        given=given,
        layout=layout,
        basemap=basemap,
        simulated=config.simulated or simulated,
        files=tuple(files),
        warnings=read,
    )


def _path(config: PlacementConfig, files: dict[Path, None]) -> tuple[Trajectory, str, bool]:
    """The path in grid coordinates, where it is from, and whether that says it is simulated."""
    source = config.path
    if source.waypoints is not None:
        of = source.waypoints
        files[of.file] = None
        keys = of.model_dump(include={"columns", "delimiter", "height_m", "speed_m_s"})
        return read_waypoints(of.file, crs=config.crs, **keys), f"waypoints {of.file.name}", False
    if source.trajectory is not None:
        of = source.trajectory
        files |= dict.fromkeys(path for path in (of.file, of.times) if path is not None)
        read = read_trajectory(of.file, of.format, times=of.times, rate_hz=of.rate_hz)
        read = upright(read) if of.optical_axes else read
        origin = np.zeros(3) if of.frame == "grid" else np.array(config.origin_enh_m)
        moved = Trajectory(read.stamp_s, read.position_m + origin, read.quat_wxyz)
        return moved, f"trajectory {of.file.name}", False
    assert source.run is not None  # the schema requires one of the three
    return _path_of_run(config, files)


def _path_of_run(config: PlacementConfig, files: dict[Path, None]) -> tuple[Trajectory, str, bool]:
    source = config.path.run
    assert source is not None
    folder = source.folder
    if not folder.is_dir():
        raise ConfigError(f"path.run.folder: {folder} is no folder; expected the output folder of an earlier run")
    try:
        found = read_corrected(folder, source.trajectory)
    except (TrajectoryError, SurveyError) as error:  # its mends are those of another command
        mended = str(error).replace("--trajectory", "path.run.trajectory")
        raise type(error)(f"path.run: {mended}") from None
    files[found.file] = None
    if found.frame.crs != config.crs:
        raise ConfigError(
            f"path.run: {found.file} is in {found.frame.crs}, the config says crs: {config.crs}. Coordinates are not "
            f"converted here: say crs: {found.frame.crs}, and give all places in it."
        )
    read = found.trajectory
    in_grid = Trajectory(read.stamp_s, found.frame.to_grid(read.position_m), read.quat_wxyz)
    return in_grid, f"run {folder.name}, {found.file.relative_to(folder).as_posix()}", found.simulated


def _given(config: PlacementConfig, frame: LocalFrame, path: Trajectory, files: dict[Path, None]) -> PlacementInput:
    wanted, sighting, search = config.anchors, config.sighting, config.search
    lift_m = wanted.height_above_path_m
    # Farther off than this no anchor is seen from its own part of the path.
    seen_m = float(np.sqrt(sighting.range_m**2 - lift_m**2))
    reach_m = min(0.5 * sighting.range_m if wanted.reach_m is None else wanted.reach_m, seen_m)
    areas = ()
    if wanted.areas is not None:
        files[wanted.areas] = None
        areas = local_areas(wanted.areas, frame, wanted.areas_crs)
        away_m = float(distance_to(path.position_m[thin(len(path), _LOOKED_AT), :2], areas).min())
        if away_m > reach_m:
            raise InputError(
                f"{wanted.areas}: the nearest area is {away_m:.1f} m from the path, and anchors may stand at most "
                f"{reach_m:g} m from it (anchors.reach_m, and within sighting.range_m). Raise these, or mend the areas."
            )
    candidates = _places(config, wanted.candidates, "anchors.candidates", frame, files)
    standing = _places(config, wanted.standing, "anchors.standing", frame, files)
    both = sorted({*candidates.name} & {*standing.name})
    if both:
        raise InputError(
            f"anchors.candidates and anchors.standing both name {both[0]!r}; expected each place once. An anchor that "
            "stands already is no candidate: list it in candidates.ignore."
        )
    return PlacementInput(
        counts=wanted.count,
        range_m=sighting.range_m,
        sighting_sigma_m=sighting.visit_sigma_m,
        sighting_floor_m=sighting.floor_m or 0.0,
        survey_sigma_m=config.survey.sigma_m,
        apart_m=2.0 * sighting.range_m if sighting.apart_m is None else sighting.apart_m,
        reach_m=reach_m,
        lift_m=lift_m,
        areas_en_m=areas,
        candidate_m=None if wanted.candidates is None else candidates.point_m,
        candidate_name=candidates.name,
        standing_m=standing.point_m,
        standing_name=standing.name,
        criterion=config.criterion,
        robust=config.robust,
        most_passes=1 if sighting.passes == "one" else MOST_PASSES,
        starts=search.starts,
        seed=config.seed,
        watched=search.watched,
        exhaustive=search.exhaustive,
    )


def _places(
    config: PlacementConfig, source: PlacesInput | None, key: str, frame: LocalFrame, files: dict[Path, None]
) -> Places:
    if source is None:
        return Places((), np.zeros((0, 3)))
    # Places have no sigma of their own here; the reader wants one.
    options = {"crs": config.crs, "sigma_m": config.survey.sigma_m}
    options |= {"height_m": source.height_m, "ignore": source.ignore}
    if source.points is not None:
        points = {name: point.model_dump(exclude_none=True) for name, point in source.points.items()}
        try:
            survey = survey_from_points(points, **options)  # type: ignore[arg-type]
        except SurveyError as error:
            raise SurveyError(f"{key}: {error}") from None
    else:
        assert source.file is not None  # the schema requires one of the two
        files[source.file] = None
        survey = read_survey(source.file, columns=source.columns, delimiter=source.delimiter, **options)
    at = f"{source.file or key}"
    frame.check(survey.enh_m, [f"{at}: location {name!r}" for name in survey.name])
    return Places(tuple(survey.name), frame.to_local(survey.enh_m))


def _noise(config: PlacementConfig, files: dict[Path, None]) -> tuple[NoiseEnsemble, dict[str, Any]]:
    """The odometry's noise, and where it is from with the median of every component."""
    chosen = config.noise
    facts: dict[str, Any] = {"odometry": chosen.odometry, "file": None, "session": None, "trajectory": None}
    if chosen.file is None:
        noise = ensemble_of(default_noise(chosen.odometry, **chosen.values.model_dump(exclude_none=True)))
    else:
        files[chosen.file] = None
        stored = read_noise(chosen.file, COMPONENTS, chosen.trajectory)
        if stored.kind != chosen.odometry:
            raise ConfigError(
                f"{chosen.file}: trajectory {stored.trajectory!r} is of kind {stored.kind!r}, noise.odometry says "
                f"{chosen.odometry!r}: their noise has nothing in common. Mend noise.odometry, or name another file."
            )
        noise = stored_ensemble(stored)
        facts |= {"file": chosen.file.name, "session": stored.session, "trajectory": stored.trajectory}
    median = _weighted_median(np.asarray(noise.sigma), np.asarray(noise.weight))
    facts |= {
        "sets": len(noise.weight),
        "sigma_median": dict(zip(COMPONENTS, median.tolist(), strict=True)),
        "correlation_m": float(noise.correlation_m),
    }
    return noise, facts


def _weighted_median(value: Float[np.ndarray, "q n"], weight: Float[np.ndarray, "q"]) -> Float[np.ndarray, "n"]:
    order = np.argsort(value, axis=0, kind="stable")
    below = np.cumsum(weight[order], axis=0)
    row = np.argmax(below >= 0.5 * weight.sum(), axis=0)
    return np.take_along_axis(value, order, axis=0)[row, np.arange(value.shape[1])]
