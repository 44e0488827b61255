"""How well a registration of two submaps knows their relative pose."""

import numpy as np
from jaxtyping import Float

from jaxgeo.odometry.registration import Registration

# Points of one wall err together: however many there are, they count as this many independent ones.
_INDEPENDENT = 100


def registration_covariance(
    found: Registration, n_partners: int, floor_m: float, floor_rad: float
) -> Float[np.ndarray, "6 6"]:
    """Covariance of `Log(measured^-1 T_first^-1 T_second)`, (translation, rotation).

    The Gauss-Newton Hessian H of GICP counts every partner as independent, which makes millimetres of every result. Its
    shape is right all the same: along a corridor, or turning in a round room, it is weak. So

        C = n / 100 H^-1 + diag(floor)

    as if the n partners were 100: a direction that all of them see is known to a centimetre, one that only the in-plane
    part of their covariances (a metre, by GICP's convention) holds to decimetres. The floor is what no number of points
    averages out: range bias, and the bending of submaps that were put together with drifting odometry.
    """
    size, axes = np.linalg.eigh(found.information / max(n_partners, 1) * _INDEPENDENT)
    shape = (axes / np.maximum(size, 1e-6)) @ axes.T
    return shape + np.diag([floor_m**2] * 3 + [floor_rad**2] * 3)


def weakest_direction(found: Registration) -> Float[np.ndarray, "3"]:
    """The unit translation, in the source's frame, that the registration holds least."""
    return np.linalg.eigh(found.information[:3, :3])[1][:, 0]
