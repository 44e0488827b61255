"""A wall that XLA's loop fusion does not cross.

On CPUs XLA fuses elementwise work into each of its consumers and repeats it there; a Hessian-vector product of a chain
ran three times longer than its arithmetic. `lax.optimization_barrier` is taken away before fusion (jaxlib 0.10), a
conditional is not.
"""

import jax
from jaxtyping import Array, Bool, PyTree


@jax.custom_jvp
def compute_once(always: Bool[Array, ""], x: PyTree) -> PyTree:
    """`x`, computed once and kept. `always` must be a run-time value that is true; derivatives pass through alike."""
    return jax.lax.cond(always, lambda v: v, lambda v: jax.tree.map(lambda c: 2.0 * c + 1.0, v), x)


@compute_once.defjvp
def _compute_once_jvp(primals: tuple[Array, PyTree], tangents: tuple[Array, PyTree]) -> tuple[PyTree, PyTree]:
    always, x = primals
    return compute_once(always, x), compute_once(always, tangents[1])
