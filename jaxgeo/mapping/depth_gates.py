"""Which pixels of a depth image to believe, and how far."""

import dataclasses

import cv2
import numpy as np
from jaxtyping import Float

from jaxgeo.errors import ScanError
from jaxgeo.mapping.rgbd_camera import RgbdCamera


@dataclasses.dataclass(frozen=True)
class DepthGates:
    """Depths that pass.

    Attributes:
        min_m, max_m: along the optical axis. Structured light and stereo lose accuracy with the square of the depth.
        edge_share: a pixel whose 3 x 3 neighbourhood jumps by more than this share of its depth lies on an edge, where
            sensors mix the two surfaces (or, for stereo, widen the nearer one).
        max_incidence_rad: between the viewing ray and the surface's normal.
        noise_m, noise_per_m: standard deviation of a depth z, `noise_m + noise_per_m z^2`. The defaults lie between
            the Kinect of Khoshelham and Elberink (Sensors 2012), 0.0014 z^2, and small stereo cameras.
    """

    min_m: float = 0.3
    max_m: float = 5.0
    edge_share: float = 0.04
    max_incidence_rad: float = float(np.deg2rad(80.0))
    noise_m: float = 0.003
    noise_per_m: float = 0.0025

    def __post_init__(self) -> None:
        if not 0.0 <= self.min_m < self.max_m:
            raise ScanError(
                f"depth gates: from {self.min_m} m to {self.max_m} m is no range; expected 0 <= nearest < farthest."
            )

    def sigma_m(self, depth_m: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        """Standard deviation of depths, metres."""
        return self.noise_m + self.noise_per_m * depth_m**2


def gated_depth(
    depth_m: Float[np.ndarray, "h w"], camera: RgbdCamera, gates: DepthGates, source: str
) -> Float[np.ndarray, "h w"]:
    """The depth image with 0 for every pixel that fails a gate: range, edges, incidence, reach of the lens model.

    Raises:
        ScanError: the image is not of the camera's size.
    """
    camera.check(depth_m.shape, source)
    known = np.isfinite(depth_m) & (depth_m > 0.0)
    depth = np.where(known, depth_m, 0.0).astype(np.float32)
    square = np.ones((3, 3), dtype=np.uint8)
    highest = cv2.dilate(depth, square)  # of depths out of range too: their edges are edges
    lowest = cv2.erode(np.where(known, depth, np.float32(np.inf)), square)
    seen = known & (depth >= gates.min_m) & (depth <= gates.max_m) & camera.reached
    seen &= highest - lowest <= gates.edge_share * depth
    depth[~seen] = 0.0
    depth[seen & (_incidence_cosine(depth, camera, gates.edge_share) < np.cos(gates.max_incidence_rad))] = 0.0
    return depth


def _incidence_cosine(
    depth: Float[np.ndarray, "h w"], camera: RgbdCamera, edge_share: float
) -> Float[np.ndarray, "h w"]:
    """|cos| of the angle between ray and normal, from depths averaged over 5 x 5 pixels; 1 where it is not known.

    One pixel's step is of the size of the depth noise, hence the average and differences over eight pixels; it is not
    known where such a difference spans an edge.
    """
    step = 4
    weight = cv2.blur((depth > 0.0).astype(np.float32), (5, 5))
    smooth = cv2.blur(depth, (5, 5)) / np.maximum(weight, 1e-6)
    points = camera.points_cam_m(np.where(depth > 0.0, smooth, 0.0)).astype(np.float32)
    cosine = np.ones_like(depth)
    if min(depth.shape) <= 2 * step:
        return cosine
    inner = (slice(step, -step), slice(step, -step))
    right, left = points[step:-step, 2 * step :], points[step:-step, : -2 * step]
    below, above = points[2 * step :, step:-step], points[: -2 * step, step:-step]
    normal = np.cross(right - left, below - above)
    known = (right[..., 2] > 0) & (left[..., 2] > 0) & (below[..., 2] > 0) & (above[..., 2] > 0)
    most = edge_share * step * depth[inner]  # the gate's own slope: so much over the two pixels' width of its square
    known &= (np.abs(right - left)[..., 2] <= most) & (np.abs(below - above)[..., 2] <= most)
    length = np.linalg.norm(normal, axis=-1) * np.linalg.norm(points[inner], axis=-1)
    across = np.abs(np.sum(normal * points[inner], axis=-1)) / np.maximum(length, 1e-20)
    cosine[inner] = np.where(known, across, 1.0)
    return cosine
