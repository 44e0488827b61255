"""What was found in each image of a recording, in a file that only ever grows: a killed job goes on where it was.

The first line names settings and source by a hash; every further line is one image, with all digits; the last one says
that the recording is done. A line cut short by a kill is dropped when the file is opened again.
"""

import dataclasses
import json
import os
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from jaxgeo.detect.detection import Detections
from jaxgeo.errors import InputError
from jaxgeo.io.atomic import write_lines

_KIND = "jaxgeo detections 1"
_UPPER = np.triu_indices(8)


@dataclasses.dataclass(frozen=True)
class FrameRecord:
    """One image: its place in the source's order, what was found, and how many readings each gate refused.

    `unreadable` has a message for each image between this one and the one before it in the record.
    """

    index: int
    stamp_s: float
    camera: str
    source: str
    found: Detections
    refused: dict[str, int]
    unreadable: tuple[str, ...] = ()


class DetectionRecord:
    """The file, open for more. Use as a context manager.

    Attributes:
        frames: the images there.
        end: what `finish` was given, None while the recording is not done.
        resumed: how many images were there when it was opened.
        reused: it was done when it was opened.
    """

    def __init__(self, path: Path, key: str):
        """Read what is there of this key; a file of another key, or of no key, is replaced.

        Raises:
            InputError: the file cannot be read or written.
        """
        self.path = path
        self.frames: list[FrameRecord] = []
        self.end: dict[str, Any] | None = None
        try:
            size = self._read(key) if path.exists() else 0
            if size == 0:
                self.frames, self.end = [], None
                write_lines(path, [json.dumps({"kind": _KIND, "key": key})])
                size = path.stat().st_size
            self._file = path.open("r+b")
            self._file.truncate(size)
            self._file.seek(size)
        except OSError as error:
            raise InputError(f"{path}: cannot be read and written: {error.strerror or error}.") from None
        self.resumed = len(self.frames)
        self.reused = self.end is not None

    def __enter__(self) -> "DetectionRecord":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def append(self, frame: FrameRecord) -> None:
        """One image more; on disk when this returns, as far as the operating system is concerned."""
        value = _to_json(frame)
        self._write(value)
        self.frames.append(_from_json(value))  # as a resumed job would have it

    def finish(self, end: dict[str, Any]) -> None:
        """The recording is done."""
        self.end = end
        self._write({"end": end})
        os.fsync(self._file.fileno())

    def _write(self, value: dict[str, Any]) -> None:
        self._file.write(json.dumps(value, allow_nan=False).encode() + b"\n")
        self._file.flush()

    def _read(self, key: str) -> int:
        """Bytes of the whole lines that are there, 0 where the file is of another key."""
        size = 0
        with self.path.open("rb") as file:
            for number, line in enumerate(file):
                if not line.endswith(b"\n"):
                    break
                try:
                    value = json.loads(line)
                    if number == 0 and (value.get("kind"), value.get("key")) != (_KIND, key):
                        return 0
                    if number and "end" in value:
                        self.end = value["end"]
                    elif number:
                        self.frames.append(_from_json(value))
                except (ValueError, KeyError, TypeError, AttributeError):
                    break  # not ours, or spoilt by a crash: what stands before it is sound
                size += len(line)
        return size


def _to_json(frame: FrameRecord) -> dict[str, Any]:
    found = frame.found
    markers = [
        {
            "family": str(found.family[m]),
            "marker": int(found.marker[m]),
            "corners_px": found.corners_px[m].ravel().tolist(),
            "covariance_px2": found.covariance_px2[m][_UPPER].tolist(),
            "hamming": int(found.hamming[m]),
            "margin": float(found.margin[m]),
        }
        for m in range(len(found))
    ]
    return {
        "index": frame.index,
        "stamp_s": float(frame.stamp_s),
        "camera": frame.camera,
        "source": frame.source,
        "found": markers,
        "refused": frame.refused,
        "unreadable": list(frame.unreadable),
    }


def _from_json(value: dict[str, Any]) -> FrameRecord:
    found = value["found"]
    covariance = np.zeros((len(found), 8, 8))
    upper = np.array([one["covariance_px2"] for one in found]).reshape(len(found), len(_UPPER[0]))
    covariance[:, _UPPER[0], _UPPER[1]] = upper
    covariance[:, _UPPER[1], _UPPER[0]] = upper
    return FrameRecord(
        index=value["index"],
        stamp_s=value["stamp_s"],
        camera=value["camera"],
        source=value["source"],
        found=Detections(
            family=np.array([one["family"] for one in found], dtype=str),
            marker=np.array([one["marker"] for one in found], dtype=np.int64),
            corners_px=np.array([one["corners_px"] for one in found], dtype=np.float64).reshape(len(found), 4, 2),
            covariance_px2=covariance,
            hamming=np.array([one["hamming"] for one in found], dtype=np.int64),
            margin=np.array([one["margin"] for one in found], dtype=np.float64),
        ),
        refused=value["refused"],
        unreadable=tuple(value["unreadable"]),
    )
