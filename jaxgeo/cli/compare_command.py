"""`jaxgeo compare`: its command line."""

from pathlib import Path
from typing import Annotated

import typer


def compare(
    first: Annotated[Path, typer.Argument(help="A georeferenced cloud (LAS, LAZ, PLY), or the folder of a run.")],
    second: Annotated[Path, typer.Argument(help="Another one, of another session.")],
    out: Annotated[Path, typer.Option(help="Folder for the outputs.")] = Path("out/compare"),
    names: Annotated[str | None, typer.Option(metavar="A,B", help="What to call them; default: their files'.")] = None,
    trajectory: Annotated[
        str | None, typer.Option(metavar="NAME", help="Of runs: the trajectory whose clouds are compared.")
    ] = None,
    voxel: Annotated[
        float | None,
        typer.Option(metavar="M", min=0.0, help="Keep one point a voxel; default 0 (all), 0.05 above 20 million."),
    ] = None,
    cell: Annotated[float, typer.Option(metavar="M", min=0.01, help="Cells of the map of distances.")] = 0.5,
    simulated: Annotated[bool, typer.Option("--simulated", help="Label everything as simulated.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print errors only.")] = False,
) -> None:
    """Compare two clouds, each georeferenced on its own: distances both ways, their map, both clouds in one."""
    from jaxgeo.cli.compare import CompareOptions, compare_files

    compare_files(first, second, out, CompareOptions(names, trajectory, voxel, cell, simulated), quiet)
