"""What the data cannot tell of a trajectory's noise, in plain words."""

from collections.abc import Sequence

import numpy as np

from calibration.result import SigmaEstimate
from jaxgeo.data import Anchors

# A sigma whose posterior is no narrower than this share of its prior was not learned.
_AS_WIDE_AS_PRIOR = 0.85
# Below this ratio of the locations' middle to their largest extent they are on a line.
_ON_A_LINE = 0.1


def sentences(
    sigmas: Sequence[SigmaEstimate], n_contrasts: int, n_revisits: int, observations: str, anchors: Anchors
) -> tuple[str, ...]:
    """One sentence for each thing that the data leave open; none where they leave nothing open."""
    said = []
    if n_contrasts == 0:
        return (
            "Nothing was learned: the anchors fix the frame and leave no contradiction to learn from; the noise is the "
            "prior's. One more location, or a second visit to one, would tell.",
        )
    if observations == "revisit":
        said += _revisits(n_revisits, n_contrasts)
    elif n_contrasts < 6:
        said.append(
            f"Only {n_contrasts} numbers are left to learn from once the frame is fixed: every sigma is known to a "
            f"factor of about {np.exp(1.0 / np.sqrt(2.0 * n_contrasts)):.1f} at best, and mostly from the prior."
        )
    if _on_a_line(anchors):
        said.append(
            "All locations are nearly on a line: rotation noise about that line moves no anchor, and is the prior's."
        )
    open_ = [s for s in sigmas if s.log_sd > _AS_WIDE_AS_PRIOR * s.prior_log_sd and s.probability > 0.05]
    # The groups say what their axes would say three times.
    names = [s.component for s in open_ if s.component.split("_")[1] not in ("x", "y", "z")]
    if names:
        said.append(f"The anchors say nothing about {', '.join(names)}: the width is the prior's.")
    return tuple(said)


def _revisits(n_revisits: int, n_contrasts: int) -> list[str]:
    if n_revisits == 0:
        return ["No location was visited twice, so nothing was learned from revisits; the noise is the prior's."]
    if n_revisits == 1:
        return [
            f"One revisit gives {n_contrasts} numbers: the level of the noise is known to a factor of about "
            f"{np.exp(1.0 / np.sqrt(2.0 * n_contrasts)):.1f}, and translation cannot be told from rotation. A third "
            "visit, or anchors (observations: both), would tell."
        ]
    return []


def _on_a_line(anchors: Anchors) -> bool:
    where = np.unique(anchors.surveyed_enh_m, axis=0)
    extent = np.linalg.svd(where - where.mean(axis=0), compute_uv=False)
    return len(where) < 3 or bool(extent[1] < _ON_A_LINE * extent[0])
