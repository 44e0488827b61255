"""Graduated non-convexity: false closures rejected without a good start.

Truncated least squares (an edge costs its squared residual, at most the width squared) is first replaced by a convex
stand-in, which is then made ever more like it; between two changes the weights have a closed form (Yang, Antonante,
Tzoumas and Carlone, Graduated non-convexity for robust spatial perception, RA-L 2020, eqs. 12 to 14 and remark 5).
"""

import numpy as np
from jaxtyping import Float

# From the paper: larger factors lose closures on hard graphs.
FACTOR = 1.4
# The hardest stand-in to begin with: it doubts closures past 0.7 of the width, and rejects those past 1.4 of it.
LARGEST_FIRST = 1.0


def first_control(squared: Float[np.ndarray, "m"], width: float) -> float:
    """The control parameter at which the stand-in is convex up to the given squared residuals' median.

    The paper asks for convexity up to the largest one. But the chain of trusted odometry counts fully from the
    beginning, and closures that start at next to no weight would let a good start drift back to it.
    """
    middle = float(np.median(squared)) if squared.size else 0.0
    return min(width**2 / (2.0 * middle - width**2), LARGEST_FIRST) if middle > width**2 else LARGEST_FIRST


def truncated_weights(squared: Float[np.ndarray, "m"], width: float, control: float) -> Float[np.ndarray, "m"]:
    """Weights of the stand-in: 1 for small residuals, 0 for large ones, in between falling as one over the residual.

    `control` infinite: those of truncated least squares itself.
    """
    ratio = squared / width**2
    if control == np.inf:
        return np.where(ratio < 1.0, 1.0, 0.0)
    between = np.sqrt(control * (control + 1.0) / np.maximum(ratio, 1e-300)) - control
    return np.where(ratio >= (control + 1.0) / control, 0.0, np.where(ratio <= control / (control + 1.0), 1.0, between))
