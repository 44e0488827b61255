"""`jaxgeo check`: its command line."""

from pathlib import Path
from typing import Annotated

import typer

# As of an estimate that is not to be had: the inputs contradict each other.
FAULT_FOUND = 3


def check(
    config: Annotated[Path, typer.Argument(help="The session's config (YAML), as for jaxgeo run.")],
    out: Annotated[Path | None, typer.Option(help="Folder for check.json; default out/NAME.")] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Replace one value of the config: visits.order=[A, B, C, A]"),
    ] = None,
    strict: Annotated[bool, typer.Option("--strict", help="Exit code 3 where a fault is found.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print errors only.")] = False,
) -> None:
    """Look for wrong anchors: labels mixed up, a marker or a survey point moved, a visit missed or extra."""
    from jaxgeo.cli.check import check_config

    fault = check_config(config, out, set_ or [], quiet)
    if fault and strict:
        raise typer.Exit(FAULT_FOUND)
