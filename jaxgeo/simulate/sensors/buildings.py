"""Buildings: walls with recessed windows, ledges, pilasters and signs: a scan finds edges in every direction."""

import dataclasses

import numpy as np
from jaxtyping import Float

from jaxgeo.simulate.sensors.mesh import Mesh, box, joined, placed, quads
from jaxgeo.simulate.sensors.texture import BRICK, CONCRETE, GLASS, METAL, PLASTER, ROOF, SIGN, WOOD

STOREY_M, BAY_M = 3.1, 2.6
WINDOW_WIDTH_M, WINDOW_HEIGHT_M, SILL_M, RECESS_M = 1.3, 1.5, 0.9, 0.22
LEDGE_M, PILASTER_M = 0.16, 0.14
# How deep walls reach below the ground at their middle: it is not level.
FOOT_M = 3.0
_WALLS = (BRICK, PLASTER, CONCRETE)


@dataclasses.dataclass(frozen=True)
class Footprint:
    """Where a building stands: centre, width and depth, height, and the direction of its width."""

    centre_m: tuple[float, float]
    width_m: float
    depth_m: float
    height_m: float
    yaw_rad: float

    def distance_m(self, place_m: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n"]:
        """From the walls; 0 inside."""
        cos, sin = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        own = (place_m - self.centre_m) @ np.array([[cos, -sin], [sin, cos]])
        return np.linalg.norm(np.maximum(np.abs(own) - [self.width_m / 2, self.depth_m / 2], 0.0), axis=1)


def building(rng: np.random.Generator, at: Footprint, ground_m: float) -> Mesh:
    """A building on its footprint; `ground_m` is the ground's height at its middle."""
    material = int(rng.choice(_WALLS))
    tint = rng.uniform(0.75, 1.1) * rng.uniform(0.9, 1.1, 3)
    sides = []
    for turn, (along_m, across_m) in enumerate([(at.width_m, at.depth_m), (at.depth_m, at.width_m)] * 2):
        wall = _facade(rng, along_m, at.height_m, material, tint)
        sides.append(placed(placed(wall, [-along_m / 2, -across_m / 2, 0.0]), [0.0, 0.0, 0.0], turn * np.pi / 2))
    half = np.array([at.width_m / 2, at.depth_m / 2])
    over = half + 0.35
    roof = box([*-over, at.height_m], [*over, at.height_m + 0.3], ROOF)
    foot = box([*-(half + 0.02), -FOOT_M], [*(half + 0.02), 0.35], CONCRETE, 0.8 * tint)
    return placed(joined([*sides, roof, foot]), [*at.centre_m, ground_m], at.yaw_rad)


def _facade(rng: np.random.Generator, width_m: float, height_m: float, material: int, tint: np.ndarray) -> Mesh:
    """A wall from x = 0 to its width, in the plane y = 0, seen from negative y."""
    bays, storeys = max(round(width_m / BAY_M), 1), max(round(height_m / STOREY_M), 1)
    bay_m, storey_m = width_m / bays, height_m / storeys
    window_m = np.array([min(WINDOW_WIDTH_M, 0.6 * bay_m), WINDOW_HEIGHT_M * storey_m / STOREY_M])
    parts: list[Mesh] = []
    wall: list[np.ndarray] = []
    for bay in range(bays):
        for storey in range(storeys):
            low = np.array([bay * bay_m, storey * storey_m])
            high = low + np.array([bay_m, storey_m])
            if rng.uniform() < 0.12:
                wall.append(_panel(low, high))
                if rng.uniform() < 0.7:
                    parts.append(_sign(rng, low, high))
                continue
            door = storey == 0 and rng.uniform() < 0.15
            hole_low = np.array([low[0] + (bay_m - window_m[0]) / 2, low[1] + (0.0 if door else SILL_M)])
            hole_high = np.array([hole_low[0] + window_m[0], low[1] + SILL_M + window_m[1]])
            wall += _around(low, high, hole_low, hole_high)
            parts += _window(rng, hole_low, hole_high, tint, door)
    parts.append(quads(np.array(wall), material, tint))
    for storey in range(1, storeys):
        z = storey * storey_m
        parts.append(box([0.0, -LEDGE_M, z - 0.1], [width_m, 0.0, z + 0.1], CONCRETE, 1.1 * tint))
    for bay in range(bays + 1):
        if bay in (0, bays) or rng.uniform() < 0.4:
            x = np.clip(bay * bay_m, 0.2, width_m - 0.2)
            parts.append(box([x - 0.2, -PILASTER_M, 0.0], [x + 0.2, 0.0, height_m], material, 0.85 * tint))
    return joined(parts)


def _around(low: np.ndarray, high: np.ndarray, hole_low: np.ndarray, hole_high: np.ndarray) -> list[np.ndarray]:
    """The wall of a bay round its hole: left, right, below, above."""
    pieces = [
        (low, [hole_low[0], high[1]]),
        ([hole_high[0], low[1]], high),
        ([hole_low[0], low[1]], [hole_high[0], hole_low[1]]),
        ([hole_low[0], hole_high[1]], [hole_high[0], high[1]]),
    ]
    return [_panel(a, b) for a, b in pieces if b[1] > a[1]]


def _panel(low, high, y: float = 0.0) -> np.ndarray:
    return np.array([[low[0], y, low[1]], [high[0], y, low[1]], [high[0], y, high[1]], [low[0], y, high[1]]])


def _window(rng: np.random.Generator, low: np.ndarray, high: np.ndarray, tint: np.ndarray, door: bool) -> list[Mesh]:
    """The reveal, the glass or the door's wood, a blind, and the bars of the frame."""
    x0, z0, x1, z1 = *low, *high
    reveal = np.array(
        [
            [[x0, 0, z0], [x0, RECESS_M, z0], [x0, RECESS_M, z1], [x0, 0, z1]],
            [[x1, RECESS_M, z0], [x1, 0, z0], [x1, 0, z1], [x1, RECESS_M, z1]],
            [[x0, RECESS_M, z1], [x1, RECESS_M, z1], [x1, 0, z1], [x0, 0, z1]],
            [[x0, 0, z0], [x1, 0, z0], [x1, RECESS_M, z0], [x0, RECESS_M, z0]],
        ]
    )
    pane = WOOD if door else GLASS
    parts = [
        quads(reveal, PLASTER, 0.9 * tint),
        quads(_panel(low, high, RECESS_M)[None], pane, rng.uniform(0.6, 1.4) * rng.uniform(0.92, 1.08, 3)),
    ]
    if door:
        return parts
    drawn = rng.uniform(0.0, 1.2)  # of the blind: many are up
    if drawn < 0.9:
        bottom = z1 - drawn * (z1 - z0)
        parts.append(
            quads(
                _panel([x0, bottom], [x1, z1], RECESS_M - 0.03)[None],
                PLASTER,
                rng.uniform(0.5, 1.1) * rng.uniform(0.85, 1.1, 3),
            )
        )
    middle = x0 + rng.choice([0.33, 0.5, 0.67]) * (x1 - x0)
    frame = rng.uniform(0.5, 1.6)
    parts.append(box([middle - 0.04, RECESS_M - 0.08, z0], [middle + 0.04, RECESS_M, z1], METAL, np.full(3, frame)))
    parts.append(box([x0 - 0.08, -0.09, z0 - 0.07], [x1 + 0.08, 0.0, z0], CONCRETE, np.full(3, 1.1)))
    return parts


def _sign(rng: np.random.Generator, low: np.ndarray, high: np.ndarray) -> Mesh:
    """A board of some colour on the wall; never a saturated green."""
    size = rng.uniform(0.5, 1.6, 2)
    middle = (low + high) / 2 + rng.uniform(-0.3, 0.3, 2)
    tint = rng.uniform(0.4, 1.0, 3)
    tint[1] = min(tint[1], tint[2])
    panel = _panel(middle - size / 2, middle + size / 2, -0.06)
    x0, z0, x1, z1 = *(middle - size / 2), *(middle + size / 2)
    return joined([quads(panel[None], SIGN, tint), box([x0, -0.055, z0], [x1, 0.0, z1], METAL)])
