"""An RTAB-Map database: its trajectories, graph and cameras, and its images and scans one by one.

with open_rtabmap("map.db") as database:
    for frame in database.frames():
        ...
"""

import contextlib
import dataclasses
import re
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from jaxgeo.data import RgbdFrame, Rig, Scan, Trajectory
from jaxgeo.errors import InputError
from jaxgeo.io.item_source import OnBad
from jaxgeo.io.rtabmap.blobs import blob
from jaxgeo.io.rtabmap.calibration_blob import StoredCamera, rig_of, stored_cameras
from jaxgeo.io.rtabmap.connection import columns_of, open_read_only, refusals
from jaxgeo.io.rtabmap.graph import RtabmapGraph, graph_of, odometry_by_session, trajectory_of
from jaxgeo.io.rtabmap.left_out import LeftOut
from jaxgeo.io.rtabmap.links import RtabmapLinks, read_links
from jaxgeo.io.rtabmap.nodes import RtabmapNodes, read_nodes, with_optimised
from jaxgeo.io.rtabmap.scan_blob import scan_info, scan_points
from jaxgeo.io.rtabmap.stored_images import StoredImages, colour_of, depth_of

OLDEST = (0, 13)
_TABLES = ("Admin", "Node", "Link", "Data", "Info")
_DATA = ("image", "depth", "calibration", "scan", "scan_info")
_RAW_IMAGES = "Rtabmap/RectifyOnlyFeatures:true"


@dataclasses.dataclass(frozen=True)
class RtabmapDatabase:
    """An open database; its tables of nodes and links are read, its images and scans wait.

    Attributes:
        path: the file.
        version: of RTAB-Map's database, (0, 21, 1).
        nodes: in the order of their ids.
        links: the measured motions between them.
        rectified: whether RTAB-Map takes the stored images as rectified (unless told otherwise, it does).
        left_out: what was not taken over so far, with reasons; grows with each pass over images, scans and graph.
    """

    path: str
    version: tuple[int, ...]
    nodes: RtabmapNodes
    links: RtabmapLinks
    rectified: bool
    left_out: LeftOut
    _connection: sqlite3.Connection = dataclasses.field(repr=False)

    def odometry(self) -> dict[int, Trajectory]:
        """`T_odom_body` of each session by its map_id; every session has a frame of its own."""
        return odometry_by_session(self.path, self.nodes)

    def optimised(self) -> Trajectory | None:
        """`T_map_body` of the nodes that RTAB-Map's optimiser placed; None where there are none."""
        return trajectory_of(self.path, self.nodes, self.nodes.T_map_body)

    def truth(self) -> Trajectory | None:
        """The ground truth that was recorded with the nodes; None where there is none."""
        return trajectory_of(self.path, self.nodes, self.nodes.T_world_body)

    def graph(self) -> RtabmapGraph:
        """The nodes with their best poses, and the links between them."""
        return graph_of(self.path, self.nodes, self.links, self.left_out)

    def cameras(self) -> list[StoredCamera]:
        """The cameras of the first node that has any: `cam0`, `cam1`, ... of `rig`.

        Raises:
            ScanError: a calibration that cannot be read.
        """
        for source, _, (value,) in self._rows(("calibration",)):
            data = blob(value, f"{source}: calibration")
            if data is not None:
                return stored_cameras(data, self.version, f"{source}: calibration")
        return []

    def rig(self) -> Rig | None:
        """The cameras `cam0`, `cam1`, ... that took the stored images; None where there is no calibration.

        Raises:
            ScanError: a calibration that cannot be read, or a distortion that is not supported.
        """
        return rig_of(self.cameras(), self.rectified, self.path)

    def images(self) -> Iterator[StoredImages]:
        """What the nodes hold of images, in the order of time; nodes without any are passed over.

        Calibrations other than the first one, which `cameras` and `rig` give, are counted in `left_out`.
        """
        first: bytes | None = None
        for index, (source, stamp_s, values) in enumerate(self._rows(("image", "depth", "calibration"))):
            names = ("image", "depth", "calibration")
            image, depth, calibration = (blob(v, f"{source}: {n}") for v, n in zip(values, names, strict=True))
            first = first or calibration
            if calibration not in (None, first):
                self.left_out.add("calibrations", f"{source}: differs from that of the first node")
            if (image, depth) != (None, None):
                yield StoredImages(stamp_s, image, depth, calibration, source, index)

    def frames(self, camera: int = 0, on_bad: OnBad = "raise") -> Iterator[RgbdFrame]:
        """Colour and depth of the nodes that have both, in the order of time.

        A depth image smaller than the colour image is enlarged to it, nearest pixel.

        Args:
            camera: which of the cameras whose images stand side by side (the right one of a stereo pair does not).
            on_bad: an unreadable frame does: `raise`, or be left out and counted (`skip`).

        Raises:
            ScanError, InputError: a frame that cannot be read, with `raise`.
        """
        cameras = [stored for stored in self.cameras() if not stored.right]
        for stored in self.images():
            if stored.image is None or stored.depth is None:
                self.left_out.add("frames", f"{stored.source}: no {'image' if stored.image is None else 'depth'}")
                continue
            try:
                image = colour_of(stored, camera, cameras)
                depth_m = depth_of(stored, image, camera, cameras)
            except InputError as failure:
                self._skip("frames", failure, on_bad)
                continue
            yield RgbdFrame(stored.stamp_s, image, depth_m, stored.source, stored.index)

    def scans(self, on_bad: OnBad = "raise") -> Iterator[Scan]:
        """The laser scans, in the order of time, their points in the BODY frame (the local transform is applied).

        Poses of `odometry` and `optimised` therefore place them as they are. Planar scans have z = 0 in the scanner.

        Args:
            on_bad: an unreadable scan does: `raise`, or be left out and counted (`skip`).

        Raises:
            ScanError, InputError: a scan that cannot be read, with `raise`.
        """
        for index, (source, stamp_s, (scan, info)) in enumerate(self._rows(("scan", "scan_info"))):
            try:
                found = self._scan(source, stamp_s, scan, info, index)
            except InputError as failure:
                self._skip("scans", failure, on_bad)
                continue
            if found is not None:
                yield found

    def _scan(self, source: str, stamp_s: float, scan: Any, info: Any, index: int) -> Scan | None:
        data = blob(scan, f"{source}: scan")
        if data is None:
            return None
        about = scan_info(blob(info, f"{source}: scan_info"), self.version, f"{source}: scan_info")
        points = scan_points(data, about, f"{source}: scan")
        if points.n_empty:
            self.left_out.add("points of scans", f"{source}: points at the scanner or not finite", points.n_empty)
        return Scan(stamp_s, points.points_m, points.time_s, points.intensity, source, index)

    def _skip(self, kind: str, failure: InputError, on_bad: OnBad) -> None:
        if on_bad == "raise":
            raise failure
        self.left_out.add(kind, str(failure))

    def _rows(self, columns: tuple[str, ...]) -> Iterator[tuple[str, float, tuple[Any, ...]]]:
        """(source, stamp_s, values) of each node that has data, in the order of time."""
        query = f"SELECT {', '.join(columns)} FROM Data WHERE id = ?"
        for row in np.argsort(self.nodes.stamp_s, kind="stable").tolist():
            node = int(self.nodes.id[row])
            with refusals(self.path):
                values = self._connection.execute(query, (node,)).fetchone()
            if values is not None:
                yield f"{self.path}: node {node}", float(self.nodes.stamp_s[row]), values


