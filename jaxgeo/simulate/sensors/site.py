"""What stands where on the simulated site: buildings round it, a pavilion in its middle, trees and street furniture."""

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from jaxgeo.simulate.course import course_of
from jaxgeo.simulate.layout import SURVEYED_ENH_M, UAV, UGV
from jaxgeo.simulate.sensors.buildings import Footprint, building
from jaxgeo.simulate.sensors.ground import ground_height_m
from jaxgeo.simulate.sensors.mesh import Mesh, box, joined, placed, quads, tapered_column
from jaxgeo.simulate.sensors.texture import BRICK, CONCRETE, GRASS, METAL, WOOD
from jaxgeo.simulate.sensors.vegetation import hedge, tree

# Centre E, N, width, depth, height in metres, and direction of the width in degrees: round the two walks.
_BUILDINGS = (
    (20.0, 45.0, 26.0, 10.0, 9.4, 5.0),
    (48.0, 50.0, 24.0, 9.0, 6.3, -10.0),
    (74.0, 27.0, 20.0, 10.0, 12.5, 105.0),
    (67.0, 2.0, 14.0, 10.0, 6.2, -25.0),
    (44.0, -17.0, 24.0, 9.0, 9.3, 8.0),
    (16.0, -22.0, 22.0, 10.0, 6.4, -12.0),
    (-5.0, -7.0, 14.0, 12.0, 9.5, 30.0),
    (-16.0, 17.0, 20.0, 10.0, 12.4, 82.0),
    (-9.0, 37.0, 13.0, 9.0, 6.2, -30.0),
    (29.5, 14.0, 9.0, 6.0, 3.4, 20.0),
    (47.0, 25.5, 4.0, 3.0, 2.9, -35.0),
)
GROUND_M, GROUND_STEP_M = 28.0, 0.8  # beyond the walks; of the grid
TREES, HEDGES, BENCHES, LAMPS, LOW_WALLS, STONES = 30, 16, 9, 12, 8, 36
LEAVES_A_TREE, LEAVES_A_HEDGE = 2600, 1500
# Nothing stands nearer to a marker's place or between it and those who look at it.
CLEAR_OF_MARKERS_M = 4.0
_STREAM = 200


def site_mesh(seed: int, *, leaves_a_tree: int = LEAVES_A_TREE) -> Mesh:
    """The whole site in the true local frame (E, N, h minus the origin); the same for all sessions under one seed."""
    rng = np.random.default_rng(np.random.SeedSequence([seed], spawn_key=(_STREAM,)))
    walks_m = np.concatenate([course_of(layout).pose.translation[:, :2] for layout in (UAV, UGV)])
    footprints = [Footprint((e, n), w, d, h, float(np.deg2rad(yaw))) for e, n, w, d, h, yaw in _BUILDINGS]
    parts = [ground_mesh(walks_m.min(axis=0) - GROUND_M, walks_m.max(axis=0) + GROUND_M, GROUND_STEP_M)]
    middles_m = ground_height_m(np.array([at.centre_m for at in footprints]))
    parts += [building(rng, at, height) for at, height in zip(footprints, middles_m, strict=True)]
    ground = _FreeGround(walks_m, footprints)
    for count, clear_m, make in (
        (TREES, 3.2, lambda: tree(rng, rng.uniform(5.0, 8.5), rng.uniform(1.5, 2.3), leaves_a_tree)),
        (HEDGES, 2.5, lambda: hedge(rng, rng.uniform([2.5, 0.7, 0.8], [5.0, 1.1, 1.6]), LEAVES_A_HEDGE)),
        (LOW_WALLS, 2.5, lambda: _low_wall(rng)),
        (BENCHES, 1.8, lambda: _bench()),
        (LAMPS, 1.2, lambda: _lamp()),
        (STONES, 1.0, lambda: _stone(rng)),
    ):
        for place_m in ground.places_m(rng, count, clear_m):
            height_m = float(ground_height_m(place_m[None])[0])
            parts.append(placed(make(), [*place_m, height_m], rng.uniform(0, 2 * np.pi)))
    return joined(parts)


