"""`jaxgeo map`: a trajectory and what its sensors saw to a loop-closed trajectory and a cloud."""

import dataclasses
import sys
import time
import warnings
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jaxgeo.cli.count_bar import CountBar
from jaxgeo.cli.map_files import write_cloud, write_graph_files, write_map_record
from jaxgeo.cli.odometry import Source, body_lidar_of
from jaxgeo.cli.progress import Progress
from jaxgeo.data import Camera, Trajectory
from jaxgeo.errors import InputError
from jaxgeo.io.atomic import check_output_folder, output_folder
from jaxgeo.io.input_warning import InputWarning
from jaxgeo.io.rgbd.rgbd_source import RgbdSource
from jaxgeo.io.rgbd.source import open_rgbd
from jaxgeo.io.rig_yaml import read_rig
from jaxgeo.io.scans.scan_source import ScanSource
from jaxgeo.io.scans.source import open_scans
from jaxgeo.io.trajectory_file import read_trajectory
from jaxgeo.mapping.dense_map import DenseMap, build_map
from jaxgeo.mapping.fusion import FusionSettings
from jaxgeo.mapping.map_cloud import fuse_frames, fuse_scans, placed_frames
from jaxgeo.mapping.map_settings import MapSettings
from jaxgeo.mapping.rgbd_camera import RgbdCamera, frames_camera

# Depth cameras are exact near by: their cloud is this much finer than the scene's voxel.
_RGBD_VOXEL = 0.25
_MESH_VOXEL_M = 0.02


@dataclasses.dataclass(frozen=True)
class FrameSource:
    """Where the RGB-D frames are: the arguments of `open_rgbd`."""

    path: Path
    stamps: Path | None = None
    rate_hz: float | None = None
    depth_unit_m: float = 0.001


@dataclasses.dataclass(frozen=True)
class MapOptions:
    """Of the command line; see there."""

    scans: Source | None = None
    body_lidar: str | None = None
    frames: FrameSource | None = None
    rig: Path | None = None
    camera: str | None = None
    format: str = "tum"
    times: Path | None = None
    cloud_voxel_m: float | None = None
    mesh: bool = False


@dataclasses.dataclass(frozen=True)
class _Inputs:
    trajectory: Trajectory
    scans: ScanSource | None
    frames: RgbdSource | None
    T_body_lidar: Float[np.ndarray, "4 4"]
    camera: Camera | None


def make_map(
    path: Path, out: Path, options: MapOptions, settings: MapSettings | None = None, *, quiet: bool = False
) -> DenseMap:
    """Read, map, fuse and write: trajectory.tum, graph.g2o, closures.csv, cloud.ply, map.json and map.png in `out`.

    Raises:
        JaxgeoError: as `read_trajectory`, `open_scans`, `open_rgbd`, `read_rig`, `build_map` and `fuse_points`.
    """
    check_output_folder(out)
    _check(options)
    began_s = time.perf_counter()
    with warnings.catch_warnings(record=True) as caught, Progress(quiet) as progress:
        warnings.simplefilter("always", InputWarning)
        progress.phase("read", path.name)
        inputs = _read(path, options)
        with _Phases(progress) as phases:
            found = build_map(
                inputs.trajectory,
                scans=inputs.scans,
                rgbd=inputs.frames,
                T_body_lidar=inputs.T_body_lidar,
                camera=inputs.camera,
                settings=settings,
                on_progress=phases.say,
            )
        with output_folder(out) as folder:
            write_graph_files(folder, inputs.trajectory, found)
            points = _fuse(folder, inputs, found, options, progress)
            said = [*(str(w.message) for w in caught if issubclass(w.category, InputWarning)), *found.warnings]
            seconds = time.perf_counter() - began_s
            write_map_record(
                folder, path, options, settings or MapSettings(), inputs.trajectory, found, points, said, seconds
            )
    if not quiet:
        for text in said:
            print(f"warning: {text}", file=sys.stderr)
        print(summary(found, points))
        print(out)
    return found


def summary(found: DenseMap, points: dict[str, int]) -> str:
    """What was closed, and what was fused."""
    moved = np.linalg.norm(found.T_map_keyframe[:, :3, 3] - found.keyframes.T_map_body[:, :3, 3], axis=1)
    clouds = ", ".join(f"{n} points in {name}" for name, n in points.items())
    return (
        f"{len(found.keyframes)} keyframes of {len(found.trajectory)} poses; {int(found.accepted.sum())} loop closures "
        f"({len(found.closures)} verified, {sum(found.refused.values())} candidates refused); keyframes moved by up to "
        f"{moved.max():.2f} m; {clouds}"
    )


