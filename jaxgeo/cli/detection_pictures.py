"""Pictures of a finished detection: overlays of the visits, and a contact sheet of the whole recording."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from scipy.spatial.transform import Rotation

from jaxgeo.associate import cut_visits
from jaxgeo.cli.detected_corners import marker_names, marker_sources
from jaxgeo.cli.detection_files import Detected, write_picture
from jaxgeo.cli.detection_job import DetectionJob, frame_source
from jaxgeo.cli.detection_record import FrameRecord
from jaxgeo.data import Camera
from jaxgeo.detect.mask import clean, hsv_mask
from jaxgeo.export.contact_sheet import SheetImage, contact_sheet, thumbnail
from jaxgeo.export.detection_overlay import MarkerPoses, detection_overlay

OVERLAYS, SHEET_FILE = "overlays", "contact_sheet.png"
_SHEET_IMAGES = 24
_SHEET_WIDTH_PX = 400


def write_pictures(
    folder: Path,
    frames: Sequence[FrameRecord],
    job: DetectionJob,
    found: Detected,
    *,
    marker_size_m: dict[str, float] | None,
    gap_s: float,
    most: int,
    label: str = "",
) -> int:
    """Write the pictures into `folder`; how many overlays there are.

    Args:
        frames: of the record.
        marker_size_m: side by marker, for the poses' axes.
        gap_s: where sightings are cut into visits; of each, the image in the middle is shown.
        most: at most so many overlays, evenly chosen.
        label: stands before every title: `SIMULATED`.
    """
    shown = _middles(frames, found, len(job.settings.families) > 1, gap_s, most)
    sheet = {frames[i].index for i in np.unique(np.linspace(0, len(frames) - 1, _SHEET_IMAGES).round().astype(int))}
    overlays = folder / OVERLAYS
    overlays.mkdir(exist_ok=True)
    for old in overlays.glob("*.jpg"):
        old.unlink()
    thumbnails = []
    by_index = {frame.index: frame for frame in frames}
    for index, image in _images(job, sorted(sheet | shown.keys())):
        frame = by_index[index]
        names = marker_names(frame.found, len(job.settings.families) > 1)
        title = f"{label}{frame.stamp_s:.3f} s, {frame.camera}"
        if index in sheet:
            what = f"{title}: {', '.join(names) or 'no marker'}"
            thumbnails.append(thumbnail(SheetImage(image, what, frame.found.corners_px, names), _SHEET_WIDTH_PX))
        if index in shown:
            path = overlays / f"{index:06d}_{frame.camera}_{frame.stamp_s:.6f}.jpg"
            write_picture(
                path, _overlay(image, frame, names, job, found, marker_size_m, f"{title}, {Path(frame.source).name}")
            )
    every = f"{len(thumbnails)} of {len(frames)} images of {job.source.path.name}"
    write_picture(folder / SHEET_FILE, contact_sheet(thumbnails, label + every, width_px=_SHEET_WIDTH_PX))
    return len(shown)


def _middles(
    frames: Sequence[FrameRecord], found: Detected, several: bool, gap_s: float, most: int
) -> dict[int, FrameRecord]:
    """The images in the middle of the visits, by their index in the source."""
    place = {source: frame for frame in frames for source in marker_sources(frame, several)}
    corners = found.corners
    middle = [str(corners.source[visit.sightings[len(visit.sightings) // 2]]) for visit in cut_visits(corners, gap_s)]
    chosen = list({frame.index: frame for frame in (place[one] for one in middle)}.values())
    if len(chosen) > most:
        chosen = (
            [chosen[i] for i in np.unique(np.linspace(0, len(chosen) - 1, most).round().astype(int))] if most else []
        )
    return {frame.index: frame for frame in chosen}


def _images(job: DetectionJob, indices: Sequence[int]) -> Iterator[tuple[int, UInt8[np.ndarray, "h w ..."]]]:
    """The images at these places of the source, read once more."""
    source = frame_source(job)
    for index in indices:
        frame = next(iter(source.frames(start=index)))
        yield index, frame.image


def _overlay(
    image: UInt8[np.ndarray, "h w ..."],
    frame: FrameRecord,
    names: Sequence[str],
    job: DetectionJob,
    found: Detected,
    marker_size_m: dict[str, float] | None,
    title: str,
) -> UInt8[np.ndarray, "a b 3"]:
    settings = job.settings.mask
    mask = None if settings is None else clean(hsv_mask(image, settings.hsv), settings)
    poses = None
    if job.rig is not None and marker_size_m is not None and found.sightings is not None:
        own = set(marker_sources(frame, len(job.settings.families) > 1))
        poses = _poses(own, job.rig.cameras[frame.camera], found, marker_size_m)
    return detection_overlay(image, frame.found.corners_px, names, mask=mask, poses=poses, title=title)


def _poses(own: set[str], camera: Camera, found: Detected, marker_size_m: dict[str, float]) -> MarkerPoses:
    """Poses of the image's markers in its camera: T_cam_marker = T_body_cam^-1 T_body_marker."""
    sightings = found.sightings
    assert sightings is not None
    rows = [i for i, source in enumerate(sightings.source.tolist()) if source in own]
    R_cam_body = Rotation.from_quat(camera.quat_body_cam_wxyz, scalar_first=True).inv()
    R_body_marker = Rotation.from_quat(sightings.quat_body_marker_wxyz[rows].reshape(-1, 4), scalar_first=True)
    size = [marker_size_m.get(name, marker_size_m.get("default", np.nan)) for name in sightings.marker[rows].tolist()]
    return MarkerPoses(
        camera=camera,
        t_cam_marker_m=R_cam_body.apply(sightings.t_body_marker_m[rows] - camera.t_body_cam_m).reshape(-1, 3),
        R_cam_marker=(R_cam_body * R_body_marker).as_matrix().reshape(-1, 3, 3),
        size_m=np.array(size, dtype=np.float64),
    )