@contextlib.contextmanager
def open_rtabmap(path: str | Path) -> Iterator[RtabmapDatabase]:
    """Open an RTAB-Map database (version 0.13 or later) to be read; nothing is written, in it or beside it.

    Raises:
        InputError: no SQLite file, no RTAB-Map database, too old, still being written, or values that are damaged.
        GraphError: links that are damaged.
    """
    name = str(path)
    with open_read_only(path, _TABLES) as connection:
        left_out = LeftOut()
        with refusals(path):
            version = _version(name, connection)
            missing = [column for column in _DATA if column not in columns_of(connection, "Data")]
            if missing:
                raise InputError(f"{name}: table 'Data' has no column {missing[0]!r}. Is it an RTAB-Map database?")
            nodes = read_nodes(connection, name, columns_of(connection, "Node"), left_out)
            if {"opt_ids", "opt_poses"} <= set(columns_of(connection, "Admin")):
                ids, poses = connection.execute("SELECT opt_ids, opt_poses FROM Admin").fetchone()
                nodes = with_optimised(nodes, ids, poses, name, left_out)
            links = read_links(connection, name, nodes.id, left_out)
            parameters = _parameters(connection)
        rectified = _RAW_IMAGES not in parameters
        yield RtabmapDatabase(name, version, nodes, links, rectified, left_out, connection)


def _parameters(connection: sqlite3.Connection) -> list[str]:
    """`Name:value` of each parameter of RTAB-Map's last run on the database."""
    if "parameters" not in columns_of(connection, "Info"):
        return []
    texts = [str(row[0]) for row in connection.execute("SELECT parameters FROM Info")]
    return texts[-1].split(";") if texts else []


def _version(path: str, connection: sqlite3.Connection) -> tuple[int, ...]:
    row = connection.execute("SELECT version FROM Admin").fetchone()
    text = "" if row is None else str(row[0])
    if not re.fullmatch(r"\d{1,4}(\.\d{1,4}){1,3}", text):
        raise InputError(f"{path}: Admin.version is {text[:40]!r}; expected one such as '0.21.1'.")
    version = tuple(map(int, text.split(".")))
    if version < OLDEST:
        raise InputError(
            f"{path}: database of RTAB-Map {text}; expected 0.13 or later. Bring it up to date: rtabmap-reprocess "
            "OLD.db NEW.db."
        )
    return version