def _check(options: MapOptions) -> None:
    if options.scans is None and options.frames is None:
        raise InputError("jaxgeo map: nothing to map with; give --scans or --rgbd, or both.")
    if options.frames is not None and options.rig is None:
        raise InputError("jaxgeo map: --rgbd needs --rig, the camera that took the frames.")
    if options.mesh and options.frames is None:
        raise InputError("jaxgeo map: --mesh makes its surface of RGB-D frames; give --rgbd.")
    voxel_m = options.cloud_voxel_m
    if voxel_m is not None and not (np.isfinite(voxel_m) and voxel_m > 0.0):
        raise InputError(f"jaxgeo map: --voxel {voxel_m:g}, expected an edge above 0 m.")


def _read(path: Path, options: MapOptions) -> _Inputs:
    trajectory = read_trajectory(path, options.format, times=options.times)
    scans = frames = camera = None
    if (source := options.scans) is not None:
        scans = open_scans(
            source.path,
            kind=source.kind,  # type: ignore[arg-type]
            stamps=source.stamps,
            rate_hz=source.rate_hz,
            start_s=source.start_s,
            topic=source.topic,
        )
    if (shown := options.frames) is not None:
        frames = open_rgbd(shown.path, stamps=shown.stamps, rate_hz=shown.rate_hz, depth_unit_m=shown.depth_unit_m)
        camera = _camera(options)
    T_body_lidar = body_lidar_of(options.body_lidar)
    return _Inputs(trajectory, scans, frames, np.eye(4) if T_body_lidar is None else T_body_lidar, camera)


def _camera(options: MapOptions) -> Camera:
    assert options.rig is not None
    cameras = read_rig(options.rig).cameras
    name = options.camera or (next(iter(cameras)) if len(cameras) == 1 else None)
    if name not in cameras:
        asked = "several cameras" if name is None else f"no camera {name!r}"
        raise InputError(f"{options.rig}: {asked}; name one with --camera: {', '.join(cameras)}.")
    return cameras[name]


def _fuse(folder: Path, inputs: _Inputs, found: DenseMap, options: MapOptions, progress: Progress) -> dict[str, int]:
    """Write the clouds, and the mesh where it is asked for; points of each."""
    points = {}
    voxel_m = options.cloud_voxel_m
    if inputs.scans is not None:
        with progress.count("scans fused", inputs.scans.n_scans) as bar:
            fusion = FusionSettings(voxel_m=voxel_m or found.scale.voxel_m, max_range_m=found.scale.max_range_m)
            cloud = fuse_scans(inputs.scans, found.trajectory, inputs.T_body_lidar, fusion, bar.done)
        points["cloud.ply"] = write_cloud(folder / "cloud.ply", cloud)
    if inputs.frames is not None and inputs.camera is not None:
        name = "cloud.ply" if inputs.scans is None else "cloud_rgbd.ply"
        camera = frames_camera(inputs.camera, inputs.frames)
        with progress.count("frames fused", inputs.frames.n_frames) as bar:
            fusion = FusionSettings(voxel_m=voxel_m or _RGBD_VOXEL * found.scale.voxel_m)
            cloud = fuse_frames(inputs.frames, found.trajectory, camera, fusion, bar.done)
        points[name] = write_cloud(folder / name, cloud)
        if options.mesh:
            points["mesh.ply"] = _write_mesh(folder / "mesh.ply", inputs.frames, found.trajectory, camera, voxel_m)
    return points


def _write_mesh(
    path: Path, frames: RgbdSource, trajectory: Trajectory, camera: RgbdCamera, voxel_m: float | None
) -> int:
    """Fuse the frames into a surface; its vertices."""
    from jaxgeo.mapping.fusion_open3d import TsdfVolume, write_mesh

    volume = TsdfVolume(camera, voxel_m or _MESH_VOXEL_M)
    for frame, T_map_body in placed_frames(frames, trajectory):
        volume.add(frame, T_map_body)
    mesh = volume.mesh()
    write_mesh(path, mesh)
    return len(mesh.vertices_m)


class _Phases:
    """The phases that mapping reports, each as a bar of its own."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._running = ""
        self._bar: CountBar | None = None

    def __enter__(self) -> "_Phases":
        return self

    def __exit__(self, *failure: object) -> None:
        self._close()

    def say(self, phase: str, done: int, total: int | None) -> None:
        if phase != self._running:
            self._close()
            self._progress.phase(phase)
            self._running = phase
            self._bar = self._progress.count(phase, total)
            self._bar.__enter__()
        if done and self._bar is not None:
            self._bar.done()

    def _close(self) -> None:
        if self._bar is not None:
            self._bar.__exit__(None, None, None)
            self._bar = None
