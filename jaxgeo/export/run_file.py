"""run.json: what was run, on what, with which versions, and which files came out."""

import json
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

from jaxgeo.export.json_text import json_text
from jaxgeo.export.result import SessionResult

RUN_FILE = "run.json"
# Of a run's own files those that another run may lack.
TRAJECTORY_FILES = ("trajectory.tum", "trajectory_grid.csv", "trajectory.geojson", "anchors.csv")


def run_text(result: SessionResult, files: list[str], not_written: dict[str, str]) -> str:
    """The run's own facts, the frame, the resolved config, the files written, and why others were not."""
    return json_text(
        {
            **result.run,
            "session": result.name,
            "simulated": result.simulated,
            "frame": result.frame.as_dict(),
            "config": result.config,
            "warnings": {name: t.warnings for name, t in result.trajectories.items()},
            "files": files,
            "not_written": not_written,
        }
    )


def leftovers(
    out: Path, files: Sequence[str], *, record: str = RUN_FILE, ours: Sequence[str] = TRAJECTORY_FILES
) -> list[Path]:
    """Files of an older run in this folder that the new run does not write, as the older run's `record` lists them.

    Args:
        files: what the new run writes.
        ours: names that a run may have given; a record that was tampered with makes no other file go.
    """
    try:
        listed = json.loads((out / record).read_text(encoding="utf-8"))["files"]
        old = [PurePosixPath(name) for name in listed if isinstance(name, str) and name not in files]
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return []  # no older run, or one whose list cannot be read: nothing is known to be ours
    return [out / p for p in old if p.name in ours and len(p.parts) <= 2 and ".." not in p.parts]
