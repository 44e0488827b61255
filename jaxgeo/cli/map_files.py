"""What `jaxgeo map` writes beside the trajectory: graph, closures, cloud, picture, record."""

import dataclasses
import importlib.metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxgeo import __version__
from jaxgeo.data import Trajectory
from jaxgeo.export.csv_text import csv_text
from jaxgeo.export.json_text import json_text
from jaxgeo.geometry.rigid import parts
from jaxgeo.io.clouds import CloudChunk, cloud_writer
from jaxgeo.io.g2o_graph import G2oGraph, write_g2o_graph
from jaxgeo.io.tum import write_tum
from jaxgeo.mapping.dense_map import DenseMap
from jaxgeo.mapping.fused_columns import fused_columns
from jaxgeo.mapping.fusion import FusedCloud
from jaxgeo.mapping.map_settings import MapSettings
from jaxgeo.mapping.submaps import path_length_m

if TYPE_CHECKING:
    from jaxgeo.cli.map import MapOptions

CLOSURE_COLUMNS = (
    *("first", "second", "stamp_first_s", "stamp_second_s", "kind", "score", "weight", "chi2_before", "chi2_after"),
    *("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw", "sigma_trans_m", "sigma_rot_rad", "verdict"),
)


def write_graph_files(folder: Path, given: Trajectory, found: DenseMap) -> None:
    """trajectory.tum, graph.g2o, closures.csv and map.png."""
    write_tum(folder / "trajectory.tum", found.trajectory)
    position_m, quat_wxyz = parts(found.T_map_keyframe)
    graph = G2oGraph(tuple(range(len(position_m))), position_m, quat_wxyz, found.loops.edges, np.array([0]))
    write_g2o_graph(folder / "graph.g2o", graph)
    (folder / "closures.csv").write_text(_closure_table(found), encoding="utf-8")
    (folder / "map.png").write_bytes(_picture(given, found))


def _closure_table(found: DenseMap) -> str:
    rows = []
    for c, weight, before, after in zip(
        found.closures, found.loops.weight, found.loops.chi2_before, found.loops.chi2_after, strict=True
    ):
        position_m, quat = parts(c.T_first_second)
        variance = np.diag(np.linalg.inv(c.information))
        stamps = found.keyframes.stamp_s[[c.first, c.second]]
        rows.append(
            (
                *(c.first, c.second, *stamps.tolist(), c.kind, c.score, float(weight), float(before), float(after)),
                *(*position_m.tolist(), *quat[[1, 2, 3, 0]].tolist()),
                *(float(np.sqrt(variance[:3].sum())), float(np.sqrt(variance[3:].sum()))),
                "accepted" if weight > 0.5 else "rejected: contradicts the graph",
            )
        )
    comments = [
        "jaxgeo map: verified loop closures between keyframes (rows of graph.g2o); T_first_second, quaternion xyzw",
        f"candidates refused: {', '.join(f'{n} {why}' for why, n in sorted(found.refused.items())) or 'none'}",
    ]
    return csv_text(comments, CLOSURE_COLUMNS, rows)


def write_cloud(path: Path, cloud: FusedCloud) -> int:
    """Write a fused cloud, every point with stamp and pose; its points."""
    columns = fused_columns(cloud)
    types = {name: values.dtype for name, values in columns.items()}
    with cloud_writer(path, types, np.zeros(3), None, comments=(f"voxel_m {cloud.voxel_m:g}",)) as writer:
        writer.append(CloudChunk(cloud.points_m, columns))
    return len(cloud)


def write_map_record(
    folder: Path,
    path: Path,
    options: "MapOptions",
    settings: MapSettings,
    given: Trajectory,
    found: DenseMap,
    points: dict[str, int],
    said: list[str],
    seconds: float,
) -> None:
    """map.json: what was asked for, what came of it."""
    loops, refined = found.loops, found.refined
    record: dict[str, Any] = {
        "trajectory": str(path),
        "options": dataclasses.asdict(options),
        "settings": dataclasses.asdict(settings),
        "scale": dataclasses.asdict(found.scale),
        "versions": {"jaxgeo": __version__, "small_gicp": _version("small_gicp")},
        "n_poses": len(given),
        "path_m": float(path_length_m(found.keyframes.T_map_body)[-1]),
        "n_scans": found.n_scans,
        "n_frames": found.n_frames,
        "n_keyframes": len(found.keyframes),
        "bytes_per_keyframe": found.cloud_bytes / len(found.keyframes),
        "closures": {
            "verified": len(found.closures),
            "accepted": int(found.accepted.sum()),
            "rejected": int((~found.accepted).sum()),
            "candidates_refused": dict(found.refused),
        },
        "odometry": {
            "noise_factor": loops.noise_factor,
            "neighbours_registered": 0 if refined is None else len(refined.neighbours),
            "disproved_stamps_s": [] if refined is None else found.keyframes.stamp_s[refined.disproved],
        },
        "graph": {"result": loops.result, "cost_before": loops.cost_before, "cost_after": loops.cost_after},
        "points": points,
        "warnings": said,
        "seconds": seconds,
    }
    (folder / "map.json").write_text(json_text(record), encoding="utf-8")


def _version(name: str) -> str | None:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def _picture(given: Trajectory, found: DenseMap) -> bytes:
    from jaxgeo.export.map_loops_plot import loops_png

    pairs = np.array([(c.first, c.second) for c in found.closures], dtype=int).reshape(-1, 2)
    return loops_png(
        given.position_m,
        found.trajectory.position_m,
        found.keyframes.T_map_body[:, :3, 3],
        found.T_map_keyframe[:, :3, 3],
        pairs,
        found.accepted,
    )
