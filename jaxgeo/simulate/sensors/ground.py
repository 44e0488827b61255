"""The ground of the simulated site: through its surveyed places, a board's height below the markers."""

import functools

import numpy as np
from jaxtyping import Float
from scipy.interpolate import RBFInterpolator

from jaxgeo.simulate.layout import SURVEYED_ENH_M

# The surveyed point is the marker's middle, and the marker hangs on a board that stands on the ground.
MARKER_ABOVE_GROUND_M = 0.75
RIPPLE_M, RIPPLE_LENGTH_M = 0.04, 2.3


def ground_height_m(place_m: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n"]:
    """Height of the ground at these places, local frame: a thin plate through the places, with some undulation."""
    ripple = np.sin(place_m[:, 0] / RIPPLE_LENGTH_M) * np.cos(1.3 * place_m[:, 1] / RIPPLE_LENGTH_M)
    return _plate()(place_m) - MARKER_ABOVE_GROUND_M + RIPPLE_M * ripple


@functools.cache
def _plate() -> RBFInterpolator:
    return RBFInterpolator(SURVEYED_ENH_M[:, :2], SURVEYED_ENH_M[:, 2], kernel="thin_plate_spline")
