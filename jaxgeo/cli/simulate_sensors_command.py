"""The command `jaxgeo simulate-sensors`."""

from pathlib import Path
from typing import Annotated

import typer


def simulate_sensors(
    out: Annotated[Path, typer.Option(help="Folder for the recording; with --session both, for two folders.")],
    seed: Annotated[int, typer.Option(min=0, help="Seed of the world and of all random numbers.")] = 0,
    session: Annotated[str, typer.Option(help="The reference study's layout: uav, ugv or both.")] = "uav",
    format_: Annotated[str, typer.Option("--format", help="files, or ros2: a bag (MCAP).")] = "files",
    duration: Annotated[float | None, typer.Option(metavar="S", help="Cut the recording there.")] = None,
    lidar_rate: Annotated[float | None, typer.Option(metavar="HZ", help="Scans a second; default 5.")] = None,
    rings: Annotated[int | None, typer.Option(min=1, max=256, help="Rings of the LiDAR; default 16.")] = None,
    rgbd: Annotated[bool, typer.Option("--rgbd/--no-rgbd", help="Also colour and depth images.")] = True,
    rgbd_rate: Annotated[
        float | None, typer.Option(metavar="HZ", help="Frames a second; default 2, and 3 while a marker is shown.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, max=256, help="Processes that render; default half of the cores.")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print errors only.")] = False,
) -> None:
    """Write a simulated recording from raw sensors: LiDAR scans, RGB-D frames with a marker, truth, and its config."""
    from jaxgeo.cli.simulate_sensors import SensorOptions, simulate_sensors

    options = SensorOptions(seed, session, format_, duration, lidar_rate, rings, rgbd, rgbd_rate, workers)
    for config in simulate_sensors(out, options, quiet):
        if not quiet:
            typer.echo(config)
