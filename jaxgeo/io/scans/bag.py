"""The scans of ROS bags."""

import functools
from collections.abc import Callable, Iterator
from pathlib import Path

from jaxgeo.data import Scan
from jaxgeo.errors import ScanError
from jaxgeo.io.bag_reader import BagMessage, BagReader, MessageKind
from jaxgeo.io.item_source import OnBad
from jaxgeo.io.scans.columns import scan_of_columns
from jaxgeo.io.scans.point_cloud2 import columns_of_message
from jaxgeo.io.scans.scan_source import ScanSource, UnreadableScanError

_SCANS = MessageKind(
    noun="scan",
    types=("sensor_msgs/msg/PointCloud2",),
    choice="`topic`",
    device="LiDAR",
    error=ScanError,
    unreadable=UnreadableScanError,
)


class BagScans(ScanSource):
    """The scans of one topic of a bag (sensor_msgs/PointCloud2), in the order in which they were recorded.

    Their stamps are those of the message headers. Scans without (stamp 0) get the time of recording, with a warning. A
    scan whose stamp is not after that of the one before counts as unreadable.
    """

    def __init__(
        self, path: str | Path, *, topic: str | None = None, point_times: bool = True, on_bad: OnBad = "raise"
    ) -> None:
        """Open the bag once and look at its topics.

        Args:
            path: a `.bag`, `.mcap` or `.db3` file, or the folder of a ROS 2 bag.
            topic: default: the only one of point clouds.
            point_times: read the points' times, where there are any.
            on_bad: as of every source.

        Raises:
            ScanError: rosbags is not installed; no such bag, or a damaged one; the topic is missing, holds no point
                clouds or no message; several topics of point clouds and no choice.
        """
        self._bag = BagReader(path, None if topic is None else [topic], _SCANS)
        self._point_times = point_times
        super().__init__(self._bag.n_messages, on_bad)

    def _entries(self, start: int) -> Iterator[tuple[int, Callable[[], Scan]]]:
        before: list[BagMessage] = []
        for index, read in self._bag.entries(start):
            yield index, functools.partial(self._scan, read, before)

    def _scan(self, read: Callable[[], BagMessage], before: list[BagMessage]) -> Scan:
        """`before` holds the message read last, and gets this one."""
        message = read()
        if before and message.stamp_s <= before[0].stamp_s:
            raise UnreadableScanError(
                f"{message.source}: stamp {message.stamp_s!r} s after {before[0].stamp_s!r} s of scan "
                f"{before[0].index}, expected stamps that increase. Was the clock set back, or do two sensors send on "
                "one topic?"
            )
        columns = columns_of_message(message.content, message.source)
        before[:] = [message]
        return scan_of_columns(columns, message.stamp_s, message.source, message.index, point_times=self._point_times)

    def _name(self) -> str:
        return str(self._bag.path)
