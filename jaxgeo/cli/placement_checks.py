"""What is refused of a layout, since no run could use it, and what is said of one."""

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from eval.placement.answer import PlacementAnswer, PlannedLayout
from jaxgeo.cli.placement_areas import distance_to
from jaxgeo.cli.placement_inputs import PlacementInputs
from jaxgeo.errors import UndeterminedError
from jaxgeo.solve.gauge import determined, free_direction_words, gauge_covariance

# Put on an outline, a point may lie a rounding error outside.
_OUTSIDE_M = 0.01


def refuse_open_frame(chosen: PlannedLayout, inputs: PlacementInputs) -> None:
    """Refuse a layout that, as it is seen from the path, leaves a turn or a shift of all of it open.

    Raises:
        UndeterminedError: saying what is open, and what to change.
    """
    seen = {visit.location for visit in chosen.visits}
    rows = [i for i, name in enumerate(chosen.name) if name in seen]
    what = f"{len(chosen.name)} anchors do not fix the frame"
    if len(rows) < 3:
        raise UndeterminedError(
            f"{what}: only {len(rows)} of them can be seen from the path (within sighting.range_m = "
            f"{inputs.given.range_m:g} m); three or more, not on one line, are needed. Raise the range, or move them "
            "nearer to the path."
        )
    refuse_one_line(chosen.point_m[rows], inputs)
    if not all(math.isfinite(x) for x in chosen.accuracy_m.values()):
        raise UndeterminedError(
            f"{what}: as they are seen from the path, a turn or a shift of it all stays open. Add an anchor "
            "(anchors.count), or have places that lie farther apart."
        )


def refuse_one_line(point_m: Float[np.ndarray, "k 3"], inputs: PlacementInputs) -> None:
    """Ask of anchors what a run asks before it solves anything.

    Raises:
        UndeterminedError: fewer than three, or a turn stays open.
    """
    if len(point_m) < 3:
        raise UndeterminedError(
            f"{len(point_m)} anchor(s) do not fix the frame: three or more, not on one line, are needed. Add some to "
            "the layout."
        )
    variance = inputs.given.sighting_sigma_m**2 + np.square(inputs.given.survey_sigma_m)
    information = jnp.broadcast_to(jnp.diag(1.0 / jnp.sqrt(jnp.asarray(variance))), (len(point_m), 3, 3))
    sigma, direction = gauge_covariance(jnp.asarray(point_m), information, jnp.zeros_like(information))
    if not determined(sigma, direction):
        free = free_direction_words(np.asarray(sigma), np.asarray(direction))
        raise UndeterminedError(
            f"{len(point_m)} anchors do not fix the frame: they stand nearly on one line, and {free}. Have one of them "
            "or more beside the line: with anchors.areas, anchors.candidates or anchors.standing."
        )


def oddities(inputs: PlacementInputs, answers: tuple[PlacementAnswer, ...], predicted: bool) -> list[str]:
    """What is odd about the chosen layouts: anchors that are not seen, or could not be kept inside the areas."""
    said = []
    for answer in answers:
        chosen = answer.chosen
        seen = {visit.location for visit in chosen.visits}
        said += [
            f"{name} is not seen from the path (sighting.range_m is {inputs.given.range_m:g} m): it adds nothing"
            for name in chosen.name
            if name not in seen
        ]
        if predicted or not inputs.given.areas_en_m:
            continue
        outside_m = distance_to(chosen.point_m[:, :2], inputs.given.areas_en_m)
        said += [
            f"{name} stands {away_m:.2f} m outside the areas: none of them is within reach of the path there"
            for name, stands, away_m in zip(chosen.name, chosen.standing, outside_m.tolist(), strict=True)
            if not stands and away_m > _OUTSIDE_M
        ]
    return list(dict.fromkeys(said))
