"""What a detector finds in one image."""

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int


class Detections(eqx.Module):
    """Decoded markers of one image.

    Attributes:
        family: (m,) names of dictionaries, as in `families`.
        marker: (m,) ids within the family.
        corners_px: (m, 4, 2) raw (distorted) pixels; the centre of the first pixel is (0, 0). Order: that of
            `CornerSightings`, (-s/2,-s/2), (s/2,-s/2), (s/2,s/2), (-s/2,s/2) in the marker's frame, which is
            x right, y up, z out of the printed face: lower left, lower right, upper right, upper left of the print.
        covariance_px2: (m, 8, 8) of the corner coordinates (u0, v0, u1, v1, ..).
        hamming: (m,) code bits that had to be corrected.
        margin: (m,) how clearly black and white part over all cells: 0 not at all, 1 perfectly.
    """

    family: np.ndarray
    marker: Int[np.ndarray, "m"]
    corners_px: Float[np.ndarray, "m 4 2"]
    covariance_px2: Float[np.ndarray, "m 8 8"]
    hamming: Int[np.ndarray, "m"]
    margin: Float[np.ndarray, "m"]

    def __len__(self) -> int:
        return self.marker.shape[0]


def no_detections() -> Detections:
    """Of an image without markers."""
    return Detections(
        family=np.array([], dtype=str),
        marker=np.zeros(0, dtype=np.int64),
        corners_px=np.zeros((0, 4, 2)),
        covariance_px2=np.zeros((0, 8, 8)),
        hamming=np.zeros(0, dtype=np.int64),
        margin=np.zeros(0),
    )
