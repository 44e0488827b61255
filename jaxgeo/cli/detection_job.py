"""Images to detections, one recording: resumable, in several processes where wanted, always in the source's order."""

import collections
import dataclasses
import json
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from importlib.metadata import version
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8

from jaxgeo.cli.detection_record import DetectionRecord, FrameRecord
from jaxgeo.cli.input_identity import code_hash, facts_key, file_identities
from jaxgeo.cli.progress import Progress
from jaxgeo.config.images import GatesInput, ImageSourceInput, ImagesSightingsInput, MaskInput
from jaxgeo.data import Camera, Rig
from jaxgeo.detect.detection import Detections
from jaxgeo.detect.detector import Detector, DetectorSettings
from jaxgeo.detect.gates import Gates
from jaxgeo.detect.mask import HsvRange, MaskSettings
from jaxgeo.errors import DetectError
from jaxgeo.io import InputWarning
from jaxgeo.io.frames import Frame, FrameSource, open_frames
from jaxgeo.processes import WorkerPool

RECORD_FILE = "detections.jsonl"
_AHEAD = 2  # images read before they are needed, a worker


@dataclasses.dataclass(frozen=True)
class DetectionJob:
    """What is looked for, and where; `rig` says which cameras there are and how large their images, where known."""

    source: ImageSourceInput
    settings: DetectorSettings
    rig: Rig | None
    workers: int = 1


def detector_settings(
    families: list[str], mask: MaskInput | None, gates: GatesInput, decoder: str = "opencv"
) -> DetectorSettings:
    """Settings of the detector as a config or a command line gives them.

    Raises:
        DetectError: an unknown family, or a value out of its range.
    """
    limits = gates.model_dump(exclude_none=True)
    if "ids" in limits:
        limits["ids"] = frozenset(limits["ids"])
    return DetectorSettings(families=tuple(families), mask=_mask(mask), gates=Gates(**limits), decoder=decoder)


def _mask(mask: MaskInput | None) -> MaskSettings | None:
    if mask is None:
        return None
    hsv = HsvRange(low=mask.hsv.low, high=mask.hsv.high)
    return MaskSettings(
        hsv=hsv, polarity=mask.polarity, **mask.model_dump(include={"open_px", "close_px"}, exclude_none=True)
    )


def job_of(source: ImagesSightingsInput, rig: Rig | None) -> DetectionJob:
    """The job that a config's sightings of kind `images` describe."""
    settings = detector_settings(source.families, source.mask, source.gates, source.decoder)
    return DetectionJob(source.source, settings, rig, source.workers)


def frame_source(job: DetectionJob) -> FrameSource:
    """The images, checked against the rig; those that cannot be read are left out and counted.

    Raises:
        InputError: nothing to read there, or a camera that the rig does not have.
    """
    given = job.source
    names = list(job.rig.cameras) if job.rig is not None else []
    source = open_frames(
        given.path,
        kind=given.kind,
        stamps=given.stamps,
        rate_hz=given.rate_hz,
        start_s=given.start_s,
        topics=given.topics,
        camera=given.camera or (names[0] if len(names) == 1 else None),
        on_bad="skip",
    )
    unknown = [name for name in source.cameras if names and name not in names]
    if unknown:
        raise DetectError(
            f"{given.path}: the images are of camera {unknown[0]!r}; the rig has {', '.join(names)}. Say which "
            "of these took them: 'camera' (option --camera), or for a bag 'topics' (--topic TOPIC=CAMERA)."
        )
    return source


