"""`jaxgeo campaign`: its command line."""

from pathlib import Path
from typing import Annotated

import typer


def campaign(
    sessions: Annotated[
        list[str],
        typer.Argument(help="Configs (YAML), folders or globs of configs, or text files that list them, one a line."),
    ],
    out: Annotated[Path, typer.Option(help="Folder for the results; a campaign begun there is gone on with.")],
    workers: Annotated[int, typer.Option(min=1, max=1024, help="Worker processes on this machine.")] = 2,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDR", help="A Dask scheduler that is there already: tcp://HOST:8786; then no --workers."
        ),
    ] = None,
    retries: Annotated[
        int, typer.Option(min=0, max=100, help="How often a session begins again after its worker was lost.")
    ] = 2,
    time_limit: Annotated[
        float | None, typer.Option(min=1.0, metavar="S", help="Seconds that one session may take.")
    ] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Replace one value of every config: noise.mode=fixed"),
    ] = None,
    keep_outputs: Annotated[
        bool, typer.Option("--keep-outputs", help="Write each session's own files too, as jaxgeo run does.")
    ] = False,
    evaluate: Annotated[
        bool, typer.Option("--evaluate", help="Write each session's own study too, as jaxgeo evaluate does.")
    ] = False,
    pool: Annotated[
        bool, typer.Option("--pool", help="Then learn each again from the noise pooled over the other sessions.")
    ] = False,
    pool_by: Annotated[
        str | None,
        typer.Option(metavar="KEY", help="Config key that tells platforms apart, besides the kind of odometry."),
    ] = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Compute sessions that are done again.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print errors only.")] = False,
) -> None:
    """Georeference many sessions, each by itself, on a Dask cluster; a failed one costs only its own row.

    Exit code: 0 every session done; else, with all tables written, that of the gravest failure: 2 bad input, 3 no
    estimate, a time limit or a lost worker.
    """
    from jaxgeo.cli.campaign import run_campaign
    from jaxgeo.cli.campaign_pass import CampaignAsked

    code = run_campaign(
        CampaignAsked(
            sessions=sessions,
            out=out,
            workers=workers,
            scheduler=scheduler,
            retries=retries,
            limit_s=time_limit,
            overrides=set_ or [],
            evaluate=evaluate,
            outputs=keep_outputs,
            pool=pool or pool_by is not None,
            pool_by=pool_by,
            fresh=fresh,
            quiet=quiet,
        )
    )
    raise typer.Exit(code)
