"""The images of ROS bags."""

import functools
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from jaxgeo.errors import DetectError
from jaxgeo.io.bag_reader import BagMessage, BagReader, MessageKind
from jaxgeo.io.frames.frame import DEFAULT_CAMERA, Frame, FrameSource, OnBad, UnreadableImageError
from jaxgeo.io.frames.image_message import image_of_compressed_message, image_of_message

READERS = {
    "sensor_msgs/msg/Image": image_of_message,
    "sensor_msgs/msg/CompressedImage": image_of_compressed_message,
}
_IMAGES = MessageKind(
    noun="image",
    types=tuple(READERS),
    choice="`topics` (topic: camera)",
    device="camera",
    error=DetectError,
    unreadable=UnreadableImageError,
)


class BagFrames(FrameSource):
    """The images of some topics of a bag, in the order in which they were recorded, read one by one.

    Their stamps are those of the message headers. Images without (stamp 0) get the time of recording, with a warning.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        topics: Mapping[str, str] | None = None,
        camera: str | None = None,
        on_bad: OnBad = "raise",
    ) -> None:
        """Open the bag once and look at its topics.

        Args:
            path: a `.bag`, `.mcap` or `.db3` file, or the folder of a ROS 2 bag.
            topics: topic -> camera; topics of one camera are allowed. Default: the only image topic.
            camera: the camera of the only image topic, without `topics`; default `cam0`.
            on_bad: as of every source.

        Raises:
            DetectError: rosbags is not installed; no such bag, or a damaged one; a topic is missing, is no image or
                holds none; several image topics and no choice.
        """
        if topics is not None and not topics:
            raise DetectError(f"{path}: no topics are named, expected at least one (topic: camera).")
        self._bag = BagReader(path, None if topics is None else list(topics), _IMAGES)
        self._camera_of = dict(topics or {self._bag.topics[0]: camera or DEFAULT_CAMERA})
        super().__init__(tuple(dict.fromkeys(self._camera_of.values())), self._bag.n_messages, on_bad)

    def _entries(self, start: int) -> Iterator[tuple[int, Callable[[], Frame]]]:
        for index, read in self._bag.entries(start):
            yield index, functools.partial(self._frame, read)

    def _frame(self, read: Callable[[], BagMessage]) -> Frame:
        message = read()
        image = READERS[message.msgtype](message.content, message.source)
        return Frame(message.stamp_s, self._camera_of[message.topic], message.source, message.index, image)

    def _name(self) -> str:
        return str(self._bag.path)
