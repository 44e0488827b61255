"""Triangle meshes whose triangles know what they are made of."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

WHITE_BGR = (1.0, 1.0, 1.0)
# The faces of a box by the numbers of its corners (bits: x, y, z), counter-clockwise seen from outside.
_FACES = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [1, 3, 7, 5], [3, 2, 6, 7], [2, 0, 4, 6]])


@dataclasses.dataclass(frozen=True)
class Mesh:
    """Triangles, counter-clockwise seen from outside.

    Attributes:
        vertex_m: (v, 3).
        triangle: (t, 3) rows of `vertex_m`.
        material: (t,) of `jaxgeo.simulate.sensors.texture`.
        tint: (t, 3) B, G, R; the material's colour is multiplied by it.
    """

    vertex_m: Float[np.ndarray, "v 3"]
    triangle: Int[np.ndarray, "t 3"]
    material: UInt8[np.ndarray, "t"]
    tint: Float32[np.ndarray, "t 3"]

    def __len__(self) -> int:
        return len(self.triangle)


def quads(corner_m: Float[np.ndarray, "q 4 3"], material: int, tint: Sequence[float] | np.ndarray = WHITE_BGR) -> Mesh:
    """Flat four-sided faces; `tint` of all, or (q, 3)."""
    n = len(corner_m)
    first = 4 * np.arange(n)[:, None]
    triangle = np.concatenate([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])], axis=1).reshape(-1, 3)
    tints = np.repeat(np.broadcast_to(np.asarray(tint, np.float32), (n, 3)), 2, axis=0)
    return Mesh(corner_m.reshape(-1, 3), triangle, np.full(2 * n, material, np.uint8), tints)


def box(
    low_m: Sequence[float], high_m: Sequence[float], material: int, tint: Sequence[float] | np.ndarray = WHITE_BGR
) -> Mesh:
    """A box along the axes."""
    bits = np.arange(8)[:, None] >> np.arange(3) & 1
    corner_m = np.where(bits, np.asarray(high_m, float), np.asarray(low_m, float))
    return quads(corner_m[_FACES], material, tint)


def tapered_column(
    radius_m: Sequence[float],
    height_m: Sequence[float],
    material: int,
    tint: Sequence[float] | np.ndarray = WHITE_BGR,
    sides: int = 8,
) -> Mesh:
    """A column round the z axis with these radii at these heights, open at its ends."""
    angle = 2 * np.pi * np.arange(sides + 1) / sides
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    rings_m = np.stack(
        [np.column_stack([r * ring, np.full(sides + 1, z)]) for r, z in zip(radius_m, height_m, strict=True)]
    )
    low, high = rings_m[:-1], rings_m[1:]
    corner_m = np.stack([low[:, :-1], low[:, 1:], high[:, 1:], high[:, :-1]], axis=2)
    return quads(corner_m.reshape(-1, 4, 3), material, tint)


def placed(mesh: Mesh, position_m: Sequence[float] | np.ndarray, yaw_rad: float = 0.0) -> Mesh:
    """The mesh turned about its z axis, then moved."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return dataclasses.replace(mesh, vertex_m=mesh.vertex_m @ turn.T + np.asarray(position_m))


def joined(meshes: Sequence[Mesh]) -> Mesh:
    """All triangles of some meshes in one, in their order."""
    first = np.cumsum([0, *(len(mesh.vertex_m) for mesh in meshes[:-1])])
    return Mesh(
        np.concatenate([mesh.vertex_m for mesh in meshes]),
        np.concatenate([mesh.triangle + start for mesh, start in zip(meshes, first, strict=True)]),
        np.concatenate([mesh.material for mesh in meshes]),
        np.concatenate([mesh.tint for mesh in meshes]),
    )
