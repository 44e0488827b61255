"""`jaxgeo rtabmap`: an RTAB-Map database as files that the other commands read.

odometry.tum (several sessions: odometry_MAPID.tum), optimised.tum, truth.tum, rig.yaml, color/STAMP.jpg,
depth/STAMP.png, scans/STAMP.ply and rtabmap.json, which says what was taken over and what was left out.
"""

import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from jaxgeo.cli.progress import Progress
from jaxgeo.errors import InputError
from jaxgeo.export.json_text import json_text
from jaxgeo.io.atomic import check_output_folder, output_folder
from jaxgeo.io.g2o_graph import G2oGraph, write_g2o_graph
from jaxgeo.io.rig_text import rig_yaml
from jaxgeo.io.rtabmap.calibration_blob import StoredCamera, rig_of
from jaxgeo.io.rtabmap.database import RtabmapDatabase, open_rtabmap
from jaxgeo.io.rtabmap.graph import RtabmapGraph
from jaxgeo.io.rtabmap.image_blob import depth_mm, image_suffix
from jaxgeo.io.rtabmap.links import KINDS
from jaxgeo.io.rtabmap.nodes import there
from jaxgeo.io.rtabmap.stored_images import StoredImages, colour_of, depth_of
from jaxgeo.io.scans.write import write_scan
from jaxgeo.io.tum import write_tum

RECORD_FILE = "rtabmap.json"


def import_rtabmap(path: Path, out: Path, *, images: bool = True, scans: bool = True, quiet: bool = False) -> None:
    """Write what the database holds into `out`, all or nothing; damaged images and scans are left out and counted.

    Raises:
        JaxgeoError: as `open_rtabmap`; an empty database; `out` cannot be written to, or holds images or scans.
    """
    check_output_folder(out)
    _check_no_mixture(out, ("color", "depth", "cam1") * images + ("scans",) * scans)
    with open_rtabmap(path) as database, Progress(quiet) as progress, output_folder(out) as temporary:
        if not len(database.nodes):
            raise InputError(f"{path}: a database of RTAB-Map without nodes: nothing was recorded into it.")
        progress.phase("read", path.name)
        record = _tables(database, temporary)
        cameras = _write_rig(database, temporary)
        record["cameras"] = _cameras_record(cameras, database.rectified)
        record["images"] = _write_images(database, cameras, temporary, progress) if images else "not asked for"
        record["scans"] = _write_scans(database, temporary, progress) if scans else "not asked for"
        record["left_out"] = {
            kind: {"count": count, "first": database.left_out.first[kind]}
            for kind, count in database.left_out.count.items()
        }
        (temporary / RECORD_FILE).write_text(json_text(record), encoding="utf-8", newline="\n")
        progress.phase("files", str(out))
    if not quiet:
        for sentence in database.left_out.sentences():
            print(f"warning: {sentence}", file=sys.stderr)
        print(_summary(record))
        print(out)


def _check_no_mixture(out: Path, folders: tuple[str, ...]) -> None:
    """Refuse a folder with images or scans of before: those of two databases would stand side by side."""
    for name in folders:
        if (out / name).exists():
            raise InputError(
                f"{out / name}: is there already, and its files would mix with those of the database. Remove it, or "
                "give another folder."
            )


def stamp_name(stamp_s: float) -> str:
    """The stamp as a file name: positional, and the same float64 when it is read back."""
    return np.format_float_positional(stamp_s, trim="0")


def _tables(database: RtabmapDatabase, folder: Path) -> dict[str, Any]:
    """Write the trajectories; what they and the graph hold."""
    odometry = database.odometry()
    for session, trajectory in odometry.items():
        write_tum(folder / ("odometry.tum" if len(odometry) == 1 else f"odometry_{session}.tum"), trajectory)
    for name, trajectory in (("optimised", database.optimised()), ("truth", database.truth())):
        if trajectory is not None:
            write_tum(folder / f"{name}.tum", trajectory)
    graph = database.graph()
    if len(graph.relative):
        none_fixed = np.zeros(0, int)
        ids = tuple(graph.id.tolist())
        write_g2o_graph(
            folder / "graph.g2o", G2oGraph(ids, graph.position_m, graph.quat_wxyz, graph.relative, none_fixed)
        )
    nodes = database.nodes
    return {
        "database": database.path,
        "version": ".".join(map(str, database.version)),
        "nodes": len(nodes),
        "sessions": dict(sorted(Counter(nodes.map_id.tolist()).items())),
        "odometry": {session: len(trajectory) for session, trajectory in odometry.items()},
        "optimised": int(there(nodes.T_map_body).sum()),
        "truth": int(there(nodes.T_world_body).sum()),
        "gps": _gps_record(database),
        "graph": _graph_record(graph),
    }


