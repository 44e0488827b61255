"""Products along a path, all of them at once: log2(n) NumPy steps in place of a loop over n."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

Table = Float[np.ndarray, "n c"]


def prefix_products(compose: Callable[[Table, Table], Table], factors: Table) -> Table:
    """Row k is factor_0 ∘ factor_1 ∘ … ∘ factor_k, by doubling (Hillis and Steele 1986).

    Args:
        compose: earlier, later -> their product, row by row; associative.
        factors: (n, c) one a row.
    """
    product, reach = factors, 1
    while reach < len(product):
        product = np.concatenate([product[:reach], compose(product[:-reach], product[reach:])])
        reach *= 2
    return product


def chain(steps: RigidTransform) -> RigidTransform:
    """The poses that the steps make one after the other, the first at the origin of its own map."""
    quat = prefix_products(_compose_quaternions, steps.rotation.as_quat())
    attitude = Rotation.from_quat(np.concatenate([[[0.0, 0.0, 0.0, 1.0]], quat]))
    moved = attitude[:-1].apply(steps.translation)
    return RigidTransform.from_components(np.concatenate([np.zeros((1, 3)), np.cumsum(moved, axis=0)]), attitude)


def gauss_markov(
    length_m: Float[np.ndarray, "n"], correlation_m: float, unit: Float[np.ndarray, "n c"]
) -> Float[np.ndarray, "n c"]:
    """First-order Gauss-Markov processes over the path (Ornstein and Uhlenbeck), unit variance, one a column.

    x_0 = u_0, x_k = ρ_k x_(k-1) + √(1 - ρ_k²) u_k, ρ_k = exp(-d_k / correlation length): stationary.

    Args:
        length_m: way d_k from the point before; that of the first is not read.
        unit: independent draws u of unit variance.
    """
    rho = np.exp(-length_m / correlation_m)
    rho[0] = 0.0
    factors = np.column_stack([rho, np.sqrt(-np.expm1(2.0 * np.log(np.maximum(rho, 1e-300))))[:, None] * unit])
    return prefix_products(_compose_recursions, factors)[:, 1:]


def _compose_quaternions(earlier: Table, later: Table) -> Table:
    """Products of unit quaternions xyzw (Hamilton). By hand: SciPy's own checks take ten times as long."""
    (ax, ay, az, aw), (bx, by, bz, bw) = earlier.T, later.T
    return np.stack(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ],
        axis=1,
    )


def _compose_recursions(earlier: Table, later: Table) -> Table:
    """x -> ρ x + u, the earlier first."""
    rho = later[:, :1]
    return np.column_stack([earlier[:, :1] * rho, rho * earlier[:, 1:] + later[:, 1:]])
