"""`jaxgeo rtabmap`: the words of the command."""

from pathlib import Path
from typing import Annotated

import typer


def rtabmap(
    database: Annotated[Path, typer.Argument(help="The RTAB-Map database (.db). It is only read.")],
    out: Annotated[Path, typer.Option(help="Folder for the outputs.")],
    images: Annotated[bool, typer.Option("--images/--no-images", help="Write colour and depth images.")] = True,
    scans: Annotated[bool, typer.Option("--scans/--no-scans", help="Write laser scans.")] = True,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print errors only.")] = False,
) -> None:
    """Take over an RTAB-Map database: trajectories, graph, cameras, images and scans as files of their own."""
    from jaxgeo.cli.rtabmap import import_rtabmap

    import_rtabmap(database, out, images=images, scans=scans, quiet=quiet)