def ground_mesh(low_m: Float[np.ndarray, "2"], high_m: Float[np.ndarray, "2"], step_m: float) -> Mesh:
    """The ground between two corners, as a grid."""
    east, north = (np.arange(a, b + step_m, step_m) for a, b in zip(low_m, high_m, strict=True))
    place_m = np.stack(np.meshgrid(east, north), axis=-1)
    height_m = ground_height_m(place_m.reshape(-1, 2)).reshape(*place_m.shape[:2], 1)
    node_m = np.concatenate([place_m, height_m], axis=-1)
    corner_m = np.stack([node_m[:-1, :-1], node_m[:-1, 1:], node_m[1:, 1:], node_m[1:, :-1]], axis=2)
    return quads(corner_m.reshape(-1, 4, 3), GRASS)


class _FreeGround:
    """Where nothing stands yet, away from the walks, the markers and the buildings."""

    def __init__(self, walks_m: Float[np.ndarray, "n 2"], footprints: list[Footprint]) -> None:
        self._walks_m = walks_m
        self._walks = KDTree(walks_m)
        self._markers = KDTree(SURVEYED_ENH_M[:, :2])
        self._footprints = footprints
        self._taken: list[tuple[np.ndarray, float]] = []

    def places_m(self, rng: np.random.Generator, count: int, clear_m: float) -> list[Float[np.ndarray, "2"]]:
        """As many places, each `clear_m` from everything."""
        low_m, high_m = self._walks_m.min(axis=0) - 9.0, self._walks_m.max(axis=0) + 9.0
        found = []
        while len(found) < count:
            place_m = rng.uniform(low_m, high_m)
            if self._is_free(place_m, clear_m):
                self._taken.append((place_m, clear_m))
                found.append(place_m)
        return found

    def _is_free(self, place_m: Float[np.ndarray, "2"], clear_m: float) -> bool:
        near = (
            self._walks.query(place_m)[0] < clear_m + 0.6
            or self._markers.query(place_m)[0] < CLEAR_OF_MARKERS_M
            or any(at.distance_m(place_m[None])[0] < clear_m for at in self._footprints)
            or any(np.linalg.norm(place_m - other) < 0.8 * (clear_m + other_m) for other, other_m in self._taken)
        )
        return not near


def _low_wall(rng: np.random.Generator) -> Mesh:
    length_m, height_m = rng.uniform(2.5, 5.0), rng.uniform(0.5, 1.1)
    wall = box(
        [-length_m / 2, -0.18, -0.6],
        [length_m / 2, 0.18, height_m],
        BRICK,
        rng.uniform(0.7, 1.1) * rng.uniform(0.9, 1.1, 3),
    )
    cope = box([-length_m / 2 - 0.05, -0.24, height_m], [length_m / 2 + 0.05, 0.24, height_m + 0.08], CONCRETE)
    return joined([wall, cope])


def _bench() -> Mesh:
    legs = [box([x - 0.05, -0.22, -0.3], [x + 0.05, 0.22, 0.42], METAL, (0.6, 0.6, 0.6)) for x in (-0.7, 0.7)]
    seat = box([-0.95, -0.25, 0.42], [0.95, 0.2, 0.48], WOOD)
    back = box([-0.95, 0.2, 0.55], [0.95, 0.25, 0.95], WOOD)
    return joined([*legs, seat, back])


def _lamp() -> Mesh:
    pole = tapered_column([0.09, 0.06], [-0.4, 4.2], METAL, (0.7, 0.7, 0.7))
    head = box([-0.25, -0.12, 4.2], [0.25, 0.12, 4.38], METAL, (0.5, 0.5, 0.5))
    return joined([pole, head, box([-0.2, -0.2, -0.3], [0.2, 0.2, 0.12], CONCRETE)])


def _stone(rng: np.random.Generator) -> Mesh:
    """A block or a bollard: something low with corners."""
    half = rng.uniform(0.15, 0.45, 2)
    tint = rng.uniform(0.6, 1.1) * rng.uniform(0.92, 1.08, 3)
    return box([*-half, -0.5], [*half, rng.uniform(0.3, 0.9)], int(rng.choice([CONCRETE, WOOD])), tint)
