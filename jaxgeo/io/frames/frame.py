"""One image with its stamp and camera, and what every source of such images offers."""

import dataclasses
from collections.abc import Iterator

import numpy as np
from jaxtyping import UInt8

from jaxgeo.errors import DetectError
from jaxgeo.io.item_source import ItemSource, OnBad

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


class FrameSource(ItemSource[Frame]):
    """Images in a fixed order. Holds no open file between calls.

    Attributes:
        cameras: names of the cameras.
        n_frames: how many images there are, unreadable ones included; None where nothing tells.
        on_bad: what an unreadable image does: `raise` a DetectError, or be left out, counted and warned of (`skip`).
        bad: index -> message of the unreadable images met so far.
    """

    error = DetectError
    unreadable = UnreadableImageError
    cameras: tuple[str, ...]
    n_frames: int | None

    def __init__(self, cameras: tuple[str, ...], n_frames: int | None, on_bad: OnBad) -> None:
        super().__init__("image", on_bad)
        self.cameras = cameras
        self.n_frames = n_frames

    def frames(self, start: int = 0) -> Iterator[Frame]:
        """The images from the one with index `start` on; earlier ones are passed over without decoding them for use.

        Warns:
            InputWarning: of the first unreadable image, and of their number at the end, if `on_bad` is `skip`.

        Raises:
            DetectError: `start` is negative; an image is unreadable and `on_bad` is `raise`.
        """
        return self._items(start)
