"""All files of one session, written together or not at all."""

from pathlib import Path

from jaxgeo.errors import ConfigError
from jaxgeo.export.anchor_file import anchors_text
from jaxgeo.export.geojson_file import NO_DATUM, geojson_text
from jaxgeo.export.json_text import json_text
from jaxgeo.export.metrics import metrics_dict
from jaxgeo.export.noise_file import noise_text
from jaxgeo.export.result import SessionResult
from jaxgeo.export.run_file import RUN_FILE, leftovers, run_text
from jaxgeo.export.trajectory_files import grid_text, tum_text
from jaxgeo.io.atomic import output_folder


def write_session(result: SessionResult, out: str | Path) -> list[Path]:
    """Write the session's files into the folder `out`; returns their paths, `run.json` last.

    metrics.json, noise.json, report.html and run.json lie in `out`; the files of a trajectory lie beside them, or,
    where there are several trajectories, in a folder of the trajectory's name. Everything is computed before the first
    file is put in place, so a failure leaves `out` as it was. Files of an older run that this one does not write are
    removed.

    Raises:
        ConfigError: a trajectory's name cannot name a folder.
        InputError: `out` cannot be written to.
    """
    out = Path(out)
    texts, not_written = session_texts(result)
    names = [*texts, RUN_FILE]
    texts[RUN_FILE] = run_text(result, names, not_written)
    stale = leftovers(out, names)
    with output_folder(out) as temporary:
        for name, text in texts.items():
            path = temporary / name
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8", newline="\n")
    for path in stale:
        path.unlink(missing_ok=True)
        if path.parent != out and path.parent.is_dir() and not any(path.parent.iterdir()):
            path.parent.rmdir()
    return [out / name for name in names]


def session_texts(result: SessionResult) -> tuple[dict[str, str], dict[str, str]]:
    """The text of every file but run.json by its name in the output folder, and why any were left out."""
    from jaxgeo.export.report import report_html  # matplotlib takes half a second to import

    texts, not_written = {}, {}
    for name in result.trajectories:
        folder = "" if len(result.trajectories) == 1 else f"{folder_name(name)}/"
        texts[f"{folder}trajectory.tum"] = tum_text(result, name)
        texts[f"{folder}trajectory_grid.csv"] = grid_text(result, name)
        texts[f"{folder}anchors.csv"] = anchors_text(result, name)
        if not result.frame.has_datum:
            not_written[f"{folder}trajectory.geojson"] = NO_DATUM
        else:
            texts[f"{folder}trajectory.geojson"] = geojson_text(result, name)
    texts["metrics.json"] = json_text(metrics_dict(result))
    texts["noise.json"] = noise_text(result)
    texts["report.html"] = report_html(result)
    return texts, not_written


def folder_name(name: str) -> str:
    """The trajectory's name, once it is known to name a folder inside the output folder and nothing else.

    Raises:
        ConfigError: it is empty, hidden, or holds a path separator or another character that file systems refuse.
    """
    if not name or name.startswith(".") or any(c in '/\\:*?"<>|' or not c.isprintable() for c in name):
        raise ConfigError(
            f"trajectories: the name {name!r} cannot be a folder's name, and each of several trajectories is "
            "written to its own; use letters, digits, '-' and '_'."
        )
    return name
