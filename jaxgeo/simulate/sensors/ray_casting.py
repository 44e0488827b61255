"""Rays against triangle meshes. Open3D lives here."""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, Int

from jaxgeo.errors import InputError
from jaxgeo.simulate.sensors.mesh import Mesh


@dataclasses.dataclass(frozen=True)
class Hits:
    """What rays met first.

    Attributes:
        t: (n,) in lengths of the ray's direction; infinite where it met nothing.
        triangle: (n,) of the scene's mesh; -1 where it met nothing.
        normal: (n, 3) unit, of the triangle's outer side, whichever side was met.
    """

    t: Float32[np.ndarray, "n"]
    triangle: Int[np.ndarray, "n"]
    normal: Float32[np.ndarray, "n 3"]

    @property
    def met(self) -> Bool[np.ndarray, "n"]:
        """(n,) the ray met something."""
        return self.triangle >= 0


class Scene:
    """One mesh, ready to be met by rays. In float32, as Embree counts: keep coordinates below a few hundred metres."""

    def __init__(self, mesh: Mesh) -> None:
        """Build the tree.

        Raises:
            InputError: Open3D is not installed.
        """
        self.mesh = mesh
        self._core, scene = _open3d()
        self._scene = scene()
        self._scene.add_triangles(
            self._core.Tensor(mesh.vertex_m.astype(np.float32)), self._core.Tensor(mesh.triangle.astype(np.uint32))
        )

    def cast(
        self, origin_m: Float32[np.ndarray, "... 3"], direction: Float32[np.ndarray, "n 3"], threads: int = 1
    ) -> Hits:
        """The first triangle along each ray; one origin for all, or one each."""
        rays = np.concatenate([np.broadcast_to(origin_m, direction.shape), direction], axis=-1, dtype=np.float32)
        found = self._scene.cast_rays(self._core.Tensor(rays), nthreads=threads)
        t = found["t_hit"].numpy()
        triangle = np.where(np.isfinite(t), found["primitive_ids"].numpy().astype(np.int64), -1)
        normal = found["primitive_normals"].numpy()
        return Hits(t, triangle, normal)


def _open3d() -> tuple[Any, Any]:
    """Tensors and scenes of the library, or a refusal that says how to install it."""
    try:
        import open3d
    except ImportError as failure:
        raise InputError(
            f"simulating sensors needs open3d, which cannot be imported ({failure}): pip install 'jaxgeo[cloud]'."
        ) from None
    return open3d.core, open3d.t.geometry.RaycastingScene