def detect(job: DetectionJob, folder: Path, progress: Progress) -> DetectionRecord:
    """Detect in every image of the source; the closed record, kept in `folder`.

    A record of the same settings, source and detector goes on where it stopped; a finished one is used as it is.

    Raises:
        InputError: images that cannot be read, or are not of the rig's cameras.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", InputWarning)
        source = frame_source(job)
        if Path(folder).resolve() == job.source.path.resolve():
            raise DetectError(f"{folder}: pictures written there would lie among the images; name another folder.")
        folder.mkdir(parents=True, exist_ok=True)
        with DetectionRecord(folder / RECORD_FILE, job_key(job, folder)) as record:
            if record.end is not None:
                progress.say(
                    f"{record.path}: settings and images unchanged, {len(record.frames)} images used as they are"
                )
                return record
            if record.resumed:
                progress.say(f"{record.path}: going on after {record.resumed} images")
            last = record.frames[-1].index if record.frames else -1
            with progress.count("images", source.n_frames, last + 1) as bar:
                for frame in _detected(job, source.frames(start=last + 1)):
                    record.append(dataclasses.replace(frame, unreadable=_bad(source, last, frame.index)))
                    last = frame.index
                    bar.done()
            said = [str(w.message) for w in caught if issubclass(w.category, InputWarning)]
            bad = _bad(source, last, None)
            record.finish(
                {
                    "unreadable": bad,
                    "warnings": list(dict.fromkeys(text for text in said if "left out" not in text)),
                    "images_per_s": bar.per_second,
                    "workers": job.workers,
                }
            )
    return record


def _bad(source: FrameSource, after: int, before: int | None) -> tuple[str, ...]:
    """Messages of the unreadable images between two indices."""
    return tuple(
        source.bad[index] for index in sorted(source.bad) if after < index and (before is None or index < before)
    )


def job_key(job: DetectionJob, folder: Path) -> str:
    """Hash of everything that decides what is found: settings, images, the detector's code and OpenCV.

    Images count by name, size and time of change; those in the output folder are our own pictures.
    """
    facts = {
        "settings": settings_values(job.settings),
        "source": job.source.model_dump(mode="json", exclude={"path", "stamps"}),
        "cameras": {} if job.rig is None else {name: _lens(camera) for name, camera in job.rig.cameras.items()},
        "files": file_identities(_files(job.source), folder),
        "code": code_hash("detect"),
        "opencv": version("opencv-python-headless"),
    }
    return facts_key(facts)


def _lens(camera: Camera) -> tuple[str, list[float], list[float]]:
    return camera.distortion_model, camera.intrinsics_px.tolist(), camera.distortion.tolist()


def _files(source: ImageSourceInput) -> list[Path]:
    return [source.path] if source.stamps is None else [source.stamps, source.path]


def settings_values(settings: DetectorSettings) -> dict[str, Any]:
    """The settings as plain values."""
    values = dataclasses.asdict(settings)
    ids = values["gates"].get("ids")
    values["gates"]["ids"] = None if ids is None else sorted(ids)
    return json.loads(json.dumps(values, default=lambda value: np.asarray(value).tolist()))


def _detected(job: DetectionJob, frames: Iterator[Frame]) -> Iterator[FrameRecord]:
    checked = (_checked(frame, job.rig) for frame in frames)
    if job.workers == 1:
        look = _Looker(job.settings, job.rig)
        for frame in checked:
            yield _record(frame, *look(frame.image, frame.camera))
        return
    with WorkerPool(job.workers, _start_worker, (job.settings, job.rig)) as pool:
        try:
            yield from _in_order(pool, checked, job.workers * (1 + _AHEAD))
        except BrokenProcessPool:
            raise DetectError(
                f"{job.source.path}: one of {job.workers} detecting processes ended without a word, killed or out of "
                "memory. Start again with fewer workers: the job goes on where it was."
            ) from None
        finally:
            pool.shutdown(cancel_futures=True)


def _in_order(pool: WorkerPool, frames: Iterable[Frame], most: int) -> Iterator[FrameRecord]:
    """At most so many images are held at a time."""
    waiting: collections.deque[tuple[Frame, Future]] = collections.deque()
    for frame in frames:
        waiting.append(
            (dataclasses.replace(frame, image=frame.image[:0]), pool.submit(_work, frame.image, frame.camera))
        )
        if len(waiting) >= most:
            first, result = waiting.popleft()
            yield _record(first, *result.result())
    for frame, result in waiting:
        yield _record(frame, *result.result())


def _record(frame: Frame, found: Detections, refused: dict[str, int]) -> FrameRecord:
    return FrameRecord(frame.index, float(frame.stamp_s), frame.camera, frame.source, found, refused)


class _Looker:
    """A detector that tells of each image what it refused."""

    def __init__(self, settings: DetectorSettings, rig: Rig | None):
        self._detector = Detector(settings)
        self._cameras = {} if rig is None else rig.cameras

    def __call__(self, image: UInt8[np.ndarray, "h w ..."], camera: str) -> tuple[Detections, dict[str, int]]:
        before = Counter(self._detector.refused)
        found = self._detector(image, self._cameras.get(camera))
        return found, dict(sorted((self._detector.refused - before).items()))


_worker: _Looker | None = None


def _start_worker(settings: DetectorSettings, rig: Rig | None) -> None:
    global _worker
    cv2.setNumThreads(1)  # the processes share the cores already
    _worker = _Looker(settings, rig)


def _work(image: UInt8[np.ndarray, "h w ..."], camera: str) -> tuple[Detections, dict[str, int]]:
    assert _worker is not None
    return _worker(image, camera)


def _checked(frame: Frame, rig: Rig | None) -> Frame:
    camera = None if rig is None else rig.cameras.get(frame.camera)
    if camera is not None and camera.resolution_px is not None:
        height, width = frame.image.shape[:2]
        if (width, height) != camera.resolution_px:
            raise DetectError(
                f"{frame.source}: the image has {width} x {height} px, but the rig's camera {frame.camera!r} has "
                f"resolution_px {list(camera.resolution_px)}. Intrinsics hold for one resolution: give those of these "
                "images."
            )
    return frame
