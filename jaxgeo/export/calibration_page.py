"""calibration.html: the learned odometry noise of a session, nothing else."""

from typing import Any

from jaxgeo.export.noise_section import noise_section
from jaxgeo.export.report_page import bullets, escape, page, paragraph
from jaxgeo.export.result import DriftGrowth


def calibration_html(
    session: str,
    learned: dict[str, dict[str, Any]],
    growth: dict[str, DriftGrowth],
    warnings: tuple[str, ...] = (),
    *,
    simulated: bool = False,
) -> str:
    """One page; `learned` and `growth` by trajectory."""
    body = ['<div class="banner">SIMULATED DATA: nothing on this page was measured</div>'] if simulated else []
    body += [
        f"<h1>{escape(session)}: odometry noise, learned</h1>",
        paragraph(
            "How the odometry drifts, learned from this session's own anchors. noise.json beside this page holds every "
            "number; another session of the same platform can start from it (noise.file).",
            "lead",
        ),
    ]
    if warnings:
        body.append(f'<div class="warnings"><strong>Warnings</strong>{bullets(warnings)}</div>')
    for name, values in learned.items():
        body += [f"<h2>Trajectory {escape(name)}</h2>", *noise_section(name, values, growth.get(name))]
    return page(f"{'SIMULATED: ' if simulated else ''}{session}: odometry noise", body)
