"""`jaxgeo odometry`: the words of the command."""

from pathlib import Path
from typing import Annotated

import typer


def odometry(
    source: Annotated[Path, typer.Argument(help="LiDAR scans: a folder, a packed .npz, or a ROS bag.")],
    out: Annotated[Path, typer.Option(help="Folder for the outputs.")] = Path("out/odometry"),
    kind: Annotated[
        str | None, typer.Option(help="What SOURCE is: folder, packed or bag; default: seen from it.")
    ] = None,
    stamps: Annotated[Path | None, typer.Option(help="Stamps of the scans: one a line, or a table with files.")] = None,
    rate: Annotated[float | None, typer.Option(metavar="HZ", help="Scans a second, instead of stamps.")] = None,
    start: Annotated[float | None, typer.Option(metavar="S", help="Stamp of the first scan with --rate.")] = None,
    topic: Annotated[
        str | None, typer.Option(help="Of a bag: the topic of point clouds; default: its only one.")
    ] = None,
    method: Annotated[str, typer.Option(help="gicp (voxelised GICP) or kiss (KISS-ICP).")] = "gicp",
    deskew: Annotated[
        bool, typer.Option("--deskew/--no-deskew", help="Straighten scans whose points carry times.")
    ] = True,
    body_lidar: Annotated[
        str | None,
        typer.Option(
            "--T-body-lidar", metavar="X,Y,Z,QX,QY,QZ,QW", help="The sensor's pose in the body; default: the same."
        ),
    ] = None,
    min_range: Annotated[float | None, typer.Option(metavar="M", help="Leave out points nearer than this.")] = None,
    max_range: Annotated[float | None, typer.Option(metavar="M", help="Leave out points farther than this.")] = None,
    skip_unreadable: Annotated[
        bool, typer.Option("--skip-unreadable", help="Leave out scans that cannot be read, counted, with a warning.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print errors only.")] = False,
) -> None:
    """A drifting trajectory from LiDAR scans alone: each scan is matched with the map of those before it."""
    from jaxgeo.cli.odometry import Source, body_lidar_of, run_odometry
    from jaxgeo.odometry.settings import OdometrySettings

    settings = OdometrySettings(
        method=method,  # type: ignore[arg-type]  (checked there)
        deskew=deskew,
        min_range_m=min_range,
        max_range_m=max_range,
    )
    where = Source(source, kind, stamps, rate, start, topic, skip_unreadable)
    run_odometry(where, out, settings, body_lidar_of(body_lidar), quiet=quiet)
