"""Trees, bushes and hedges: trunks, and crowns of many small leaves."""

import numpy as np
from jaxtyping import Float

from jaxgeo.simulate.sensors.mesh import Mesh, joined, tapered_column
from jaxgeo.simulate.sensors.texture import BARK, LEAF

LEAF_M = 0.11


def tree(rng: np.random.Generator, height_m: float, crown_m: float, leaves: int) -> Mesh:
    """A tree on the origin: a trunk, and blobs of leaves within `crown_m` of its axis."""
    trunk_m = rng.uniform(0.11, 0.2)
    lean = rng.uniform(-0.02, 0.02, 2) * height_m
    trunk = tapered_column([1.5 * trunk_m, trunk_m, 0.8 * trunk_m], [-0.5, 0.3, 0.75 * height_m], BARK)
    trunk.vertex_m[:, :2] += np.outer(np.clip(trunk.vertex_m[:, 2] / height_m, 0, 1), lean)
    blobs = rng.integers(5, 9)
    angle, away = rng.uniform(0, 2 * np.pi, blobs), rng.uniform(0.0, 0.6, blobs) * crown_m
    up_m = rng.uniform(0.5, 0.9, blobs) * height_m
    middle_m = np.column_stack([away * np.cos(angle) + lean[0], away * np.sin(angle) + lean[1], up_m])
    radius_m = np.minimum(rng.uniform(0.35, 0.6, blobs) * crown_m, crown_m - away)
    blob = rng.integers(blobs, size=leaves)
    return joined([trunk, _leaves(rng, middle_m[blob], radius_m[blob, None] * [1.0, 1.0, 0.8])])


def hedge(rng: np.random.Generator, size_m: Float[np.ndarray, "3"], leaves: int) -> Mesh:
    """A clipped hedge on the origin, along x: leaves on its sides and top."""
    middle_m = rng.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 1.0], (leaves, 3))
    face = rng.integers(5, size=leaves)  # two ends, two sides, the top
    axis = face // 2
    middle_m[np.arange(leaves), axis] = np.where(face == 4, 1.0, face % 2 - 0.5)
    return _leaves(rng, middle_m * size_m, np.full((leaves, 3), 0.06))


def _leaves(rng: np.random.Generator, middle_m: Float[np.ndarray, "n 3"], radius_m: Float[np.ndarray, "n 3"]) -> Mesh:
    """A leaf, a triangle any way up, near the surface of the ellipsoid about each of these places."""
    n = len(middle_m)
    way = rng.standard_normal((n, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    place_m = middle_m + radius_m * way * rng.uniform(0.4, 1.0, (n, 1)) ** (1 / 3)
    corner_m = place_m[:, None] + LEAF_M * rng.standard_normal((n, 3, 3)) / 1.5
    shade = rng.uniform(0.55, 1.25) * rng.uniform(0.7, 1.3, (n, 1)) * rng.uniform(0.92, 1.08, 3)
    return Mesh(
        corner_m.reshape(-1, 3),
        np.arange(3 * n).reshape(-1, 3),
        np.full(n, LEAF, np.uint8),
        shade.astype(np.float32),
    )
