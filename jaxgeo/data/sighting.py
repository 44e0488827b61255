"""Sightings: single detections of markers, as image corners or as poses in the body frame."""

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int


class CornerSightings(eqx.Module):
    """Marker corners in images, before any pose is known.

    Attributes:
        stamp_s: (n,) seconds, on the trajectory's clock.
        camera: (n,) camera names (NumPy str), as in the rig.
        marker: (n,) decoded ids (NumPy str); empty where unknown.
        corners_px: (n, 4, 2) raw (distorted) pixels, in the marker-frame order
            (-s/2,-s/2), (s/2,-s/2), (s/2,s/2), (-s/2,s/2).
        source: where row i came from, for messages: "file:line".
        covariance_px2: (n, 8, 8) of the corner coordinates (u0, v0, u1, v1, ..); None where not known, rows of NaN
            where only some are.
    """

    stamp_s: Float[np.ndarray, "n"]
    camera: np.ndarray
    marker: np.ndarray
    corners_px: Float[np.ndarray, "n 4 2"]
    source: np.ndarray
    covariance_px2: Float[np.ndarray, "n 8 8"] | None = None

    def __len__(self) -> int:
        return self.stamp_s.shape[0]


class Sightings(eqx.Module):
    """Marker poses `T_body_marker` seen from the body.

    Attributes:
        stamp_s: (n,) seconds, on the trajectory's clock.
        marker: (n,) decoded ids (NumPy str); empty where unknown.
        t_body_marker_m: (n, 3) marker centre in the body frame.
        quat_body_marker_wxyz: (n, 4); rows of NaN where only the position is known.
        covariance: (n, 6, 6), body axes, of the error (translation added, rotation multiplied on the left).
            Where only the position is known the rotation rows and columns are zero.
        ambiguous: (n,) True where the second planar solution fits nearly as well.
        reprojection_px: (n,) RMS reprojection error of the chosen solution; NaN where there were no pixels.
        source: (n,) where the row came from, for messages.
    """

    stamp_s: Float[np.ndarray, "n"]
    marker: np.ndarray
    t_body_marker_m: Float[np.ndarray, "n 3"]
    quat_body_marker_wxyz: Float[np.ndarray, "n 4"]
    covariance: Float[np.ndarray, "n 6 6"]
    ambiguous: Bool[np.ndarray, "n"]
    reprojection_px: Float[np.ndarray, "n"]
    source: np.ndarray

    def __len__(self) -> int:
        return self.stamp_s.shape[0]

    def take(self, index: Int[np.ndarray, "m"]) -> "Sightings":
        """The chosen rows, in the order of `index`."""
        return Sightings(
            stamp_s=self.stamp_s[index],
            marker=self.marker[index],
            t_body_marker_m=self.t_body_marker_m[index],
            quat_body_marker_wxyz=self.quat_body_marker_wxyz[index],
            covariance=self.covariance[index],
            ambiguous=self.ambiguous[index],
            reprojection_px=self.reprojection_px[index],
            source=self.source[index],
        )
