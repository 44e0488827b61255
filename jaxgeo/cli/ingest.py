"""From a config to data: every file read once, everything checked, nothing estimated."""

import dataclasses
import hashlib
import os
import warnings
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from jaxgeo.associate import (
    corners_to_sightings,
    cut_visits,
    label_visits,
    sightings_from_trajectory,
    survey_from_trajectory,
)
from jaxgeo.cli.progress import Progress
from jaxgeo.cli.rig import rig_of
from jaxgeo.config.images import ImagesSightingsInput
from jaxgeo.config.inputs import (
    ComputedTrajectoryInput,
    ControlPointSightingsInput,
    CornerSightingsInput,
    FromTrajectorySightingsInput,
    PoseSightingsInput,
    TrajectoryFile,
)
from jaxgeo.config.schema import SessionConfig
from jaxgeo.data import Rig, Sightings, Survey, Trajectory, Visit
from jaxgeo.export.basemap import read_basemap
from jaxgeo.georef import LocalFrame, default_origin
from jaxgeo.io import (
    InputWarning,
    read_control_points,
    read_corner_sightings,
    read_pose_sightings,
    read_survey,
    read_trajectory,
    survey_from_points,
)
from jaxgeo.io.orthophoto import Orthophoto

# Folders of a session's outputs that keep what was detected in its images, and the trajectories made of its scans.
DETECTIONS, COMPUTED = "detections", "computed"
# How far beyond the surveyed points an orthophoto is read, in the site's size: trajectories go there.
BASEMAP_REACH = 0.3


@dataclasses.dataclass(frozen=True)
class Ingested:
    """One session's data. `warnings` are sentences for the user, `files` every file read.

    `made_warnings` are about the making of single trajectories, by name.
    """

    frame: LocalFrame
    survey: Survey
    sightings: Sightings
    visits: list[Visit]
    trajectories: dict[str, Trajectory]
    references: dict[str, Trajectory]
    warnings: tuple[str, ...]
    files: tuple[Path, ...]
    basemap: Orthophoto | None = None
    made_warnings: dict[str, tuple[str, ...]] = dataclasses.field(default_factory=dict)


def ingest(config: SessionConfig, progress: Progress | None = None, out: Path | None = None) -> Ingested:
    """Read everything that the config names; images are searched for markers, trajectories made of scans, first.

    Args:
        progress: where detecting, odometry and mapping show how far they are.
        out: the session's output folder, default out/NAME: what was detected is kept in its folder `detections`, what
            trajectories were made in `computed`.

    Raises:
        InputError: whatever is wrong, with its place.
    """
    reader = _Reader(progress or Progress(quiet=True), out or Path("out") / config.name)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", InputWarning)
        survey, sightings, said = _survey_and_sightings(config, reader)
        trajectories, made = _trajectories(config, reader)
        references = {name: reader.trajectory(t.reference) for name, t in config.trajectories.items() if t.reference}
    # One file may be read in two places: survey and sightings from one truth.
    read = dict.fromkeys(str(w.message) for w in caught if issubclass(w.category, InputWarning))
    ignore = config.survey.ignore if config.survey else []
    if isinstance(config.sightings, FromTrajectorySightingsInput | ControlPointSightingsInput):
        visits = one_visit_a_row(sightings)
    else:
        visits = cut_visits(sightings, config.visits.gap_s, config.visits.min_count)
    labelled, unlabelled = label_visits(
        visits, survey, order=config.visits.order, locations=config.visits.locations or None, ignore=ignore
    )
    origin = default_origin(survey.enh_m) if config.origin_enh_m is None else np.array(config.origin_enh_m)
    frame = LocalFrame.create(config.crs, origin)
    frame.check(survey.enh_m, _survey_places(config, survey))
    basemap = _basemap(config, frame, survey, reader)
    said = (*read, *said, *unlabelled)
    return Ingested(
        frame, survey, sightings, labelled, trajectories, references, said, tuple(reader.files), basemap, made
    )


