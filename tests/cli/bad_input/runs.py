"""Runs of the small session, and what lies in its folder."""

from pathlib import Path

from jaxgeo.cli.main import main


def snapshot(folder: Path) -> dict[str, bytes | None]:
    """Every file's bytes and every folder, hidden ones too."""
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


def run(session: Path, name: str = "poses", *overrides: str, out: str = "out", quiet: bool = True) -> int:
    """`jaxgeo run`; the check of its anchors, half a minute of compiling where they are wrong, has tests of its own."""
    options = [word for override in ("evaluate.check=false", *overrides) for word in ("--set", override)]
    options += ["--quiet"] * quiet
    return main(["run", str(session / f"{name}.yaml"), "--out", str(session / out), *options])
