"""The georeferenced clouds of a run: fused along the mapped trajectory, carried with its correction."""

from pathlib import Path

from jaxgeo.cli.computed import rgbd_camera_of, rgbd_source, scan_source, sensor_matrix
from jaxgeo.cli.progress import Progress
from jaxgeo.cli.rig import rig_of
from jaxgeo.config.inputs import ComputedTrajectoryInput
from jaxgeo.config.schema import SessionConfig
from jaxgeo.data import Trajectory
from jaxgeo.export.result import SessionResult, TrajectoryResult
from jaxgeo.io.clouds.chunk import CloudChunk
from jaxgeo.io.clouds.writer import cloud_writer
from jaxgeo.mapping.carry import carry, places_by_stamp, pose_corrections
from jaxgeo.mapping.fused_columns import fused_columns
from jaxgeo.mapping.fusion import FusedCloud, FusionSettings
from jaxgeo.mapping.map_cloud import fuse_frames, fuse_scans
from jaxgeo.mapping.rgbd_camera import frames_camera

# Depth cameras are exact near by: their cloud is this much finer than the scans'.
_RGBD_VOXEL = 0.5


def write_session_clouds(config: SessionConfig, result: SessionResult, out: Path, progress: Progress) -> dict[str, int]:
    """Write cloud_NAME and rgbd_NAME of every mapped trajectory; the points of each file.

    Raises:
        InputError: the sensors' files have become unusable.
    """
    form, written = config.mapping.clouds, {}
    if form == "none":
        return written
    for name, source in config.trajectories.items():
        if not isinstance(source, ComputedTrajectoryInput) or source.computed != "mapping":
            continue
        trajectory = result.trajectories[name]
        for kind, fused in _clouds(config, trajectory.measured, progress).items():
            # A site frame has no system that LAS could name.
            file = f"{kind}_{name}.{'ply' if result.frame.crs == 'local' else form}"
            progress.phase("cloud", file)
            _write(out / file, fused, trajectory, result)
            written[file] = len(fused)
    return written


def _clouds(config: SessionConfig, trajectory: Trajectory, progress: Progress) -> dict[str, FusedCloud]:
    """What the sensors saw along a trajectory, by sensor."""
    found = {}
    voxel_m = config.mapping.voxel_m
    if (scans := config.scans) is not None:
        progress.phase("fuse", "scans")
        source = scan_source(scans)
        with progress.count("scans fused", source.n_scans) as bar:
            settings = FusionSettings(voxel_m=voxel_m, max_range_m=scans.max_range_m)
            found["cloud"] = fuse_scans(source, trajectory, sensor_matrix(scans.T_body_lidar), settings, bar.done)
    if (rgbd := config.rgbd) is not None:
        progress.phase("fuse", "RGB-D frames")
        frames = rgbd_source(rgbd)
        camera = frames_camera(rgbd_camera_of(config, rig_of(config)), frames)
        with progress.count("frames fused", frames.n_frames) as bar:
            settings = FusionSettings(voxel_m=_RGBD_VOXEL * voxel_m)
            found["rgbd"] = fuse_frames(frames, trajectory, camera, settings, bar.done)
    return found


def _write(path: Path, fused: FusedCloud, trajectory: TrajectoryResult, result: SessionResult) -> None:
    """Every point moved with the pose that saw it."""
    corrections = pose_corrections(trajectory.measured, trajectory.corrected)
    place, inside = places_by_stamp(corrections, fused.stamp_s)
    assert inside.all()  # fused from this very trajectory's poses
    columns = fused_columns(fused)
    types = {name: values.dtype for name, values in columns.items()}
    crs = None if result.frame.crs == "local" else result.frame.crs
    with cloud_writer(path, types, result.frame.origin_enh_m, crs) as writer:
        writer.append(CloudChunk(carry(corrections, fused.points_m, place), columns))
