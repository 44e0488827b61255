"""Revisit self-consistency: how far apart two visits of one location are predicted."""

import numpy as np
from jaxtyping import Float


def revisit_gaps(
    location: tuple[str, ...], points_m: dict[str, Float[np.ndarray, "k 3"]]
) -> dict[str, dict[str, float]]:
    """For every location visited more than once, the largest distance between its visits' predicted positions.

    Args:
        location: (k) location of every visit.
        points_m: predicted marker positions by stage, such as `coarse_m`, `refined_m`, `held_out_m`.

    Returns:
        {location: {stage: metres}}.
    """
    gaps = {}
    for name in dict.fromkeys(location):
        rows = np.array([i for i, other in enumerate(location) if other == name])
        if len(rows) > 1:
            gaps[name] = {stage: _largest(points[rows]) for stage, points in points_m.items()}
    return gaps


def _largest(points_m: Float[np.ndarray, "m 3"]) -> float:
    return float(np.max(np.linalg.norm(points_m[:, None] - points_m[None], axis=-1)))
