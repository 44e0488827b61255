"""The survey: named points in a national grid, or in a site's own frame."""

import equinox as eqx
import numpy as np
from jaxtyping import Float


class Survey(eqx.Module):
    """Surveyed locations.

    Attributes:
        name: location names, unique.
        enh_m: (n, 3) easting, northing, height: always in this order here, whatever the file's was.
        sigma_m: (n, 3) standard deviations, same order.
        quat_grid_marker_wxyz: (n, 4) marker axes to (E, N, h) axes; rows of NaN where only the position was surveyed.
        sigma_rot_rad: (n, 3) standard deviations of that rotation, about the grid axes; NaN where there is none.
        crs: `EPSG:<code>` (compound: `EPSG:<horizontal>+<vertical>`), or `local` for a site frame without a datum.
    """

    name: tuple[str, ...]
    enh_m: Float[np.ndarray, "n 3"]
    sigma_m: Float[np.ndarray, "n 3"]
    quat_grid_marker_wxyz: Float[np.ndarray, "n 4"]
    sigma_rot_rad: Float[np.ndarray, "n 3"]
    crs: str

    def __len__(self) -> int:
        return len(self.name)

    def index(self, name: str) -> int:
        return self.name.index(name)
