"""`jaxgeo warp`: its command line."""

from pathlib import Path
from typing import Annotated

import typer


def warp(
    cloud: Annotated[Path, typer.Argument(help="The cloud (LAS, LAZ, PLY), in the frame of --before.")],
    before: Annotated[Path, typer.Option(help="The trajectory that the cloud was made with.")],
    after: Annotated[
        Path,
        typer.Option(
            help="The same trajectory corrected: the folder of a run, its trajectory.tum or trajectory_grid.csv, or "
            "any TUM file in grid coordinates."
        ),
    ],
    out: Annotated[
        Path | None, typer.Option(help="The cloud to write (.laz, .las, .ply); default CLOUD_grid.laz beside it.")
    ] = None,
    by: Annotated[
        str | None,
        typer.Option(
            help="What leads from a point to its pose: stamp, index or nearest; default the first of these that the "
            "cloud has."
        ),
    ] = None,
    crs: Annotated[
        str | None,
        typer.Option(metavar="EPSG:CODE", help="Of --after, where it does not say; or with a height system added."),
    ] = None,
    trajectory: Annotated[str | None, typer.Option(metavar="NAME", help="Of a run with several.")] = None,
    format_: Annotated[str, typer.Option("--format", help="Of --before, as in a config.")] = "tum",
    times: Annotated[Path | None, typer.Option(help="Stamps of --before, where its format has none.")] = None,
    rate: Annotated[float | None, typer.Option(metavar="HZ", help="Poses a second of --before, likewise.")] = None,
    scale: Annotated[
        float, typer.Option(metavar="S", help="Metres in a unit of the cloud: for maps of one camera.")
    ] = 1.0,
    hold: Annotated[
        float | None,
        typer.Option(
            metavar="S", min=0.0, help="Seconds that the first and last correction hold; default a step, at least 0.2."
        ),
    ] = None,
    drop_outside: Annotated[
        bool, typer.Option("--drop-outside", help="Leave out points that no pose saw, instead of refusing.")
    ] = False,
    chunk: Annotated[int, typer.Option(min=1000, help="Points in memory at once.")] = 1_000_000,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print errors only.")] = False,
) -> None:
    """Carry a cloud with its trajectory's correction, every point with the pose that saw it, into the grid."""
    from jaxgeo.cli.warp import WarpOptions, warp_cloud

    options = WarpOptions(out, by, crs, trajectory, format_, times, rate, scale, hold, drop_outside, chunk)
    warp_cloud(cloud, before, after, options, quiet)
