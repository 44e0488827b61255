"""A world to be seen: the site's mesh, its textures and its sunlight, with the marker's board where it stands."""

import functools

from jaxgeo.simulate.sensors.board import MarkerVisit, board_mesh
from jaxgeo.simulate.sensors.mesh import Mesh, joined
from jaxgeo.simulate.sensors.ray_casting import Scene
from jaxgeo.simulate.sensors.shadows import SunMap, sun_map
from jaxgeo.simulate.sensors.site import site_mesh
from jaxgeo.simulate.sensors.texture import Textures, textures_of


class World:
    """One site. Everything is worked out when it is first needed: scans need no textures.

    Args:
        seed: of mesh and textures.
        mesh: another site than `site_mesh(seed)`.
    """

    def __init__(self, seed: int, mesh: Mesh | None = None) -> None:
        self.seed = seed
        self._mesh = mesh
        self._scene: tuple[MarkerVisit | None, Scene] | None = None

    @functools.cached_property
    def mesh(self) -> Mesh:
        """The site without the board."""
        return site_mesh(self.seed) if self._mesh is None else self._mesh

    @functools.cached_property
    def textures(self) -> Textures:
        """Colours of its surfaces."""
        return textures_of(self.seed)

    @functools.cached_property
    def sun(self) -> SunMap:
        """Where the sun shines. The board, which stands for half a minute, throws no shadow."""
        return sun_map(self.scene(None))

    def scene(self, visit: MarkerVisit | None) -> Scene:
        """Everything that rays can meet; the board's triangles come last. The last scene is kept."""
        kept = self._scene
        if kept is None or kept[0] is not visit:
            mesh = self.mesh if visit is None else joined([self.mesh, board_mesh(visit.T_local_marker)])
            kept = self._scene = (visit, Scene(mesh))
        return kept[1]


@functools.lru_cache(maxsize=1)
def world_of(seed: int) -> World:
    """The world of a seed, kept for the next recording in it."""
    return World(seed)
