"""Sightings of kind `images` to sightings: detected once, kept in a folder, and used again while nothing changed."""

import dataclasses
from pathlib import Path

from jaxgeo.cli.detection_files import ACCOUNT_FILE, CORNERS_FILE, SIGHTINGS_FILE, Detected, detected, write_tables
from jaxgeo.cli.detection_job import DetectionJob, detect, job_of
from jaxgeo.cli.detection_record import DetectionRecord
from jaxgeo.cli.progress import Progress
from jaxgeo.config.images import ImagesSightingsInput
from jaxgeo.data import Rig


@dataclasses.dataclass(frozen=True)
class DetectedImages:
    """A recording, what was found in it, and the tables that say so."""

    job: DetectionJob
    record: DetectionRecord
    found: Detected
    files: tuple[Path, ...]


def detected_in_images(
    images: ImagesSightingsInput,
    rig: Rig | None,
    marker_size_m: dict[str, float] | None,
    folder: Path,
    progress: Progress,
) -> DetectedImages:
    """Detect, or go on detecting, and write the tables into `folder`.

    Args:
        images: the section of a config.
        rig, marker_size_m: None where not known; there are no poses then.
        folder: made where it does not exist; the record in it is used where it is of the same settings and images.
        progress: where a bar is shown.

    Raises:
        InputError: unusable images or settings, or no marker in any image.
    """
    job = job_of(images, rig)
    progress.phase("detect", str(images.source.path))
    record = detect(job, folder, progress)
    progress.phase("corners" if rig is None or marker_size_m is None else "corners to poses")
    found = detected(
        record, job, marker_size_m, time_offset_s=images.time_offset_s, pixel_sigma_px=images.pixel_sigma_px
    )
    write_tables(folder, record, job, found, images.time_offset_s)
    names = (CORNERS_FILE, *(() if found.sightings is None else (SIGHTINGS_FILE,)), ACCOUNT_FILE)
    return DetectedImages(job, record, found, tuple(folder / name for name in names))
