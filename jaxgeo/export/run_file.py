"""run.json: what was run, on what, with which versions, and which files came out."""

import json
from pathlib import Path, PurePosixPath

from jaxgeo.export.json_text import json_text
from jaxgeo.export.result import SessionResult

RUN_FILE = "run.json"
# Only files of these names are ever deleted when an older run's leftovers are cleared away.
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


def leftovers(out: Path, files: list[str]) -> list[Path]:
    """Files of an older run in this folder that the new run does not write, as the older run.json lists them."""
    try:
        listed = json.loads((out / RUN_FILE).read_text(encoding="utf-8")).get("files", [])
    except (OSError, ValueError, AttributeError):
        return []  # no older run, or one whose list cannot be read: nothing is known to be ours
    old = [PurePosixPath(name) for name in listed if isinstance(name, str) and name not in files]
    return [out / p for p in old if p.name in TRAJECTORY_FILES and len(p.parts) <= 2 and ".." not in p.parts]
