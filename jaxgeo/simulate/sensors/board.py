"""The marker before its camouflage: shown at one place at a time, while the rig looks at it.

What is moved is the marker, clear but for its reflector; the camouflage behind it is each place's own.
"""

import dataclasses
import functools

import cv2
import numpy as np
from jaxtyping import Float, Float32
from scipy.spatial.transform import RigidTransform, Rotation

from jaxgeo.simulate.camouflage import camouflage
from jaxgeo.simulate.course import course_of
from jaxgeo.simulate.layout import LOCATIONS
from jaxgeo.simulate.sensors.ground import MARKER_ABOVE_GROUND_M
from jaxgeo.simulate.sensors.mesh import Mesh, box, joined
from jaxgeo.simulate.sensors.texture import BOARD, METAL
from jaxgeo.simulate.session import SimulatedSession

# The board is there from so long before a visit until so long after it.
MARGIN_S = 3.0
SIDE_M, THICKNESS_M = 1.2, 0.03
TEXEL_M = 0.004
_ROWS = 30_000
_STREAM = 300


@dataclasses.dataclass(frozen=True)
class MarkerVisit:
    """One stay before the marker.

    Attributes:
        location: its name.
        arrive_s, leave_s: of the rig, seconds from the session's start.
        T_local_marker: pose of the marker: x right, y up, z out of the print.
    """

    location: str
    arrive_s: float
    leave_s: float
    T_local_marker: RigidTransform

    def shows(self, time_s: float) -> bool:
        """Whether the board stands there at this time."""
        return self.arrive_s - MARGIN_S <= time_s <= self.leave_s + MARGIN_S


def marker_visits(session: SimulatedSession) -> tuple[MarkerVisit, ...]:
    """Where the marker is shown, in the order visited: upright, facing, level, the middle of where the rig stands."""
    walk = course_of(session.layout).walk
    visits = []
    for location, arrive_s, leave_s in zip(session.layout.order, walk.arrive_s, walk.leave_s, strict=True):
        marker_m = session.marker_enh_m[location]
        east, north, _ = walk.pose(np.linspace(arrive_s, leave_s, 20)).translation.mean(axis=0) - marker_m
        out = np.array([east, north, 0.0]) / np.hypot(east, north)
        axes = np.column_stack([[-out[1], out[0], 0.0], [0.0, 0.0, 1.0], out])
        pose = RigidTransform.from_components(marker_m, Rotation.from_matrix(axes))
        visits.append(MarkerVisit(location, float(arrive_s), float(leave_s), pose))
    return tuple(visits)


def board_mesh(T_local_marker: RigidTransform) -> Mesh:
    """The board and its two legs, with the marker's plane as its front."""
    half = SIDE_M / 2
    board = box([-half, -half, -THICKNESS_M], [half, half, 0.0], BOARD)
    foot_m = -MARKER_ABOVE_GROUND_M - 0.3
    legs = [box([x - 0.03, foot_m, -0.08], [x + 0.03, 0.3, -THICKNESS_M - 0.001], METAL) for x in (-0.4, 0.4)]
    mesh = joined([board, *legs])
    return dataclasses.replace(mesh, vertex_m=T_local_marker.apply(mesh.vertex_m))


@functools.lru_cache(maxsize=8)
def board_print(seed: int, location: str) -> Float32[np.ndarray, "s s 3"]:
    """Camouflage of the board's front, B, G, R, 0 to 255, from its upper left as seen from before it."""
    texels = round(SIDE_M / TEXEL_M)
    stream = np.random.SeedSequence([seed], spawn_key=(_STREAM, LOCATIONS.index(location)))
    return camouflage(np.random.default_rng(stream), texels, texels)


def board_bgr(seed: int, visit: MarkerVisit, point_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n 3"]:
    """Colour of points on the board."""
    own_m = visit.T_local_marker.inv().apply(point_m)
    at = np.stack([own_m[:, 0] + SIDE_M / 2, SIDE_M / 2 - own_m[:, 1]], axis=-1) / TEXEL_M - 0.5
    x, y = at.astype(np.float32).T[:, :, None]
    canvas = board_print(seed, visit.location)
    # OpenCV looks up images of fewer than 32767 rows only.
    parts = [
        cv2.remap(canvas, x[i : i + _ROWS], y[i : i + _ROWS], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        for i in range(0, len(x), _ROWS)
    ]
    return np.concatenate(parts)[:, 0] if parts else np.zeros((0, 3), np.float32)
