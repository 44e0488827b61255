"""The files of a plan, written together or not at all."""

from pathlib import Path

from eval.figures.placement_map import placement_map
from eval.placement_report.page import placement_html
from eval.placement_report.plan_text import plan_text
from eval.placement_report.point_files import anchors_csv, anchors_geojson
from eval.placement_report.report import PlacementReport, count_of
from jaxgeo.export.geojson_file import NO_DATUM
from jaxgeo.export.run_file import leftovers
from jaxgeo.io.atomic import output_folder

PLAN, PAGE = "plan.json", "placement.html"
TABLE, POINTS, PICTURE = "anchors.csv", "anchors.geojson", "placement.png"


def write_placement(report: PlacementReport, out: Path) -> list[Path]:
    """Write plan.json and placement.html, and anchors.csv, anchors.geojson and placement.png beside them.

    Where there are several numbers of anchors, those three lie in a folder for each, `count_4` and so on. Files of an
    older plan in this folder that this one does not write are removed.

    Raises:
        InputError: `out` cannot be written to.
    """
    files: dict[str, str | bytes] = {}
    not_written: dict[str, str] = {}
    for answer in report.answers:
        folder = "" if len(report.answers) == 1 else f"count_{count_of(answer.chosen)}/"
        files[f"{folder}{TABLE}"] = anchors_csv(report, answer)
        if report.frame.has_datum:
            files[f"{folder}{POINTS}"] = anchors_geojson(report, answer)
        else:
            not_written[f"{folder}{POINTS}"] = NO_DATUM
        files[f"{folder}{PICTURE}"] = placement_map(report, answer).png()
    files[PAGE] = placement_html(report)
    files[PLAN] = plan_text(report, [*files, PLAN], not_written)
    stale = leftovers(out, list(files), record=PLAN, ours=(TABLE, POINTS, PICTURE))
    with output_folder(out) as temporary:
        for name, content in files.items():
            path = temporary / name
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8"))
    for path in stale:
        path.unlink(missing_ok=True)
        if path.parent != out and path.parent.is_dir() and not any(path.parent.iterdir()):
            path.parent.rmdir()
    return [out / name for name in files]
