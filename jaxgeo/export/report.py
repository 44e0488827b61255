"""report.html: what was done and how good it is, for a surveyor who never saw the code; one file, no network."""

import json
import math
from collections.abc import Iterator

from jaxgeo.export.before_after import before_after
from jaxgeo.export.drift_plot import drift_plot
from jaxgeo.export.figure_style import distance_along_m
from jaxgeo.export.geojson_file import NO_DATUM
from jaxgeo.export.height_profile import height_profile
from jaxgeo.export.held_out_plot import held_out_plot
from jaxgeo.export.held_out_stats import MIN_CHECK_POINTS, stats_by_stage
from jaxgeo.export.json_text import json_ready
from jaxgeo.export.noise_section import drift_caption, noise_section
from jaxgeo.export.number_words import decimal, duration_words, length_words, number_text
from jaxgeo.export.plan_view import plan_view
from jaxgeo.export.report_page import bullets, details, escape, facts, figure, page, paragraph
from jaxgeo.export.report_tables import (
    calibration_table,
    comparison_table,
    flat_pairs,
    leave_one_out_table,
    reference_table,
    residual_table,
    revisit_table,
)
from jaxgeo.export.result import SessionResult, TrajectoryResult
from jaxgeo.export.sigma_profile import sigma_profile
from jaxgeo.export.verdict import verdict

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


def report_html(result: SessionResult) -> str:
    """The whole report as one HTML document."""
    body = [*head(result), *summary(result), *method(result)]
    for trajectory in result.trajectories.values():
        body += trajectory_section(result, trajectory)
    body += [*glossary(), *run_section(result)]
    return page(f"{'SIMULATED: ' if result.simulated else ''}{result.name}: georeferencing report", body)


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
        lines = "".join(paragraph(s) for s in found.sentences)
        yield f'<div class="verdict {found.level}"><p class="name">{escape(name)}</p>{lines}</div>'
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
    yield facts("Coordinates: figures and trajectory.tum have the origin taken off", frame_facts(result))
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


def trajectory_section(result: SessionResult, trajectory: TrajectoryResult) -> Iterator[str]:
    """Everything about one trajectory."""
    stats = stats_by_stage(trajectory)
    yield f"<h2>Trajectory {escape(trajectory.name)}</h2>"
    yield paragraph(in_short(trajectory), "lead")
    yield figure(
        plan_view(result, trajectory),
        f"Plan view of {trajectory.name}",
        "Blue: corrected path with 95 % ellipses at equal distances. Orange: every anchor's 95 % ellipse and error "
        "when its location was held out; an arrow that ends inside its ellipse is an error as large as predicted.",
    )
    yield figure(
        before_after(result, trajectory),
        f"Before and after the correction of {trajectory.name}",
        "Arrows: surveyed to predicted marker with all anchors in, both sides magnified alike.",
    )
    yield "<h3>Anchors</h3>"
    yield residual_table(trajectory)
    yield "<h3>Held-out error</h3>"
    if stats:
        yield figure(
            held_out_plot(trajectory),
            f"Held-out errors of {trajectory.name}",
            "Lower is better. A cross marks a fold without a result.",
        )
        yield leave_one_out_table(trajectory)
    else:
        yield paragraph("No location was held out.")
    if trajectory.revisit:
        yield "<h3>Revisits</h3>"
        yield revisit_table(trajectory)
        yield paragraph(
            "With all anchors in, the visits are tied to one surveyed position and agree by construction; held out, "
            "neither is tied to it, and only the trajectory and the other locations hold them together.",
            "note",
        )
    yield from uncertainty(trajectory)
    yield from odometry_noise(trajectory)
    yield "<h3>Height</h3>"
    yield figure(
        height_profile(result, trajectory), f"Height profile of {trajectory.name}", "The band holds two sigma each way."
    )
    if trajectory.reference:
        yield "<h3>Against the reference trajectory</h3>"
        yield reference_table(trajectory)
    yield from numbers(trajectory)


