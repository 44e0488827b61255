"""The visits' small system as the odometry alone has it: closed forms for a quick order and a quick gate.

One linearisation serves every hypothesis and every visit left out. The drift is the prior's median noise, V, times the
square of a common factor f of even spacing in its logarithm: the level is integrated out, the ratios are not learned.
"""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from calibration.faults.session import Session
from calibration.learn import FamilyPriorArrays, LearnOptions
from jaxgeo.graph.anchor_table import AnchorTable
from jaxgeo.graph.chain import Chain
from jaxgeo.graph.components import BIAS_ROT, BIAS_TRANS, LOG_SCALE, ROT, TRANS, TURN
from jaxgeo.solve.anchor_system import anchor_system, chain_linearised
from jaxgeo.solve.ensemble_fold import observe, start_of

FACTORS = np.exp(np.linspace(-3.0, 5.0, 17))
# Standard deviations, whitened, that make a visit's rows worthless.
WORTHLESS = 1e4
_USED = np.array([*range(TRANS.start, TRANS.stop), *range(ROT.start, ROT.stop), TURN, LOG_SCALE, BIAS_TRANS, BIAS_ROT])


@dataclasses.dataclass(frozen=True)
class SmallSystem:
    """Of k visits, m = 3k rows.

    Attributes:
        point_m: (k, 3) markers as the coarse fit has them.
        weight: (k, 3, 3) upper roots W of the visits' information; whitened rows are W times metres.
        frame: (m, 6) whitened effect of the frame's motions.
        base: (m, m) whitened covariance of the visits; `drift` (m, m) of the odometry, factor 1.
    """

    point_m: Float[np.ndarray, "k 3"]
    weight: Float[np.ndarray, "k 3 3"]
    frame: Float[np.ndarray, "m 6"]
    base: Float[np.ndarray, "m m"]
    drift: Float[np.ndarray, "m m"]

    def projected(self, factor: float, without: int | None = None) -> tuple[Float[np.ndarray, "m m"], float]:
        """P = M^-1 - M^-1 X (X'M^-1 X)^-1 X'M^-1 of M = R + f^2 V, and -1/2 log |M| |X'M^-1 X|.

        One visit's rows may be made worthless.
        """
        covariance = self.base + factor**2 * self.drift
        if without is not None:
            rows = np.arange(3 * without, 3 * without + 3)
            covariance[rows, rows] += WORTHLESS**2
        inverse = np.linalg.inv(covariance)
        pulled = inverse @ self.frame
        information = self.frame.T @ pulled
        log_det = np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(information)[1]
        return inverse - pulled @ np.linalg.solve(information, pulled.T), -0.5 * float(log_det)

    def whitened(self, metres: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "m"]:
        return np.einsum("kab,kb->ka", self.weight, metres).reshape(-1)


def small_system(session: Session) -> SmallSystem:
    """At the coarse fit of the labels as told."""
    found = _small_system(session.chain, session.table, session.prior, session.options)
    point, effect, weight, base, drift = (np.asarray(x) for x in found)
    k, m = len(session.anchors), 3 * len(session.anchors)
    frame = np.einsum("kab,kbc->kac", weight[:k], effect[:k]).reshape(m, 6)
    return SmallSystem(point[:k], weight[:k], frame, base[:m, :m], drift[:m, :m])


@functools.partial(jax.jit, static_argnames="options")
def _small_system(
    chain: Chain, table: AnchorTable, prior: FamilyPriorArrays, options: LearnOptions
) -> tuple[Array, Array, Array, Array, Array]:
    # The loss's width is not read: sessions are weighed without a robust loss.
    observed, origin = observe(chain, table, table.real, jnp.zeros_like(table.real), jnp.ones(()), options.fold)
    state = start_of(observed)
    system = anchor_system(state, chain_linearised(state, observed.graph), observed)
    sigma = jnp.exp(prior.mean + prior.per_log_span * jnp.log(observed.span_m))[_USED]
    drift = jnp.einsum("c,cxy->xy", sigma**2, system.components[_USED])
    weight = observed.graph.anchors.sqrt_information
    return system.point_m + origin[None], system.point_jacobian, weight, system.base, drift
