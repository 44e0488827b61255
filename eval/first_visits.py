"""The one-time similarity to each location's first visit alone, as the reference study fits it.

A study whose revisits disagree by 101 m and whose mean held-out error is 13 m cannot have the revisit among what is
fitted or scored: two visits 101 m apart are 50 m off on average, a seventh of that over seven visits.
"""

import dataclasses

import numpy as np

from eval.revisit import revisit_gaps
from eval.similarity import fitted_markers, markers_of
from jaxgeo.data import Anchors, Trajectory
from jaxgeo.solve.correct import Settings


@dataclasses.dataclass(frozen=True)
class FirstVisits:
    """Of locations by name; NaN where the other locations' first visits do not fix the frame.

    Attributes:
        held_out_m: error of the first visit, its location left out.
        revisit_m: largest distance between the visits' markers, all first visits in.
    """

    held_out_m: dict[str, float]
    revisit_m: dict[str, float]


def first_visits(trajectory: Trajectory, anchors: Anchors, settings: Settings) -> FirstVisits | None:
    """None where no location was visited twice: then it is the one-time similarity itself."""
    location = anchors.location_index
    _, first = np.unique(location, return_index=True)
    if len(first) == len(anchors):
        return None
    takes_part = np.isin(np.arange(len(anchors)), first)
    others = np.arange(len(first))[:, None] != location[None]
    use = np.concatenate([takes_part[None], takes_part & others]).astype(float)
    markers = markers_of(trajectory, anchors, settings.extra_sigma_m, rotations=False)
    scale, gravity = settings.coarse_scale, settings.coarse_gravity
    point, good = fitted_markers(markers, use, scale=scale, gravity=gravity, of_graph=False)
    point = np.where(good[:, None, None], point, np.nan)[:, : len(anchors)]
    error_m = np.linalg.norm(point[1:][np.arange(len(first)), first] - anchors.surveyed_enh_m[first], axis=1)
    gaps = revisit_gaps(anchors.location, {"m": point[0]})
    return FirstVisits(
        dict(zip((anchors.location[i] for i in first), error_m.tolist(), strict=True)),
        {name: gap["m"] for name, gap in gaps.items()},
    )
