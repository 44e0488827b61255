"""What `jaxgeo detect` leaves behind: tables, pictures, and an account of what was found and refused."""

import dataclasses
from collections import Counter
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from jaxgeo.associate import AmbiguityRule, corners_to_sightings
from jaxgeo.cli.detected_corners import corner_sightings, sigma_px, write_corners
from jaxgeo.cli.detection_job import DetectionJob, settings_values
from jaxgeo.cli.detection_record import DetectionRecord, FrameRecord
from jaxgeo.data import CornerSightings, Sightings
from jaxgeo.errors import DetectError
from jaxgeo.export.json_text import json_text
from jaxgeo.io import write_pose_sightings
from jaxgeo.io.atomic import atomic_path

CORNERS_FILE, SIGHTINGS_FILE, ACCOUNT_FILE = "corners.csv", "sightings.csv", "detect.json"


@dataclasses.dataclass(frozen=True)
class Detected:
    """A recording's detections.

    Attributes:
        corners: all of them.
        sightings: their poses; None where rig or size is not known.
        warnings: sentences for the user.
    """

    corners: CornerSightings
    sightings: Sightings | None
    warnings: tuple[str, ...]


def detected(
    record: DetectionRecord,
    job: DetectionJob,
    marker_size_m: dict[str, float] | None,
    *,
    time_offset_s: float = 0.0,
    pixel_sigma_px: float = 1.0,
) -> Detected:
    """Corners and, where rig and size are known, poses of what a job found.

    Raises:
        DetectError: no marker in any image, with what was tried and what refused.
        SightingError: corners of which no pose can be made.
    """
    refuse_nothing_found(record, job)
    corners = corner_sightings(record.frames, len(job.settings.families) > 1, time_offset_s)
    if job.rig is None or marker_size_m is None:
        return Detected(corners, None, record_words(record))
    sightings, said = corners_to_sightings(
        corners, job.rig, marker_size_m, pixel_sigma_px, ambiguity_rule=AmbiguityRule()
    )
    return Detected(corners, sightings, (*record_words(record), *said))


def refuse_nothing_found(record: DetectionRecord, job: DetectionJob) -> None:
    """Raise where not a single marker was found."""
    if any(len(frame.found) for frame in record.frames):
        return
    families = ", ".join(job.settings.families)
    mask = "without a mask"
    if job.settings.mask is not None:
        low, high = (",".join(map(str, end)) for end in (job.settings.mask.hsv.low, job.settings.mask.hsv.high))
        mask = f"within the colours H,S,V {low} to {high}"
    refused = "; ".join(f"{count} by {gate!r}" for gate, count in refused_counts(record.frames).most_common())
    nearly = f"Readings that came near a code were refused: {refused}." if refused else "No reading came near a code."
    bad = len(unreadable(record))
    images = f"{len(record.frames)} images" + (f" ({bad} more could not be read)" if bad else "")
    raise DetectError(
        f"{job.source.path}: no marker in {images}; families {families}; {mask}. {nearly} Name the family that was "
        "printed (--family), check the mask's colours on a few images, or loosen the gate that "
        "refuses."
    )


def refused_counts(frames: Sequence[FrameRecord]) -> Counter[str]:
    """How many readings near a code each gate refused."""
    counts: Counter[str] = Counter()
    for frame in frames:
        counts.update(frame.refused)
    return +counts


def unreadable(record: DetectionRecord) -> list[str]:
    """Messages of the images that could not be read, in the source's order."""
    return [text for frame in record.frames for text in frame.unreadable] + list((record.end or {})["unreadable"])


def record_words(record: DetectionRecord) -> tuple[str, ...]:
    """What to say of the images themselves."""
    said, bad = tuple((record.end or {})["warnings"]), unreadable(record)
    if not bad:
        return said
    count = "1 image" if len(bad) == 1 else f"{len(bad)} images"
    return (*said, f"{count} could not be read and left out: {' '.join(bad[:3])}{' ..' * (len(bad) > 3)}")


def write_tables(
    folder: Path, record: DetectionRecord, job: DetectionJob, found: Detected, time_offset_s: float = 0.0
) -> None:
    """Write corners.csv, sightings.csv (where there are poses) and detect.json into `folder`, each of them whole."""
    several = len(job.settings.families) > 1
    write_corners(folder / CORNERS_FILE, record.frames, several, time_offset_s)
    if found.sightings is None:
        (folder / SIGHTINGS_FILE).unlink(missing_ok=True)  # an older run's would pass for this one's
    else:
        write_pose_sightings(folder / SIGHTINGS_FILE, found.sightings)
    with atomic_path(folder / ACCOUNT_FILE) as temporary:
        temporary.write_text(json_text(account(record, job, found, time_offset_s)), encoding="utf-8")


def account(record: DetectionRecord, job: DetectionJob, found: Detected, time_offset_s: float) -> dict[str, Any]:
    """Settings, versions, counts and what was refused; `timing` alone differs from one run to the next."""
    frames, families, markers = record.frames, Counter[str](), Counter(found.corners.marker.tolist())
    for frame in frames:
        families.update(frame.found.family.tolist())
    end = record.end or {}
    return {
        "source": job.source.model_dump(mode="json"),
        "settings": settings_values(job.settings),
        "time_offset_s": time_offset_s,
        "versions": {name: version(name) for name in ("jaxgeo", "opencv-python-headless", "numpy")},
        "images": {
            "read": len(frames),
            "with_markers": sum(len(frame.found) > 0 for frame in frames),
            "unreadable": unreadable(record),
            "first_stamp_s": min(frame.stamp_s for frame in frames),
            "last_stamp_s": max(frame.stamp_s for frame in frames),
        },
        "markers": dict(sorted(markers.items(), key=lambda item: (len(item[0]), item[0]))),
        "families": {name: families[name] for name in job.settings.families},
        "refused_by_gate": dict(refused_counts(frames)),
        "poses": None if found.sightings is None else len(found.sightings),
        "ambiguous_poses": None if found.sightings is None else int(np.count_nonzero(found.sightings.ambiguous)),
        "median_corner_sigma_px": float(np.median(np.concatenate([sigma_px(f.found.covariance_px2) for f in frames]))),
        "warnings": list(found.warnings),
        "timing": {key: end.get(key) for key in ("images_per_s", "workers")},
    }


def write_picture(path: Path, picture: np.ndarray) -> None:
    """Write a picture in the format of its suffix, whole or not at all.

    Raises:
        DetectError: it cannot be encoded.
    """
    done, data = cv2.imencode(path.suffix, picture)
    if not done:
        raise DetectError(f"{path}: the picture of {picture.shape} cannot be encoded as {path.suffix}.")
    with atomic_path(path) as temporary:
        temporary.write_bytes(data.tobytes())
