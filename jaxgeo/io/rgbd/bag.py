"""The RGB-D frames of ROS bags: a topic of colour and one of depth."""

import functools
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import NoReturn

from jaxgeo.data import RgbdFrame
from jaxgeo.errors import ScanError
from jaxgeo.io.bag_reader import BagMessage, BagReader, MessageKind, topics_of_types
from jaxgeo.io.frames.image_message import image_of_compressed_message, image_of_message
from jaxgeo.io.item_source import OnBad, raised_as
from jaxgeo.io.rgbd.depth import check_depth_unit, depth_of_compressed_message, depth_of_message
from jaxgeo.io.rgbd.pairs import check_gap, check_paired, nearest_pairs
from jaxgeo.io.rgbd.rgbd_source import RgbdSource, UnreadableFrameError, frame_of_images

RAW, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
_IMAGES = MessageKind(
    noun="image",
    types=(RAW, COMPRESSED),
    choice="`topics` (color: .., depth: ..)",
    device="camera",
    error=ScanError,
    unreadable=UnreadableFrameError,
)
_COLOUR = {RAW: image_of_message, COMPRESSED: image_of_compressed_message}
_DEPTH = {RAW: depth_of_message, COMPRESSED: depth_of_compressed_message}


class BagRgbd(RgbdSource):
    """The frames of a topic of colour and one of depth on the same pixels, paired by the stamps of their headers.

    `n_frames` is None: only reading tells how many pairs there are. A frame's index counts pairs. A damaged message
    ends the reading, since the partners behind it cannot be told.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        topics: Mapping[str, str] | None = None,
        depth_unit_m: float = 0.001,
        max_gap_s: float = 0.02,
        on_bad: OnBad = "raise",
    ) -> None:
        """Open the bag once and look at its topics.

        Args:
            path: a `.bag`, `.mcap` or `.db3` file, or the folder of a ROS 2 bag.
            topics: `color` and `depth` -> topic. Default: the only image topic with `depth` in its name, and the only
                one without.
            depth_unit_m: metres of one step of a 16-bit depth image.
            max_gap_s: how far apart in time colour and depth may be.
            on_bad: as of every source.

        Raises:
            ScanError: rosbags is not installed; no such bag, or a damaged one; a topic is missing, is no image or holds
                none; several image topics and no choice.
        """
        check_depth_unit(path, depth_unit_m)
        check_gap(path, max_gap_s)
        if topics is None:
            topics = _topics_by_name(path)
        if set(topics) != {"color", "depth"}:
            raise ScanError(f"{path}: topics of {', '.join(topics) or 'nothing'}, expected of color and of depth.")
        self._colour = BagReader(path, [topics["color"]], _IMAGES)
        self._depth = BagReader(path, [topics["depth"]], _IMAGES)
        self._depth_unit_m, self._max_gap_s = depth_unit_m, max_gap_s
        super().__init__(None, on_bad)

    def _entries(self, start: int) -> Iterator[tuple[int, Callable[[], RgbdFrame]]]:
        failures: list[UnreadableFrameError] = []
        pairs = nearest_pairs(_stream(self._colour, failures), _stream(self._depth, failures), self._max_gap_s)
        n_colour, n_depth, index = 0, 0, 0
        for colour, depth in pairs:
            n_colour += colour is not None
            n_depth += depth is not None
            if colour is not None and depth is not None:
                if index >= start:
                    yield index, functools.partial(self._frame, index, colour, depth)
                index += 1
        for at, failure in enumerate(failures, start=index):
            yield at, functools.partial(_fail, failure)
        if not failures:
            how = f" within {self._max_gap_s:g} s"
            check_paired(self._name(), n_colour, n_depth, index, how)

    def _frame(self, index: int, colour: BagMessage, depth: BagMessage) -> RgbdFrame:
        with raised_as(UnreadableFrameError):
            image = _COLOUR[colour.msgtype](colour.content, colour.source)
        depth_m = _DEPTH[depth.msgtype](depth.content, self._depth_unit_m, depth.source)
        return frame_of_images(colour.stamp_s, image, depth_m, colour.source, index)

    def _name(self) -> str:
        return str(self._colour.path)


def _stream(bag: BagReader, failures: list[UnreadableFrameError]) -> Iterator[BagMessage]:
    """The messages up to the first that cannot be read, or whose stamp is not after the one before."""
    before: BagMessage | None = None
    for _, read in bag.entries():
        try:
            message = read()
        except UnreadableFrameError as failure:
            failures.append(failure)
            return
        if before is not None and message.stamp_s <= before.stamp_s:
            failures.append(
                UnreadableFrameError(
                    f"{message.source}: stamp {message.stamp_s!r} s after {before.stamp_s!r} s of message "
                    f"{before.index}, expected stamps that increase. Was the clock set back?"
                )
            )
            return
        before = message
        yield message


def _topics_by_name(path: str | Path) -> dict[str, str]:
    found, listing = topics_of_types(path, _IMAGES)
    depth = [topic for topic in found if "depth" in topic.casefold()]
    colour = [topic for topic in found if topic not in depth]
    if len(depth) != 1 or len(colour) != 1:
        raise ScanError(
            f"{path}: {len(colour)} image topics without and {len(depth)} with 'depth' in their names, expected one "
            f"each. Choose with {_IMAGES.choice}. Its topics:\n{listing}"
        )
    return {"color": colour[0], "depth": depth[0]}


def _fail(failure: UnreadableFrameError) -> NoReturn:
    raise failure