def _graph_record(graph: RtabmapGraph) -> dict[str, Any]:
    return {
        "nodes": len(graph.id),
        "carried_by_odometry": int((~graph.optimised).sum()) if graph.optimised.any() else 0,
        "links": {KINDS[kind]: count for kind, count in sorted(Counter(graph.kind.tolist()).items())},
    }


def _gps_record(database: RtabmapDatabase) -> list[dict[str, Any]]:
    """The fixes, node by node: jaxgeo estimates nothing from them, but a survey may want them."""
    names = ("stamp_s", "longitude_deg", "latitude_deg", "altitude_m", "accuracy_m", "bearing_deg")
    nodes = database.nodes
    fixed = np.flatnonzero(~np.isnan(nodes.gps[:, 0]))
    return [
        {"node": int(nodes.id[row]), **dict(zip(names, nodes.gps[row].tolist(), strict=True))} for row in fixed.tolist()
    ]


def _write_rig(database: RtabmapDatabase, folder: Path) -> list[StoredCamera]:
    """Write rig.yaml, where the calibration can be used; the cameras as stored."""
    cameras: list[StoredCamera] = []
    try:
        cameras = database.cameras()
        rig = rig_of(cameras, database.rectified, database.path)
    except InputError as failure:
        database.left_out.add("rigs", str(failure))
        return cameras
    if rig is not None:
        (folder / "rig.yaml").write_text(rig_yaml(rig), encoding="utf-8", newline="\n")
    return cameras


def _cameras_record(cameras: list[StoredCamera], rectified: bool) -> dict[str, Any]:
    return {
        "images_are_rectified": rectified,
        "stored": [
            {"K": camera.K, "D": camera.D, "P": camera.P, "T_body_cam": camera.T_body_cam, "right": camera.right}
            for camera in cameras
        ],
    }


def _write_images(
    database: RtabmapDatabase, cameras: list[StoredCamera], folder: Path, progress: Progress
) -> dict[str, int]:
    """color/STAMP.* and depth/STAMP.png; of a second camera cam1/color and cam1/depth, and so on. How many of each."""
    seen = {f"cam{i}": camera for i, camera in enumerate(cameras) if not camera.right}
    count: Counter[str] = Counter()
    with progress.count("nodes with images", None) as bar:
        for stored in database.images():
            for index, name in enumerate(seen or ["cam0"]):
                for kind, data, end in _files_of(database, stored, index, list(seen.values())):
                    place = kind if index == 0 else f"{name}/{kind}"
                    (folder / place).mkdir(parents=True, exist_ok=True)
                    (folder / place / f"{stamp_name(stored.stamp_s)}{end}").write_bytes(data)
                    count[place] += 1
            bar.done()
    return dict(count)


def _files_of(
    database: RtabmapDatabase, stored: StoredImages, camera: int, cameras: list[StoredCamera]
) -> Iterator[tuple[str, bytes, str]]:
    """(color or depth, encoded image, suffix) of one camera; the colour image of a single camera as it is stored."""
    if stored.image is None:
        database.left_out.add("depth images", f"{stored.source}: depth without a colour image")
        return
    try:
        image = colour_of(stored, camera, cameras)
    except InputError as failure:
        database.left_out.add("images", str(failure))
        return
    if len(cameras) <= 1:
        yield "color", stored.image, image_suffix(stored.image, stored.source)
    else:
        yield "color", _png(image), ".png"
    if stored.depth is None:
        return
    try:
        depth, n_far = depth_mm(depth_of(stored, image, camera, cameras))
    except InputError as failure:
        database.left_out.add("depth images", str(failure))
        return
    if n_far:
        database.left_out.add("depth pixels", f"{stored.source}: 65.535 m away or more", n_far)
    yield "depth", _png(depth), ".png"


def _png(image: np.ndarray) -> bytes:
    done, data = cv2.imencode(".png", image)
    if not done:
        raise InputError(f"an image of {image.shape} {image.dtype} cannot be written as PNG.")
    return data.tobytes()


def _write_scans(database: RtabmapDatabase, folder: Path, progress: Progress) -> int:
    """scans/STAMP.ply, points in the body frame; how many."""
    count = 0
    with progress.count("scans", None) as bar:
        for scan in database.scans(on_bad="skip"):
            (folder / "scans").mkdir(exist_ok=True)
            write_scan(folder / "scans" / f"{stamp_name(scan.stamp_s)}.ply", scan)
            count += 1
            bar.done()
    return count


def _summary(record: dict[str, Any]) -> str:
    links = sum(record["graph"]["links"].values())
    lines = [
        f"RTAB-Map {record['version']}: nodes {record['nodes']} ({record['optimised']} optimised), sessions "
        f"{len(record['sessions'])}, links {links}"
    ]
    if isinstance(record["images"], dict):
        lines.append(f"images: {', '.join(f'{n} {kind}' for kind, n in record['images'].items()) or 'none'}")
    if isinstance(record["scans"], int):
        lines.append(f"scans: {record['scans']}")
    return "\n".join(lines)
