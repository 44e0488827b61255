"""The warning that few check points make no accuracy: shown once, beside the figures it is about."""

from collections.abc import Iterator

from jaxgeo.export.held_out_stats import MIN_CHECK_POINTS, final_stage, stats_by_stage
from jaxgeo.export.report_page import paragraph
from jaxgeo.export.result import SessionResult, TrajectoryResult


def small_numbers_box(result: SessionResult) -> Iterator[str]:
    """HTML; nothing where every trajectory has check points enough, or none at all."""
    counts = [check_points for t in result.trajectories.values() if (check_points := n_check_points(t)) > 0]
    few = [n for n in counts if n < MIN_CHECK_POINTS]
    if few:
        words = "".join(paragraph(sentence) for sentence in small_numbers_words(min(few)))
        yield f'<div class="small"><strong>An indication, not an accuracy</strong>{words}</div>'


def n_check_points(trajectory: TrajectoryResult) -> int:
    """Locations with a held-out error of the corrected trajectory."""
    stats = stats_by_stage(trajectory).get(final_stage(trajectory))
    return 0 if stats is None else stats.n_locations


def small_numbers_words(n: int) -> tuple[str, str]:
    """Why, and how uncertain the shares are."""
    points = 100.0 * 1.96 * (0.95 * 0.05 / n) ** 0.5
    return (
        f"{n} check points are too few to state an accuracy: the ASPRS standard of 2023 asks for {MIN_CHECK_POINTS}. "
        "Take all held-out figures of this report as an indication for this session only.",
        f"With {n} points, a share such as '95 % inside the ellipsoid' is itself uncertain by about {points:.0f} "
        "percentage points.",
    )
