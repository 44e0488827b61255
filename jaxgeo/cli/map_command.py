"""`jaxgeo map`: the words of the command."""

from pathlib import Path
from typing import Annotated

import typer


def map_(
    trajectory: Annotated[Path, typer.Argument(help="The odometry: a trajectory of any kind.")],
    scans: Annotated[Path | None, typer.Option(help="LiDAR scans: a folder, a packed .npz or a ROS bag.")] = None,
    scans_kind: Annotated[str | None, typer.Option(help="folder, packed or bag; default: seen from the path.")] = None,
    stamps: Annotated[Path | None, typer.Option(help="Stamps of a folder's or a packed file's scans.")] = None,
    rate: Annotated[float | None, typer.Option(metavar="HZ", help="Scans a second, where none has a stamp.")] = None,
    start: Annotated[float | None, typer.Option(metavar="S", help="Stamp of the first scan.")] = None,
    topic: Annotated[str | None, typer.Option(help="The bag's topic of point clouds.")] = None,
    body_lidar: Annotated[
        str | None,
        typer.Option(
            "--T-body-lidar", metavar="X,Y,Z,QX,QY,QZ,QW", help="Pose of the LiDAR on the body; default: same."
        ),
    ] = None,
    rgbd: Annotated[Path | None, typer.Option(help="RGB-D frames: a folder or a ROS bag.")] = None,
    rig: Annotated[Path | None, typer.Option(help="The cameras (YAML): needed for RGB-D frames.")] = None,
    camera: Annotated[str | None, typer.Option(help="The rig's camera that took them; default its only one.")] = None,
    rgbd_stamps: Annotated[Path | None, typer.Option(help="Stamps of the RGB-D frames of a folder.")] = None,
    rgbd_rate: Annotated[float | None, typer.Option(metavar="HZ", help="RGB-D frames a second.")] = None,
    depth_unit: Annotated[float, typer.Option(metavar="M", help="One step of the depth images.")] = 0.001,
    format_: Annotated[str, typer.Option("--format", help="Of the trajectory: tum, euroc, kitti or g2o.")] = "tum",
    times: Annotated[Path | None, typer.Option(help="Stamps of a kitti or g2o trajectory.")] = None,
    odometry: Annotated[str, typer.Option(help="Kind of the odometry: lidar, vio, wheel or mono.")] = "lidar",
    out: Annotated[Path, typer.Option(help="Folder for the outputs.")] = Path("out/map"),
    voxel: Annotated[float | None, typer.Option(metavar="M", help="Of the fused cloud; default by the scene.")] = None,
    keyframe: Annotated[
        float | None, typer.Option(metavar="M", help="Distance between keyframes; default by the scene.")
    ] = None,
    refine: Annotated[
        bool, typer.Option("--refine/--no-refine", help="Let neighbouring scans check the odometry first.")
    ] = True,
    mesh: Annotated[bool, typer.Option("--mesh", help="Write a surface of the RGB-D frames too (mesh.ply).")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print errors only.")] = False,
) -> None:
    """Close the loops of a trajectory with LiDAR scans or RGB-D frames, and fuse what they saw into a cloud."""
    from jaxgeo.cli.map import FrameSource, MapOptions, make_map
    from jaxgeo.cli.odometry import Source
    from jaxgeo.mapping.map_settings import MapSettings

    options = MapOptions(
        scans=None if scans is None else Source(scans, scans_kind, stamps, rate, start, topic),
        body_lidar=body_lidar,
        frames=None if rgbd is None else FrameSource(rgbd, rgbd_stamps, rgbd_rate, depth_unit),
        rig=rig,
        camera=camera,
        format=format_,
        times=times,
        cloud_voxel_m=voxel,
        mesh=mesh,
    )
    make_map(trajectory, out, options, MapSettings(odometry=odometry, keyframe_m=keyframe, refine=refine), quiet=quiet)
