"""`jaxgeo study ...`: studies on simulated sessions."""

from pathlib import Path
from typing import Annotated

import typer

study = typer.Typer(no_args_is_help=True, help="Studies on simulated sessions.")


@study.command()
def paper(
    out: Annotated[Path, typer.Option(help="Folder for the outputs.")] = Path("out/study-paper"),
    seed: Annotated[int, typer.Option(min=0, help="Seed of all random numbers.")] = 0,
    orthophoto: Annotated[
        Path | None, typer.Option(exists=True, dir_okay=False, help="GeoTIFF to be drawn under the maps.")
    ] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Replace one value of both configs: evaluate.subsets=20"),
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print errors only.")] = False,
) -> None:
    """The reference study made anew on two simulated sessions: every table beside its own, figures, one report."""
    from jaxgeo.cli.study_paper import study_paper

    study_paper(out, seed, orthophoto, set_ or [], quiet)


@study.command()
def montecarlo(
    out: Annotated[Path, typer.Option(help="Folder for the results; a study begun there is gone on with.")],
    draws: Annotated[int, typer.Option(min=1, help="Simulated sessions, over all regimes.")] = 1000,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first session; the next ones follow.")] = 0,
    regimes: Annotated[
        str, typer.Option(help="In which ways the odometry errs, in turn.")
    ] = "white,biased,misassumed,gauss-markov,heavy-tailed,scale",
    poses: Annotated[int, typer.Option(min=64, help="Poses of a session.")] = 1829,
    chunk: Annotated[int | None, typer.Option(min=1, help="Sessions a file; default by the devices.")] = None,
    devices: Annotated[
        int | None, typer.Option(min=1, help="Devices to use; default all, and on a CPU one for each core.")
    ] = None,
    batch: Annotated[
        int | None, typer.Option(min=1, help="Sessions a device works on in one call; default by the devices.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=0, help="Processes that simulate; default half of the cores.")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print errors only.")] = False,
) -> None:
    """Learned odometry noise on many simulated sessions whose noise is known: held out, with intervals, resumable."""
    from jaxgeo.cli.montecarlo import Asked, study_montecarlo

    study_montecarlo(Asked(out, draws, seed, regimes, poses, chunk, devices, batch, workers, quiet))


@study.command()
def placement(
    out: Annotated[Path, typer.Option(help="Folder for the outputs.")] = Path("out/study-placement"),
    sessions: Annotated[int, typer.Option(min=2, help="Simulated sessions of each layout and noise.")] = 60,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first session; the next ones follow.")] = 0,
    regimes: Annotated[str, typer.Option(help="In which ways the odometry errs.")] = "white,biased,gauss-markov",
    quiet: Annotated[bool, typer.Option("--quiet", help="Print errors only.")] = False,
) -> None:
    """The reference study's findings on the number and the places of anchors: predicted, and achieved in simulation."""
    from jaxgeo.cli.study_placement import study_placement

    study_placement(out, sessions, seed, regimes, quiet)