def in_short(trajectory: TrajectoryResult) -> str:
    """Size of the trajectory and of the coarse fit in one sentence."""
    stamp_s, anchors = trajectory.corrected.stamp_s, trajectory.anchors
    length_m = float(distance_along_m(trajectory.corrected.position_m)[-1])
    scale_ppm = (trajectory.coarse.scale - 1.0) * 1e6
    scale = f"{decimal(scale_ppm / 1e4, 2)} %" if abs(scale_ppm) >= 1e3 else f"{decimal(scale_ppm, 0)} ppm"
    return (
        f"{len(stamp_s)} poses over {length_words(length_m)} and {duration_words(float(stamp_s[-1] - stamp_s[0]))}; "
        f"{len(anchors)} visits to {len(set(anchors.location))} locations. The one-time similarity changed the "
        f"scale by {scale} and left {length_words(trajectory.coarse.rms_m)} RMS."
    )


def uncertainty(trajectory: TrajectoryResult) -> Iterator[str]:
    """Sigma along the path, and whether it can be believed."""
    stats = stats_by_stage(trajectory)
    yield "<h3>Uncertainty</h3>"
    yield figure(
        sigma_profile(trajectory),
        f"Predicted standard deviations of {trajectory.name}",
        "Small at the anchors, larger between them. It is the model's own claim: the table below tests it.",
    )
    if not any(s.n_covariance for s in stats.values()):
        yield paragraph("No uncertainty was predicted for held-out markers, so the claim could not be tested.")
        return
    yield calibration_table(stats)
    yield paragraph(
        "NEES is averaged over locations, and 'expected' is where that mean lies 95 times in 100 if the covariances "
        "are right and the locations independent, which they are only roughly: folds share their other anchors.",
        "note",
    )
    n = max(s.n_locations for s in stats.values() if s.n_covariance)
    if n < MIN_CHECK_POINTS:
        yield paragraph(
            f"Small numbers: with {n} check points a share of 95 % is uncertain by about "
            f"{100 * 1.96 * (0.95 * 0.05 / max(n, 1)) ** 0.5:.0f} percentage points. Fewer than {MIN_CHECK_POINTS} "
            "check points are not to be called an accuracy.",
            "note",
        )


def odometry_noise(trajectory: TrajectoryResult) -> Iterator[str]:
    """How the odometry drifts: as learned, or as assumed."""
    learned, growth = trajectory.noise.get("learned"), trajectory.drift_growth
    if learned is not None:
        yield "<h3>Odometry noise, learned</h3>"
        yield from noise_section(trajectory.name, learned, growth)
    elif growth is not None:
        yield "<h3>Odometry noise, fixed</h3>"
        yield figure(drift_plot(growth), f"Drift growth of {trajectory.name}", drift_caption(growth))


def numbers(trajectory: TrajectoryResult) -> Iterator[str]:
    """Noise, solver, timings."""
    yield "<h3>Values used</h3>"
    fixed = {stage: values for stage, values in trajectory.noise.items() if stage != "learned"}
    which = "for comparison; the corrected trajectory has the learned ones" if "learned" in trajectory.noise else "used"
    yield facts(f"Fixed noise values, {which}", flat_pairs(fixed))
    log_scale, sigma = trajectory.log_scale
    solver = [*flat_pairs(trajectory.solver)]
    if math.isnan(sigma):
        solver.append(("log-scale of the odometry", number_text(log_scale)))
    elif sigma > 0.0:
        solver.append(("log-scale of the odometry", f"{number_text(log_scale)} ± {number_text(sigma)}"))
    yield facts("Solver", solver)
    yield facts("Time in seconds", flat_pairs(trajectory.timing_s))


def glossary() -> Iterator[str]:
    yield "<h2>Words used</h2>"
    yield "<dl>" + "".join(f"<dt>{escape(k)}</dt><dd>{escape(v)}</dd>" for k, v in WORDS.items()) + "</dl>"


def run_section(result: SessionResult) -> Iterator[str]:
    """Versions, inputs and the config, so that the run can be made again."""
    yield "<h2>This run</h2>"
    yield facts("Versions, inputs, seeds and times", flat_pairs(result.run))
    config = json.dumps(json_ready(result.config), indent=2, ensure_ascii=False)
    yield details("The configuration, resolved", f"<pre>{escape(config)}</pre>")
