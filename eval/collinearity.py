"""How nearly each location lies on the line through its two neighbours, and what that does to its held-out error.

A location on the line of its neighbours is held in place by them alone; one far off it is extrapolated.
"""

import dataclasses
from collections.abc import Collection, Sequence

import numpy as np
from jaxtyping import Float

from jaxgeo.errors import InputError
from jaxgeo.export.held_out_stats import finite, mean_or_nan


@dataclasses.dataclass(frozen=True)
class Neighbours:
    """One location against the line of its two neighbours in visiting order.

    Attributes:
        before, after: the neighbours' names; the first location's `before` is the last.
        distance_m: from the straight line through both, horizontally and vertically together; the line goes on beyond
            them.
        segment_m: distance between the two neighbours.
        share: distance_m / segment_m; infinite where the neighbours coincide, and then distance_m is that from them.
    """

    name: str
    before: str
    after: str
    distance_m: float
    segment_m: float
    share: float


@dataclasses.dataclass(frozen=True)
class CollinearityContrast:
    """Mean held-out errors of the near-collinear locations and of the others; NaN where there is none of a kind."""

    near_mean_m: float
    others_mean_m: float
    ratio: float


def neighbours(names: Sequence[str], enh_m: Float[np.ndarray, "n 3"]) -> tuple[Neighbours, ...]:
    """Every location, in visiting order and each once, against the line of its neighbours.

    With p the location and a, b its neighbours: |(p - a) x u|, u = (b - a) / |b - a|. Fewer than three locations have
    no two neighbours: empty.

    Raises:
        InputError: a location is named twice, or names and coordinates differ in number.
    """
    if len(set(names)) != len(names) or enh_m.shape != (len(names), 3):
        raise InputError(
            f"neighbours of {len(names)} locations ({', '.join(names)}) with coordinates of shape {enh_m.shape}: "
            "expected every location once, in visiting order, with E, N, h. Leave out revisits."
        )
    if len(names) < 3:
        return ()
    found = []
    for i, name in enumerate(names):
        before, after = (i - 1) % len(names), (i + 1) % len(names)
        line, arm = enh_m[after] - enh_m[before], enh_m[i] - enh_m[before]
        segment_m = float(np.linalg.norm(line))
        if segment_m > 0.0:
            distance_m = float(np.linalg.norm(np.cross(arm, line / segment_m)))
            share = distance_m / segment_m
        else:
            distance_m, share = float(np.linalg.norm(arm)), float("inf")
        found.append(Neighbours(name, names[before], names[after], distance_m, segment_m, share))
    return tuple(found)


def near_collinear(found: Sequence[Neighbours], most_share: float = 0.1) -> set[str]:
    """Locations nearer to their neighbours' line than this share of the neighbours' distance."""
    return {each.name for each in found if each.share <= most_share}


def collinearity_contrast(per_location_m: dict[str, float], near: Collection[str]) -> CollinearityContrast:
    """Mean error of the locations in `near` over that of the others; locations without an error (NaN) are left out.

    Raises:
        InputError: `near` names a location that has no entry.
    """
    unknown = sorted(set(near) - set(per_location_m))
    if unknown:
        raise InputError(
            f"near-collinear location(s) {', '.join(unknown)} are not among those with errors: "
            f"{', '.join(per_location_m)}."
        )
    near_m, others_m = (
        mean_or_nan(finite(np.array([e for name, e in per_location_m.items() if (name in near) == wanted])))
        for wanted in (True, False)
    )
    return CollinearityContrast(near_m, others_m, near_m / others_m if others_m > 0.0 else float("nan"))
