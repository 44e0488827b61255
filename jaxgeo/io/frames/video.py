"""Video files and animated GIFs, through OpenCV's FFmpeg."""

import contextlib
import functools
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np

from jaxgeo.errors import DetectError
from jaxgeo.io.frames.frame import DEFAULT_CAMERA, Frame, FrameSource, OnBad, UnreadableImageError
from jaxgeo.io.frames.stamps import check_rate
from jaxgeo.io.input_warning import InputWarning


class VideoFrames(FrameSource):
    """The frames of a video file, in order.

    `n_frames` is what the file's header announces, in some formats an estimate. Frames that cannot be decoded FFmpeg
    leaves out without a word: where the end comes more than one frame before what is announced, an InputWarning says
    so.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        rate_hz: float | None = None,
        start_s: float | None = None,
        camera: str | None = None,
        on_bad: OnBad = "raise",
    ) -> None:
        """Open the file once, to see that it can be.

        Args:
            path: the file.
            rate_hz: frames a second; default: the presentation times of the file itself, which a variable rate needs.
                (Matroska holds whole milliseconds.)
            start_s: stamp of the zero of those times, or of the first frame with `rate_hz`; default 0.
            camera: the camera; default `cam0`.
            on_bad: as of every source.

        Raises:
            DetectError: no such file, or no video that OpenCV can read.
        """
        self._path = Path(path)
        self._rate_hz, self._start_s = rate_hz, start_s or 0.0
        check_rate(path, rate_hz, start_s)
        if not self._path.is_file():
            what = "is a folder" if self._path.exists() else "no such file"
            raise DetectError(f"{path}: {what}, expected a video file. Check the path, or is the kind another one?")
        with _opened(self._path) as capture:
            announced = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
            if not capture.grab():
                raise DetectError(f"{path}: the video holds no frame that can be decoded. Is the file complete?")
        self._camera = camera or DEFAULT_CAMERA
        super().__init__((self._camera,), announced if announced > 0 else None, on_bad)

    def _entries(self, start: int) -> Iterator[tuple[int, Callable[[], Frame]]]:
        """Frames before `start` are decoded but not converted: seeking by number is wrong where the rate varies."""
        with _opened(self._path) as capture:
            last_ms = -np.inf
            index = 0
            while capture.grab():
                stamp_ms = capture.get(cv2.CAP_PROP_POS_MSEC)
                if self._rate_hz is None and stamp_ms <= last_ms:
                    raise DetectError(
                        f"{self._path}:{index}: the frame's own time, {stamp_ms:g} ms, is not after {last_ms:g} ms of "
                        "the one before. The file has no usable times: give `rate_hz`."
                    )
                last_ms = stamp_ms
                if index >= start:
                    yield index, functools.partial(self._frame, capture, index, stamp_ms)
                index += 1
        if self.n_frames is not None and index < self.n_frames - 1:
            warnings.warn(
                f"{self._path}: {index} frames could be read of the {self.n_frames} that the file announces. Is it cut "
                "off or damaged? Copy it again.",
                InputWarning,
                stacklevel=3,
            )

    def _frame(self, capture: cv2.VideoCapture, index: int, stamp_ms: float) -> Frame:
        source = f"{self._path}:{index}"
        ok, image = capture.retrieve()
        if not ok or image is None:
            raise UnreadableImageError(f"{source}: the frame cannot be decoded.")
        stamp_s = self._start_s + (stamp_ms / 1e3 if self._rate_hz is None else index / self._rate_hz)
        return Frame(stamp_s, self._camera, source, index, image)

    def _name(self) -> str:
        return str(self._path)


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[cv2.VideoCapture]:
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    try:
        if not capture.isOpened():
            raise DetectError(
                f"{path}: is no video that OpenCV's FFmpeg can read. Is it complete, and no folder or bag? "
                "Convert it, for example to MP4 with H.264."
            )
        capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
        yield capture
    finally:
        capture.release()
