"""report.html: what was done and how good it is, for a surveyor who never saw the code; one file, no network."""

import json
from collections.abc import Iterator, Sequence

from jaxgeo.export.geojson_file import NO_DATUM
from jaxgeo.export.interactive import interactive_scripts
from jaxgeo.export.json_text import json_ready
from jaxgeo.export.number_words import decimal
from jaxgeo.export.report_page import bullets, details, escape, facts, page, paragraph
from jaxgeo.export.report_tables import comparison_table, flat_pairs
from jaxgeo.export.result import SessionResult
from jaxgeo.export.small_numbers import small_numbers_box
from jaxgeo.export.trajectory_section import trajectory_section
from jaxgeo.export.verdict import verdict
from jaxgeo.export.what_was_done import what_was_done

WORDS = {
    "Location, visit, anchor": "A location is a surveyed point. A visit is one stay at it, in which its marker was "
    "seen; a later visit to the same location is called a revisit. An anchor is a visit tied to its location.",
    "One-time similarity": "The trajectory moved, turned and, where allowed, scaled once, as a whole, onto the "
    "surveyed points. Drift within the trajectory stays.",
    "Corrected": "After that, every pose was adjusted: the motions between poses and the anchors were weighted by "
    "their standard deviations and brought into the best agreement (least squares).",
    "Held out": "A location and all its visits are left out of everything: the similarity, the noise values and the "
    "adjustment. The distance of its predicted marker from the survey is the honest error. Residuals with all anchors "
    "in are small by construction and prove nothing.",
    "1 sigma, 95 % ellipse": "The predicted standard deviation, and the region that should hold 95 of 100 errors.",
    "NEES": "The squared error in units of its predicted covariance. Its mean should be near 3; a much larger value "
    "says that the predicted uncertainty is too small.",
    "Fixed noise, learned noise": "How much the odometry drifts decides how far each motion between poses may give "
    "way. Fixed noise takes values that are usual for its kind; learned noise takes them from the contradictions "
    "between this session's own anchors, again in every fold. Where the anchors cannot tell, it stays near the usual.",
    "Spread": "RMS distance of a visit's single sightings from their centre.",
}


def report_html(result: SessionResult, extra_sections: Sequence[str] = ()) -> str:
    """The whole report as one HTML document.

    `extra_sections`: HTML that stands after the trajectories, each part with its own heading; interactive figures
    (`jaxgeo.export.interactive.interactive_figure`) work in it, unless the config's `report.interactive` is false.
    """
    drawn = interactive(result)
    body = [*head(result), *summary(result), *method(result)]
    for trajectory in result.trajectories.values():
        body += trajectory_section(result, trajectory, interactive=drawn)
    body += [*extra_sections, *glossary(), *run_section(result)]
    title = f"{'SIMULATED: ' if result.simulated else ''}{result.name}: georeferencing report"
    return page(title, body, interactive_scripts() if drawn else ())


def interactive(result: SessionResult) -> bool:
    """What the config says of interactive figures; without a word of it they are there."""
    return bool((result.config.get("report") or {}).get("interactive", True))


def head(result: SessionResult) -> Iterator[str]:
    if result.simulated:
        yield '<div class="banner">SIMULATED DATA: nothing in this report was measured</div>'
    yield f"<h1>{escape(result.name)}: georeferencing report</h1>"
    n, frame = len(result.trajectories), result.frame
    where = f"{frame.crs} ({frame.crs_name})" if frame.has_datum else "the site frame, which has no datum"
    used = {location for t in result.trajectories.values() for location in t.anchors.location}
    yield paragraph(
        f"{n} {'trajectory' if n == 1 else 'trajectories'} tied to {len(used)} of {len(result.survey_enh_m)} surveyed "
        f"points; coordinates in {where}.",
        "lead",
    )


def summary(result: SessionResult) -> Iterator[str]:
    """The verdicts, the warnings, and the comparison of several trajectories."""
    for name, trajectory in result.trajectories.items():
        found = verdict(trajectory)
        lines = "".join(paragraph(s) for s in (what_was_done(result, trajectory), *found.sentences))
        yield f'<div class="verdict {found.level}"><p class="name">{escape(name)}</p>{lines}</div>'
    yield from small_numbers_box(result)
    warnings = [f"{name}: {w}" for name, t in result.trajectories.items() for w in t.warnings]
    if warnings:
        yield f'<div class="warnings"><strong>Warnings</strong>{bullets(warnings)}</div>'
    if len(result.trajectories) > 1:
        yield comparison_table(result)


def method(result: SessionResult) -> Iterator[str]:
    """What was done, in which coordinates."""
    yield "<h2>What was done</h2>"
    yield paragraph(
        "Each trajectory was first fitted to the surveyed points as a whole (one-time similarity), then corrected pose "
        "by pose with the surveyed points as anchors. How much the odometry may give way between them was "
        f"{how_noise_came(result)}. Errors called 'held out' come from repeating all of this with every location left "
        "out in turn."
    )
    yield facts("Coordinates: printed figures and trajectory.tum have the origin taken off", frame_facts(result))
    if not result.frame.has_datum:
        yield paragraph(f"trajectory.geojson was not written: {NO_DATUM}.", "note")


def how_noise_came(result: SessionResult) -> str:
    """Learned or fixed, of the whole session."""
    learned = any("learned" in t.noise for t in result.trajectories.values())
    return "learned from the anchors themselves" if learned else "fixed beforehand"


def frame_facts(result: SessionResult) -> Iterator[tuple[str, str]]:
    """The coordinate system in a surveyor's words."""
    frame = result.frame
    yield "Coordinate system", frame.crs_name if not frame.has_datum else f"{frame.crs}, {frame.crs_name}"
    yield "Order and unit here", "easting E, northing N, height h, in metres"
    yield "Origin E, N, h", ", ".join(f"{x:.3f}".rstrip("0").rstrip(".") for x in frame.origin_enh_m)
    yield "Height", frame.height
    if frame.grid_scale is not None:
        yield "Grid scale at the origin", f"{decimal((frame.grid_scale - 1.0) * 1e6, 1)} ppm (not applied)"
    if frame.has_datum:
        known = frame.operation_accuracy_m is not None
        accuracy = f"accuracy {frame.operation_accuracy_m:g} m" if known else "accuracy unknown"
        yield "To WGS84 (trajectory.geojson only)", f"{frame.operation}; {accuracy}"


def glossary() -> Iterator[str]:
    yield "<h2>Words used</h2>"
    yield "<dl>" + "".join(f"<dt>{escape(k)}</dt><dd>{escape(v)}</dd>" for k, v in WORDS.items()) + "</dl>"


def run_section(result: SessionResult) -> Iterator[str]:
    """Versions, inputs and the config, so that the run can be made again."""
    yield "<h2>This run</h2>"
    yield facts("Versions, inputs, seeds and times", flat_pairs(result.run))
    config = json.dumps(json_ready(result.config), indent=2, ensure_ascii=False)
    yield details("The configuration, resolved", f"<pre>{escape(config)}</pre>")
