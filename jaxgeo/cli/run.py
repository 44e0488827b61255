"""`jaxgeo run`: one config in, one folder of results out."""

import sys
from collections.abc import Sequence
from pathlib import Path

from jaxgeo.cli.progress import Progress
from jaxgeo.config import dump_config, load_config
from jaxgeo.config.inputs import ComputedTrajectoryInput
from jaxgeo.io.atomic import check_output_folder


def print_config(path: Path, overrides: Sequence[str]) -> None:
    """Print the resolved config."""
    sys.stdout.write(dump_config(load_config(path, overrides)))


def run_config(path: Path, out: Path | None, overrides: Sequence[str], quiet: bool) -> None:
    """Georeference one session and write its outputs.

    Raises:
        JaxgeoError: bad input, or an estimate that is not to be had; nothing is written then.
    """
    config = load_config(path, overrides)
    out = Path("out") / config.name if out is None else out
    check_output_folder(out)

    from jaxgeo.cli.session import run_session
    from jaxgeo.export import write_session

    keep_compiled_programs()
    with Progress(quiet) as progress:
        result = run_session(config, progress, out=out, check=True)
        progress.phase("write", str(out))
        write_session(result, out)
        points = {}
        if any(isinstance(source, ComputedTrajectoryInput) for source in config.trajectories.values()):
            from jaxgeo.cli.session_clouds import write_session_clouds

            points = write_session_clouds(config, result, out, progress)
    if not quiet:
        label = " (simulated data)" if result.simulated else ""
        for name, trajectory in result.trajectories.items():
            for warning in trajectory.warnings:
                print(f"warning: {name}: {warning}", file=sys.stderr)
            for sentence in (trajectory.corrections or {}).get("sentences", ()):
                print(f"{name}{label}: {sentence}")
        for file, count in points.items():
            print(f"{out / file}: {count:,} points{label}")
        print(f"{config.name}{label}: {out / 'report.html'}")


def keep_compiled_programs() -> None:
    """Compile once for all runs; where that cannot be, say so."""
    from jaxgeo.precision import enable_compilation_cache

    try:
        enable_compilation_cache()
    except OSError as error:  # a run without it is slower, not wrong
        print(f"warning: compiled programs are not kept: {error}; set JAXGEO_CACHE to a folder", file=sys.stderr)
