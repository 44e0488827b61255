"""A simulated recording as ordinary files, with the config that runs on them without any trajectory."""

import dataclasses
import json
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from jaxgeo.data import Rig, Sightings
from jaxgeo.data.scan import Scan
from jaxgeo.io.atomic import output_folder
from jaxgeo.io.rig_text import rig_yaml
from jaxgeo.io.scans.write import write_packed_scans
from jaxgeo.io.sightings_csv import write_pose_sightings
from jaxgeo.io.tum import write_tum
from jaxgeo.io.yaml_text import dump_yaml
from jaxgeo.simulate.files import write_survey
from jaxgeo.simulate.layout import ORIGIN_ENH_M
from jaxgeo.simulate.sensors.board import MARGIN_S, SIDE_M
from jaxgeo.simulate.sensors.recording import DEPTH_UNIT_M, EncodedFrame, Recording
from jaxgeo.simulate.sensors.rendering import rendered
from jaxgeo.simulate.sensors.rig import CAMERA
from jaxgeo.simulate.session import START_S

VISIT_GAP_S = 5.0


def write_recording(
    recording: Recording, folder: Path, *, workers: int = 1, on_item: Callable[[], None] = lambda: None
) -> Path:
    """Render a recording into `folder`, all or nothing; the config's path.

    `scans.npz`, `color/STAMP.jpg`, `depth/STAMP.png` (16 bits of millimetres), `rig.yaml`, `survey.csv`, `config.yaml`;
    and for comparison only `truth.tum` and `truth.json`.

    Args:
        on_item: called after each scan and each frame.
    """
    with output_folder(folder) as temporary:
        if recording.camera is not None:
            for name in ("color", "depth"):
                (temporary / name).mkdir()
        items = rendered(recording, workers)
        write_packed_scans(temporary / "scans.npz", _scans(items, temporary, on_item))
        write_side_files(recording, temporary)
        config = recording_config(recording, scans={"path": "scans.npz"}, frames={"kind": "folder", "path": "color"})
        if recording.camera is not None:
            config["rgbd"] = {"path": ".", "camera": CAMERA, "depth_unit_m": DEPTH_UNIT_M}
        (temporary / "config.yaml").write_text(dump_yaml(config), encoding="utf-8")
    return folder / "config.yaml"


def write_side_files(recording: Recording, folder: Path) -> None:
    """What stands beside the sensors' data: survey, rig, truth; without a camera the sightings too."""
    write_survey(folder / "survey.csv", recording.session.survey)
    (folder / "rig.yaml").write_text(rig_yaml(Rig({CAMERA: recording.rig.camera})), encoding="utf-8")
    write_tum(folder / "truth.tum", recording.truth())
    truth = json.dumps(_truth(recording), indent=2, allow_nan=False, default=lambda array: array.tolist())
    (folder / "truth.json").write_text(truth + "\n", encoding="utf-8")
    if recording.camera is None:
        write_pose_sightings(folder / "sightings.csv", _sightings(recording))


def recording_config(recording: Recording, scans: dict[str, Any], frames: dict[str, Any]) -> dict[str, Any]:
    """The config of a run from the raw sensors: odometry from the scans, markers from the images.

    Args:
        scans, frames: where they are, as `scans` and `sightings.source` say it.
    """
    session = recording.session
    sightings = {
        "kind": "images",
        "source": frames,
        "families": [recording.marker.family],
        "mask": "green",
        "marker_size_m": recording.marker.size_m,
    }
    return {
        "name": recording_name(recording),
        "simulated": True,
        "seed": session.seed,
        "crs": session.survey.crs,
        "origin_enh_m": ORIGIN_ENH_M.tolist(),
        "survey": {"file": "survey.csv"},
        "rig": {"file": "rig.yaml"},
        "scans": {**scans, "T_body_lidar": _pose(recording.rig.T_body_lidar)},
        "sightings": {"kind": "poses", "file": "sightings.csv", "frame": "body"}
        if recording.camera is None
        else sightings,
        "visits": {"gap_s": VISIT_GAP_S, **({"order": list(recording.order)} if recording.order else {})},
    }


def recording_name(recording: Recording) -> str:
    """The name that the recording's config gives it."""
    return f"simulated_sensors_{recording.session.layout.name.lower()}"


def _scans(items: Iterable[Scan | EncodedFrame], folder: Path, on_item: Callable[[], None]) -> Iterator[Scan]:
    """The scans among the items; the frames are written as they come by."""
    for item in items:
        if isinstance(item, Scan):
            yield item
        else:
            stamp = f"{item.stamp_s:.6f}"
            (folder / "color" / f"{stamp}.jpg").write_bytes(item.color_jpeg)
            (folder / "depth" / f"{stamp}.png").write_bytes(item.depth_png)
        on_item()


def _sightings(recording: Recording) -> Sightings:
    """Those of the visits that the recording holds."""
    every = recording.session.sightings
    time_s = every.stamp_s - START_S
    inside = [(time_s >= visit.arrive_s) & (time_s <= visit.leave_s) for visit in recording.visits]
    kept = np.logical_or.reduce([np.zeros(len(time_s), bool), *inside]) & (time_s <= recording.duration_s)
    return Sightings(**{field.name: getattr(every, field.name)[kept] for field in dataclasses.fields(every)})


def _pose(pose: RigidTransform) -> dict[str, list[float]]:
    quat = pose.rotation.as_quat(canonical=True, scalar_first=True)
    return {"t_m": pose.translation.tolist(), "quat_wxyz": quat.tolist()}


def _truth(recording: Recording) -> dict[str, Any]:
    """What the recording was made from; markers in the local frame: grid (E, N, h) minus origin."""
    session = recording.session
    return {
        "simulated": True,
        "seed": session.seed,
        "layout": dataclasses.asdict(session.layout),
        "duration_s": recording.duration_s,
        "lidar": dataclasses.asdict(recording.lidar),
        "rgbd": None if recording.camera is None else dataclasses.asdict(recording.camera),
        "marker": dataclasses.asdict(recording.marker),
        "board_side_m": SIDE_M,
        "origin_enh_m": ORIGIN_ENH_M,
        "marker_enh_m": session.marker_enh_m,
        "visits": [
            {
                "location": visit.location,
                "arrive_s": visit.arrive_s,
                "leave_s": visit.leave_s,
                "shown_s": [visit.arrive_s - MARGIN_S, visit.leave_s + MARGIN_S],
                "T_local_marker": _pose(visit.T_local_marker),
            }
            for visit in recording.visits
        ],
        "scans": len(recording.scan_s),
        "frames": len(recording.frame_s),
    }
