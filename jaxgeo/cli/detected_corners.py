"""Detections of a whole recording as corner sightings, and as the table that `jaxgeo run` reads."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jaxgeo.cli.detection_record import FrameRecord
from jaxgeo.data import CornerSightings
from jaxgeo.detect.detection import Detections
from jaxgeo.io.atomic import write_lines
from jaxgeo.io.sightings_csv import CORNERS

HEADER = ("stamp_s", "camera", "marker", *CORNERS, "sigma_px", "family", "hamming", "margin")


def marker_names(found: Detections, several_families: bool) -> list[str]:
    """The ids; with several families in one job `family:id`, since every family has its own marker 7."""
    ids = found.marker.tolist()
    if not several_families:
        return [str(marker) for marker in ids]
    return [f"{family}:{marker}" for family, marker in zip(found.family.tolist(), ids, strict=True)]


def marker_sources(frame: FrameRecord, several_families: bool) -> list[str]:
    """Words for each marker of an image, all different: the image, the marker, and which of several alike."""
    names = marker_names(frame.found, several_families)
    before = [names[:place].count(name) for place, name in enumerate(names)]
    return [
        f"{frame.source}: marker {name}" + (f" ({alike + 1})" if alike else "")
        for name, alike in zip(names, before, strict=True)
    ]


def sigma_px(covariance_px2: Float[np.ndarray, "m 8 8"]) -> Float[np.ndarray, "m"]:
    """One standard deviation for all coordinates of a marker: the root of the mean variance."""
    return np.sqrt(np.trace(covariance_px2, axis1=1, axis2=2) / 8.0)


def in_time(frames: Sequence[FrameRecord]) -> list[FrameRecord]:
    """Sorted by stamp; images of one stamp keep their order."""
    return [frames[i] for i in np.argsort([frame.stamp_s for frame in frames], kind="stable")]


def corner_sightings(
    frames: Sequence[FrameRecord], several_families: bool, time_offset_s: float = 0.0
) -> CornerSightings:
    """All markers of all images, sorted by stamp, with the covariance of their corners; `source`: `marker_sources`."""
    ordered = [frame for frame in in_time(frames) if len(frame.found)]
    names = [marker_names(frame.found, several_families) for frame in ordered]
    source = [one for frame in ordered for one in marker_sources(frame, several_families)]
    counts = [len(markers) for markers in names]
    return CornerSightings(
        stamp_s=np.repeat([frame.stamp_s + time_offset_s for frame in ordered], counts).astype(np.float64),
        camera=np.repeat(np.array([frame.camera for frame in ordered], dtype=str), counts),
        marker=np.array([marker for markers in names for marker in markers], dtype=str),
        corners_px=np.concatenate([np.zeros((0, 4, 2)), *(frame.found.corners_px for frame in ordered)]),
        source=np.array(source, dtype=str),
        covariance_px2=np.concatenate([np.zeros((0, 8, 8)), *(frame.found.covariance_px2 for frame in ordered)]),
    )


def write_corners(
    path: Path, frames: Sequence[FrameRecord], several_families: bool, time_offset_s: float = 0.0
) -> None:
    """Write `corners.csv`: what `read_corner_sightings` reads, and beside it family, corrected bits and margin."""
    lines = [",".join(HEADER)]
    for frame in in_time(frames):
        found = frame.found
        stamp = repr(frame.stamp_s + time_offset_s)
        names, sigmas = marker_names(found, several_families), sigma_px(found.covariance_px2).tolist()
        corners, margins = found.corners_px.reshape(-1, 8).tolist(), found.margin.tolist()
        for m, name in enumerate(names):
            numbers = [*map(repr, corners[m]), repr(sigmas[m])]
            told = [str(found.family[m]), str(int(found.hamming[m])), repr(margins[m])]
            lines.append(",".join([stamp, frame.camera, name, *numbers, *told]))
    write_lines(path, lines)
