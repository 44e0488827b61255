"""`jaxgeo simulate-sensors`: recordings from simulated raw sensors, as files or as ROS 2 bags."""

import dataclasses
import os
from pathlib import Path

from jaxgeo.cli.progress import Progress
from jaxgeo.errors import InputError
from jaxgeo.io.atomic import check_output_folder
from jaxgeo.simulate import UAV, UGV
from jaxgeo.simulate.sensors.bag_file import write_recording_bag
from jaxgeo.simulate.sensors.files import write_recording
from jaxgeo.simulate.sensors.lidar import Lidar
from jaxgeo.simulate.sensors.recording import record
from jaxgeo.simulate.sensors.rgbd import RgbdCamera

LAYOUTS = {"uav": UAV, "ugv": UGV}
WRITERS = {"files": write_recording, "ros2": write_recording_bag}


@dataclasses.dataclass(frozen=True)
class SensorOptions:
    """What the command line asks for; None leaves the default."""

    seed: int = 0
    session: str = "uav"
    format: str = "files"
    duration_s: float | None = None
    lidar_rate_hz: float | None = None
    rings: int | None = None
    rgbd: bool = True
    rgbd_rate_hz: float | None = None
    workers: int | None = None


def simulate_sensors(out: Path, options: SensorOptions, quiet: bool = False) -> list[Path]:
    """Render the session `uav` or `ugv` into `out`, or `both`, each into its folder there; the configs' paths.

    Raises:
        InputError: no such session or format, a number out of range, a library is missing, or the folder cannot be
            written to.
    """
    if options.session not in (*LAYOUTS, "both"):
        raise InputError(f"--session {options.session!r}: expected {', '.join(LAYOUTS)} or both.")
    if options.format not in WRITERS:
        raise InputError(f"--format {options.format!r}: expected {' or '.join(WRITERS)}.")
    check_output_folder(out)
    lidar = Lidar(**_given(rate_hz=options.lidar_rate_hz, rings=options.rings))
    camera = _camera(options)
    names = list(LAYOUTS) if options.session == "both" else [options.session]
    # All of them before the first is rendered.
    recordings = {
        name: record(options.seed, LAYOUTS[name], lidar=lidar, camera=camera, duration_s=options.duration_s)
        for name in names
    }
    workers = max((os.cpu_count() or 1) // 2, 1) if options.workers is None else options.workers
    configs = []
    with Progress(quiet) as progress:
        for name, recording in recordings.items():
            progress.phase("render", name)
            with progress.count("scans and frames", len(recording.scan_s) + len(recording.frame_s)) as bar:
                folder = out / name if options.session == "both" else out
                configs.append(WRITERS[options.format](recording, folder, workers=workers, on_item=bar.done))
    return configs


def _camera(options: SensorOptions) -> RgbdCamera | None:
    if not options.rgbd:
        return None
    rate_hz = options.rgbd_rate_hz
    if rate_hz is None:
        return RgbdCamera()
    return RgbdCamera(rate_hz=rate_hz, visit_rate_hz=max(rate_hz, RgbdCamera.visit_rate_hz))


def _given(**values: float | None) -> dict:
    return {name: value for name, value in values.items() if value is not None}
