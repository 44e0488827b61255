"""What a reading must satisfy to count as a marker."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from jaxgeo.detect.families import Family
from jaxgeo.detect.reading import Readings
from jaxgeo.errors import DetectError


@dataclasses.dataclass(frozen=True)
class Gates:
    """Limits; a reading outside one of them is refused, and counted under its name.

    Attributes:
        max_hamming: corrected bits; a family's own limit (distance of its codes, chance readings) goes before.
        min_margin: mean clearness of the cells, 0 .. 1.
        max_border_errors: share of the border's cells that are not black.
        min_contrast: white less black, gray levels.
        min_side_px: shortest side of the marker in the image.
        max_view_angle_rad: between the line of sight and the marker's normal, from the outline's flatness.
        ids: the ids in use, by any family; others are refused. None: all ids of the families.
        plain_margin: ids with plain codes need a margin of this, no corrected bit and a faultless border.
    """

    max_hamming: int = 2
    min_margin: float = 0.3
    max_border_errors: float = 0.2
    min_contrast: float = 12.0
    min_side_px: float = 8.0
    max_view_angle_rad: float = 1.4
    ids: frozenset[int] | None = None
    plain_margin: float = 0.8

    def __post_init__(self) -> None:
        for name, low, high in (
            ("max_hamming", 0, 10),
            ("min_margin", 0, 1),
            ("max_border_errors", 0, 1),
            ("min_contrast", 0, 255),
            ("min_side_px", 4, 1e4),
            ("max_view_angle_rad", 0.01, np.pi / 2),
            ("plain_margin", 0, 1),
        ):
            value = getattr(self, name)
            if not (np.isfinite(value) and low <= value <= high):
                raise DetectError(f"gates: {name} is {value}; expected {low:g} to {high:g}.")


def refusals(
    readings: Readings, quads_px: Float[np.ndarray, "q 4 2"], families: Sequence[Family], gates: Gates
) -> dict[str, Bool[np.ndarray, "q"]]:
    """By gate: which readings it refuses (a reading may be refused by several)."""
    limit = np.array([min(gates.max_hamming, one.max_hamming) for one in families])[readings.family]
    plain = np.zeros(len(quads_px), dtype=bool)
    for f, one in enumerate(families):
        if one.plain:
            plain |= (readings.family == f) & np.isin(readings.marker, list(one.plain))
    doubtful = (readings.hamming > 0) | (readings.margin < gates.plain_margin) | (readings.border_errors > 0)
    sides = np.linalg.norm(np.roll(quads_px, -1, axis=1) - quads_px, axis=2)
    refused = {
        "hamming": readings.hamming > limit,
        "margin": readings.margin < gates.min_margin,
        "border": readings.border_errors > gates.max_border_errors,
        "contrast": readings.contrast < gates.min_contrast,
        "side": sides.min(axis=1, initial=np.inf) < gates.min_side_px,
        "view angle": view_angle_rad(quads_px) > gates.max_view_angle_rad,
        "plain code": plain & doubtful,
    }
    if gates.ids is not None:
        refused["id not in use"] = ~np.isin(readings.marker, list(gates.ids))
    return refused


def view_angle_rad(quads_px: Float[np.ndarray, "q 4 2"]) -> Float[np.ndarray, "q"]:
    """Angle between line of sight and normal of a square from its outline's flatness (weak perspective)."""
    across = (quads_px[:, 1] + quads_px[:, 2] - quads_px[:, 0] - quads_px[:, 3]) / 2
    down = (quads_px[:, 3] + quads_px[:, 2] - quads_px[:, 0] - quads_px[:, 1]) / 2
    # Singular values of the 2x2 matrix (across, down): their squares add up to s and multiply to d^2.
    s = (across**2).sum(axis=1) + (down**2).sum(axis=1)
    d = across[:, 0] * down[:, 1] - across[:, 1] * down[:, 0]
    root = np.sqrt(np.maximum(s * s - 4.0 * d * d, 0.0))
    return np.arccos(np.sqrt(np.maximum(s - root, 0.0) / np.maximum(s + root, 1e-18)))
