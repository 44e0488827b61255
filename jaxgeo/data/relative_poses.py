"""Relative poses between any two poses of a graph: odometry steps and loop closures alike."""

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int


class RelativePoses(eqx.Module):
    """Measured motions `T_first_second`, m of them.

    Attributes:
        first, second: (m,) rows of the poses they tie.
        t_m: (m, 3) the second pose's origin in the first's frame.
        quat_wxyz: (m, 4) unit quaternions, second to first.
        information: (m, 6, 6) of `Log(measured^-1 T_first^-1 T_second)`, (translation, rotation), m and rad.
    """

    first: Int[np.ndarray, "m"]
    second: Int[np.ndarray, "m"]
    t_m: Float[np.ndarray, "m 3"]
    quat_wxyz: Float[np.ndarray, "m 4"]
    information: Float[np.ndarray, "m 6 6"]

    def __len__(self) -> int:
        return len(self.first)

    def take(self, index: Int[np.ndarray, "k"]) -> "RelativePoses":
        """The chosen rows, in the order of `index`."""
        return RelativePoses(
            self.first[index], self.second[index], self.t_m[index], self.quat_wxyz[index], self.information[index]
        )
