"""`jaxgeo detect --tune`: fit the colour range to a few labelled images, and show what it gained."""

import dataclasses
import json
from pathlib import Path

import typer

from jaxgeo.cli.detection_files import write_picture
from jaxgeo.detect.mask import BLUE, GREEN, RED, HsvRange
from jaxgeo.detect.tune import Tuned, read_labelled, tune_range
from jaxgeo.errors import ConfigError
from jaxgeo.export.tuned_picture import tuned_picture
from jaxgeo.io.atomic import check_output_folder, write_lines

_PRESETS = {"green": GREEN, "red": RED, "blue": BLUE}


def tune_folder(folder: Path, out: Path | None, hsv: str | None, quiet: bool) -> None:
    """Fit a range to the labelled images of a folder; writes tune.json and tune.png into `out`.

    Raises:
        JaxgeoError: nothing labelled, labels that do not fit, a start that is no range.
    """
    target = Path("out") / "tune" if out is None else out
    check_output_folder(target)
    start = _start(hsv)
    frames = read_labelled(folder)
    tuned = tune_range(frames, start)
    target.mkdir(parents=True, exist_ok=True)
    write_picture(target / "tune.png", tuned_picture(frames, start, tuned))
    write_lines(target / "tune.json", [json.dumps(_facts(start, tuned), indent=2)])
    if not quiet:
        for line in _words(tuned, target):
            typer.echo(line)


def _start(hsv: str | None) -> HsvRange:
    if hsv is None:
        return GREEN
    if hsv.lower() in _PRESETS:
        return _PRESETS[hsv.lower()]
    cells = hsv.split(",")
    if len(cells) != 6 or not all(cell.strip().isdecimal() for cell in cells):
        raise ConfigError(
            f"--hsv {hsv!r}: expected green, red, blue, or six whole numbers: lowest H, S, V, highest H, S, V."
        )
    numbers = [int(cell) for cell in cells]
    return HsvRange((numbers[0], numbers[1], numbers[2]), (numbers[3], numbers[4], numbers[5]))


def _facts(start: HsvRange, tuned: Tuned) -> dict:
    return {
        "start": dataclasses.asdict(start),
        "hsv": dataclasses.asdict(tuned.hsv),
        "improved": tuned.improved,
        "overlap_before": tuned.iou_before,
        "overlap_after": tuned.iou_after,
        "by_image": {name: {"before": a, "after": b} for name, (a, b) in tuned.frame_iou.items()},
    }


def _words(tuned: Tuned, target: Path) -> list[str]:
    low, high = list(tuned.hsv.low), list(tuned.hsv.high)
    said = (
        f"overlap with the labels (intersection over union): {100 * tuned.iou_before:.1f} % before, "
        f"{100 * tuned.iou_after:.1f} % after"
        if tuned.improved
        else f"no range overlapped better than the start ({100 * tuned.iou_before:.1f} %)"
    )
    return [
        said,
        "for the config, under sightings:",
        "  mask:",
        f"    hsv: {{low: {low}, high: {high}}}",
        f"pictures: {target / 'tune.png'}",
    ]
