"""The part of the report about one trajectory: pictures, tables, and what they say."""

import math
from collections.abc import Iterator

from jaxgeo.export.before_after import before_after
from jaxgeo.export.drift_plot import drift_plot
from jaxgeo.export.figure_style import distance_along_m
from jaxgeo.export.height_profile import height_profile
from jaxgeo.export.held_out_plot import held_out_plot
from jaxgeo.export.held_out_stats import stats_by_stage
from jaxgeo.export.interactive_plan import interactive_plan
from jaxgeo.export.interactive_profile import interactive_profile
from jaxgeo.export.noise_section import drift_caption, noise_section
from jaxgeo.export.number_words import THIN, decimal, duration_words, length_words, number_text
from jaxgeo.export.plan_view import plan_view
from jaxgeo.export.report_page import bullets, escape, facts, figure, paragraph
from jaxgeo.export.report_tables import (
    calibration_table,
    flat_pairs,
    leave_one_out_table,
    reference_table,
    revisit_table,
)
from jaxgeo.export.residual_tables import held_out_table, residual_table
from jaxgeo.export.result import SessionResult, TrajectoryResult
from jaxgeo.export.sigma_profile import sigma_profile


def trajectory_section(result: SessionResult, trajectory: TrajectoryResult, *, interactive: bool) -> Iterator[str]:
    """Everything about one trajectory; `interactive`: with figures that need the page's scripts."""
    stats = stats_by_stage(trajectory)
    yield f"<h2>Trajectory {escape(trajectory.name)}</h2>"
    yield paragraph(in_short(trajectory), "lead")
    plan = figure(
        plan_view(result, trajectory),
        f"Plan view of {trajectory.name}",
        "Blue: corrected path with 95 % ellipses at equal distances. Orange: every anchor's 95 % ellipse and error "
        "when its location was held out; an arrow that ends inside its ellipse is an error as large as predicted.",
    )
    profiles = "".join(static_profiles(result, trajectory))
    yield interactive_plan(result, trajectory, plan) if interactive else plan
    yield "<h3>Along the path</h3>"
    yield interactive_profile(result, trajectory, profiles) if interactive else profiles
    yield figure(
        before_after(result, trajectory),
        f"Before and after the correction of {trajectory.name}",
        "Arrows: surveyed to predicted marker with all anchors in, both sides magnified alike.",
    )
    yield "<h3>Anchors</h3>"
    yield residual_table(result, trajectory)
    yield from about_anchors(trajectory)
    yield "<h3>Held-out error</h3>"
    if stats:
        yield held_out_table(result, trajectory)
        yield paragraph(
            "Error over sigma: where the prediction is right, about two in three lie between −1 and 1, and few beyond "
            "±2. NEES takes the three axes together.",
            "note",
        )
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
    if trajectory.reference:
        yield "<h3>Against the reference trajectory</h3>"
        yield reference_table(trajectory)
    yield from numbers(trajectory)


def about_anchors(trajectory: TrajectoryResult) -> Iterator[str]:
    """Corrections of clock and camera, and whether an anchor may be wrong: what was found, and what was done."""
    if trajectory.corrections is not None:
        yield "<h3>Clock and camera</h3>"
        yield bullets(trajectory.corrections["sentences"])
    if trajectory.check is not None:
        yield "<h3>Are the anchors right?</h3>"
        yield bullets([*trajectory.check["sentences"], *trajectory.check["mend"]])


def static_profiles(result: SessionResult, trajectory: TrajectoryResult) -> Iterator[str]:
    """Height and standard deviations along the path."""
    yield figure(
        height_profile(result, trajectory), f"Height profile of {trajectory.name}", "The band holds two sigma each way."
    )
    yield figure(
        sigma_profile(trajectory),
        f"Predicted standard deviations of {trajectory.name}",
        "Small at the anchors, larger between them. It is the model's own claim: the held-out errors test it.",
    )


def in_short(trajectory: TrajectoryResult) -> str:
    """Size of the trajectory and of the coarse fit in one sentence."""
    stamp_s, anchors = trajectory.corrected.stamp_s, trajectory.anchors
    length_m = float(distance_along_m(trajectory.corrected.position_m)[-1])
    scale_ppm = (trajectory.coarse.scale - 1.0) * 1e6
    scale = f"{decimal(scale_ppm / 1e4, 2)}{THIN}%" if abs(scale_ppm) >= 1e3 else f"{decimal(scale_ppm, 0)} ppm"
    return (
        f"{len(stamp_s)} poses over {length_words(length_m)} and {duration_words(float(stamp_s[-1] - stamp_s[0]))}; "
        f"{len(anchors)} visits to {len(set(anchors.location))} locations. The one-time similarity changed the "
        f"scale by {scale} and left {length_words(trajectory.coarse.rms_m)} RMS."
    )


def uncertainty(trajectory: TrajectoryResult) -> Iterator[str]:
    """Whether the predicted standard deviations can be believed."""
    stats = stats_by_stage(trajectory)
    yield "<h3>Uncertainty</h3>"
    if not any(s.n_covariance for s in stats.values()):
        yield paragraph("No uncertainty was predicted for held-out markers, so the claim could not be tested.")
        return
    yield calibration_table(stats)
    yield paragraph(
        "NEES is averaged over locations, and 'expected' is where that mean lies 95 times in 100 if the covariances "
        "are right and the locations independent, which they are only roughly: folds share their other anchors.",
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
    if trajectory.timing_s:
        yield facts("Time in seconds", flat_pairs(trajectory.timing_s))
