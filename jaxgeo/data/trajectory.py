"""A trajectory: stamped poses of one rigid body."""

import equinox as eqx
import numpy as np
from jaxtyping import Float


class Trajectory(eqx.Module):
    """Stamped body poses `T_map_body`, strictly increasing in time.

    Attributes:
        stamp_s: (n,) seconds, any epoch.
        position_m: (n, 3) of the body origin in the map frame.
        quat_wxyz: (n, 4) unit quaternions, body to map.
    """

    stamp_s: Float[np.ndarray, "n"]
    position_m: Float[np.ndarray, "n 3"]
    quat_wxyz: Float[np.ndarray, "n 4"]

    def __len__(self) -> int:
        return self.stamp_s.shape[0]
