"""One image with its stamp and camera, and what every source of such images offers."""

import abc
import dataclasses
import warnings
from collections.abc import Callable, Iterator
from typing import Literal

import numpy as np
from jaxtyping import UInt8

from jaxgeo.errors import DetectError
from jaxgeo.io.input_warning import InputWarning

OnBad = Literal["raise", "skip"]
DEFAULT_CAMERA = "cam0"


@dataclasses.dataclass(frozen=True)
class Frame:
    """One image.

    Attributes:
        stamp_s: when it was taken, seconds.
        camera: name of the camera that took it.
        source: file and frame, for messages.
        index: its place in its source, counted from 0, unreadable images included.
        image: (h, w, 3) BGR, rows and columns as stored (rotation marks of EXIF and of videos are not applied, since a
            camera's calibration is of its sensor).
    """

    stamp_s: float
    camera: str
    source: str
    index: int
    image: UInt8[np.ndarray, "h w 3"]


class UnreadableImageError(DetectError):
    """One image of a source cannot be read; the others may well be."""


class FrameSource(abc.ABC):
    """Images in a fixed order. Holds no open file between calls.

    Attributes:
        cameras: names of the cameras.
        n_frames: how many images there are, unreadable ones included; None where nothing tells.
        on_bad: what an unreadable image does: `raise` a DetectError, or be left out, counted and warned of (`skip`).
        bad: index -> message of the unreadable images met so far.
    """

    cameras: tuple[str, ...]
    n_frames: int | None
    on_bad: OnBad
    bad: dict[int, str]

    def __init__(self, cameras: tuple[str, ...], n_frames: int | None, on_bad: OnBad) -> None:
        if on_bad not in ("raise", "skip"):
            raise DetectError(f"on_bad is {on_bad!r}, expected 'raise' or 'skip'.")
        self.cameras = cameras
        self.n_frames = n_frames
        self.on_bad = on_bad
        self.bad = {}

    def __iter__(self) -> Iterator[Frame]:
        return self.frames()

    def frames(self, start: int = 0) -> Iterator[Frame]:
        """The images from the one with index `start` on; earlier ones are passed over without decoding them for use.

        Warns:
            InputWarning: of the first unreadable image, and of their number at the end, if `on_bad` is `skip`.

        Raises:
            DetectError: `start` is negative; an image is unreadable and `on_bad` is `raise`.
        """
        if start < 0:
            raise DetectError(f"Reading is to start at frame {start}, expected 0 or more.")
        n_bad = 0
        for index, read in self._entries(start):
            try:
                frame = read()
            except UnreadableImageError as failure:
                if self.on_bad == "raise":
                    raise
                self.bad[index] = str(failure)
                n_bad += 1
                if n_bad == 1:
                    warnings.warn(f"{failure} The image is left out.", InputWarning, stacklevel=2)
                continue
            yield frame
        if n_bad > 1:
            warnings.warn(
                f"{self._name()}: {n_bad} images could not be read and are left out.", InputWarning, stacklevel=2
            )

    @abc.abstractmethod
    def _entries(self, start: int) -> Iterator[tuple[int, Callable[[], Frame]]]:
        """(index, what reads it) of the images from `start` on; reading raises UnreadableImageError."""

    @abc.abstractmethod
    def _name(self) -> str:
        """What the source is called in messages: its path."""
