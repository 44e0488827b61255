"""`jaxgeo place` and `jaxgeo predict`: their command lines."""

from pathlib import Path
from typing import Annotated

import typer

_CONFIG = typer.Argument(help="The placement's config (YAML): path, noise, what anchors are possible.")
_SET = typer.Option("--set", metavar="KEY=VALUE", help="Replace one value of the config: anchors.count=5")
_DUMP = typer.Option("--dump-config", help="Print the whole config, defaults written out, and stop.")
_QUIET = typer.Option("--quiet", help="Print errors only.")


def place(
    config: Annotated[Path, _CONFIG],
    out: Annotated[Path | None, typer.Option(help="Folder for the outputs; default out/NAME.")] = None,
    set_: Annotated[list[str] | None, _SET] = None,
    dump_config: Annotated[bool, _DUMP] = False,
    quiet: Annotated[bool, _QUIET] = False,
) -> None:
    """Say, before a mission, where its anchors should stand, and how accurate every place of its path will be."""
    from jaxgeo.cli.place import place_config, print_placement_config

    if dump_config:
        print_placement_config(config, set_ or [])
    else:
        place_config(config, out, set_ or [], quiet)


def predict(
    config: Annotated[Path, _CONFIG],
    out: Annotated[Path | None, typer.Option(help="Folder for the outputs; default out/NAME/predicted.")] = None,
    set_: Annotated[list[str] | None, _SET] = None,
    dump_config: Annotated[bool, _DUMP] = False,
    quiet: Annotated[bool, _QUIET] = False,
) -> None:
    """Predict the accuracy that anchors at given places (the config's layout) will give along a path."""
    from jaxgeo.cli.place import predict_config, print_placement_config

    if dump_config:
        print_placement_config(config, set_ or [])
    else:
        predict_config(config, out, set_ or [], quiet)
