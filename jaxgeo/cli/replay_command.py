"""`jaxgeo replay`: its command line."""

from pathlib import Path
from typing import Annotated

import typer


def replay(
    config: Annotated[Path, typer.Argument(help="The session's config (YAML), as for jaxgeo run.")],
    out: Annotated[Path | None, typer.Option(help="Folder for the outputs; default out/NAME/replay.")] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Replace one value of the config: visits.gap_s=3"),
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(
            metavar="X", help="X seconds of the recording a second, 1 as it was; default: as fast as it goes."
        ),
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print errors only.")] = False,
) -> None:
    """Play a recorded session as if it came live: what would have been known of the pose, when, and how fast."""
    from jaxgeo.cli.replay import replay_config

    replay_config(config, out, set_ or [], rate, quiet)