def _basemap(config: SessionConfig, frame: LocalFrame, survey: Survey, reader: "_Reader") -> Orthophoto | None:
    """The orthophoto around the surveyed points; paths that leave them by far are not drawn over it."""
    if config.basemap is None:
        return None
    survey_m = frame.to_local(survey.enh_m)[:, :2]
    reach = BASEMAP_REACH * np.ptp(survey_m, axis=0).max()
    corners = np.array([survey_m.min(axis=0) - reach, survey_m.max(axis=0) + reach])
    return read_basemap(reader.seen(config.basemap), frame, corners)


def one_visit_a_row(sightings: Sightings) -> list[Visit]:
    """Sightings that are visits already: control points, rows of a true trajectory."""
    return [
        Visit(str(sightings.marker[i]), np.array([i]), float(sightings.stamp_s[i]), float(sightings.stamp_s[i]))
        for i in range(len(sightings))
    ]


def upright(trajectory: Trajectory) -> Trajectory:
    """A trajectory whose map has a camera's axes (right, down, forward), in a map with z up: E = x, N = z, h = -y."""
    turn = Rotation.from_matrix([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    quat = turn * Rotation.from_quat(trajectory.quat_wxyz, scalar_first=True)
    return Trajectory(trajectory.stamp_s, turn.apply(trajectory.position_m), quat.as_quat(scalar_first=True))


def file_hashes(files: tuple[Path, ...]) -> dict[str, str]:
    """SHA-256 of every input, by its path below the folder that holds them all (two folders may hold one name)."""
    if not files:
        return {}
    # Inputs are absolute; what was made of images and scans lies where --out says, which may be relative.
    files = tuple(path.absolute() for path in files)
    root = Path(os.path.commonpath([path.parent for path in files]))
    return {path.relative_to(root).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


class _Reader:
    """Reads files and remembers which; keeps in the session's folder what it makes of images and scans."""

    def __init__(self, progress: Progress, out: Path) -> None:
        self.files: dict[Path, None] = {}
        self.progress = progress
        self.out = out

    def trajectory(self, source: TrajectoryFile) -> Trajectory:
        self.seen(source.file)
        if source.times is not None:
            self.seen(source.times)
        read = read_trajectory(source.file, source.format, times=source.times, rate_hz=source.rate_hz)
        return upright(read) if source.optical_axes else read

    def seen(self, path: Path) -> Path:
        self.files[path] = None
        return path


def _trajectories(config: SessionConfig, reader: _Reader) -> tuple[dict[str, Trajectory], dict[str, tuple[str, ...]]]:
    """All trajectories in the config's order, and what is to be said of those that are made here."""
    found: dict[str, Trajectory] = {}
    said: dict[str, tuple[str, ...]] = {}
    # Mapping goes along another trajectory, so it comes last.
    for name in sorted(config.trajectories, key=lambda n: getattr(config.trajectories[n], "computed", "") == "mapping"):
        source = config.trajectories[name]
        if not isinstance(source, ComputedTrajectoryInput):
            found[name] = reader.trajectory(source)
            continue
        # Only here: scans and registration are of no concern to sessions with trajectories of their own.
        from jaxgeo.cli.computed import TRAJECTORY_FILE, computed_mapping, computed_odometry

        folder = reader.out / COMPUTED / name
        if source.computed == "odometry":
            made = computed_odometry(name, config, folder, reader.progress)
        else:
            along = found[config.mapped_along(name)]
            rig = _rig(config, reader) if config.rig else None
            made = computed_mapping(name, config, along, rig, folder, reader.progress)
        reader.seen(made.folder / TRAJECTORY_FILE)  # stands for the sensors in the hashes of inputs
        found[name] = made.trajectory
        said[name] = made.warnings
    return {name: found[name] for name in config.trajectories}, said


def _survey_and_sightings(config: SessionConfig, reader: _Reader) -> tuple[Survey, Sightings, tuple[str, ...]]:
    source = config.sightings
    if isinstance(source, ControlPointSightingsInput):
        survey, sightings = read_control_points(
            reader.seen(source.file),
            crs=config.crs,
            columns=source.columns,
            delimiter=source.delimiter,
            names=source.names,
            lever_arm_m=source.lever_arm_m,
            sigma_m=source.survey_sigma_m,
            sighting_sigma_m=source.sigma_m,
        )
        return survey, sightings, ()
    survey = _survey(config, reader)
    match source:
        case CornerSightingsInput():
            corners = read_corner_sightings(
                reader.seen(source.file),
                columns=source.columns,
                delimiter=source.delimiter,
                camera=source.camera,
                camera_names={**source.camera_names} or None,
            )
            sightings, said = corners_to_sightings(
                corners, _rig(config, reader), source.marker_size_m, source.pixel_sigma_px
            )
            return survey, sightings, said
        case ImagesSightingsInput():
            # Only here: cameras and masks are of no concern to sessions without images.
            from jaxgeo.cli.detected import detected_in_images

            rig = _rig(config, reader)
            seen = detected_in_images(source, rig, source.marker_size_m, reader.out / DETECTIONS, reader.progress)
            reader.seen(seen.files[0])  # stands for the images in the hashes of inputs
            assert seen.found.sightings is not None  # rig and size are required keys
            return survey, seen.found.sightings, seen.found.warnings
        case PoseSightingsInput():
            in_body = source.frame == "body"
            sightings = read_pose_sightings(
                reader.seen(source.file),
                columns=source.columns,
                delimiter=source.delimiter,
                sigma_m=source.sigma_m,
                sigma_rot_rad=source.sigma_rot_rad,
                camera=None if in_body else source.frame,
                rig=None if in_body else _rig(config, reader),
            )
            return survey, sightings, ()
        case FromTrajectorySightingsInput():
            rows = [(visit.location, visit.row) for visit in source.visits]
            return survey, sightings_from_trajectory(reader.trajectory(source), rows, survey, source.sigma_m), ()


def _survey(config: SessionConfig, reader: _Reader) -> Survey:
    source = config.survey
    assert source is not None  # the schema requires it for these kinds of sightings
    if source.from_trajectory is not None:
        rows = source.from_trajectory
        return survey_from_trajectory(reader.trajectory(rows), rows.rows, config.crs, rows.sigma_m)
    if source.points is not None:
        points: dict[str | int, dict[str, float]] = {
            name: point.model_dump(exclude_none=True) for name, point in source.points.items()
        }
        return survey_from_points(
            points,
            crs=config.crs,
            sigma_m=source.sigma_m,
            sigma_floor_m=source.sigma_m,
            height_m=source.height_m,
            ignore=source.ignore,
        )
    assert source.file is not None
    return read_survey(
        reader.seen(source.file),
        crs=config.crs,
        columns=source.columns,
        delimiter=source.delimiter,
        sigma_m=source.sigma_m,
        sigma_floor_m=source.sigma_m,
        height_m=source.height_m,
        ignore=source.ignore,
    )


def _survey_places(config: SessionConfig, survey: Survey) -> list[str]:
    """Where each location comes from, for messages."""
    source = config.survey
    if source is None:
        assert isinstance(config.sightings, ControlPointSightingsInput)  # the only kind without a survey
        at = str(config.sightings.file)
    elif source.from_trajectory is not None:
        at = str(source.from_trajectory.file)
    else:
        at = str(source.file or "survey.points")
    return [f"{at}: location {name!r}" for name in survey.name]


def _rig(config: SessionConfig, reader: _Reader) -> Rig:
    if config.rig is not None and config.rig.file is not None:
        reader.seen(config.rig.file)
    rig = rig_of(config)
    assert rig is not None  # the schema requires it where it is asked for
    return rig
