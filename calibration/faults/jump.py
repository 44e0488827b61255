"""A jump of the odometry between two visits (slipped, bumped, lost track): what a shifted visit must be told from.

A jump before visit j moves the markers of all visits from j on alike, by a translation and a rotation that no noise
model expects; its effect on the whitened rows has the covariance

    J E J',     E = s^2 mean of G G' over the edges between      G' the world-frame effect of a step there

which joins that of the visits themselves. The noise is learned anew beside it, from the same contrasts, linearised
where the trajectory settles without it; `s` is any of the sizes that a location may be shifted by.
"""

import functools
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from calibration.faults.evidence import LOSS_WIDTH, log_mean_evidence
from calibration.faults.hypotheses import Hypothesis
from calibration.faults.session import Session
from calibration.faults.weigh import location_shifts_m
from calibration.fit import STARTS, fit_family
from calibration.learn import FamilyPriorArrays, LearnOptions, learn_fold
from calibration.observations import learnable
from calibration.reml import contrasts
from jaxgeo.graph.anchor_table import AnchorTable
from jaxgeo.graph.chain import Chain
from jaxgeo.graph.components import N_COMPONENTS, ROT, TRANS
from jaxgeo.solve.anchor_system import anchor_system, chain_linearised

# Hypotheses and sizes a call: one compiled program serves any number of them.
_BATCH = 16


def jump_log_bayes(session: Session, jumps: Sequence[Hypothesis]) -> list[float]:
    """Log Bayes factor of each jump over the session without any; -inf where no noise was found beside it."""
    size_m = location_shifts_m(session.site)
    lever_m = float(size_m[-1])
    jobs = [(h.visits[1], s) for h in jumps for s in size_m]
    found: list[float] = []
    for start in range(0, len(jobs), _BATCH):
        some = jobs[start : start + _BATCH]
        full = some + [some[-1]] * (_BATCH - len(some))
        first, scale_m = (jnp.asarray(column) for column in zip(*full, strict=True))
        log_bayes = _jump_evidence(
            session.chain, session.table, session.prior, first, scale_m, jnp.asarray(lever_m), session.options
        )
        found += np.asarray(log_bayes)[: len(some)].tolist()
    by_jump = np.array(found).reshape(len(jumps), len(size_m))
    return (np.logaddexp.reduce(by_jump, axis=1) - np.log(len(size_m))).tolist()


@functools.partial(jax.jit, static_argnames="options")
def _jump_evidence(
    chain: Chain,
    table: AnchorTable,
    prior: FamilyPriorArrays,
    first: Int[Array, "b"],
    scale_m: Float[Array, "b"],
    lever_m: Float[Array, ""],
    options: LearnOptions,
) -> Float[Array, "b"]:
    """Of jumps before the visits `first`, over none; a jump of `scale_m` turns by `scale_m / lever_m`."""
    learned = learn_fold(chain, table, prior, table.real, jnp.asarray(LOSS_WIDTH), options)
    observed, state = learned.fold.observed, learned.fold.state
    system = anchor_system(state, chain_linearised(state, observed.graph), observed)
    masks = learnable(table, table.real, options.observations)
    found = contrasts(system, masks)
    k, d, _ = system.jacobian.shape
    starts = learned.prior.mean[:, None] + jnp.asarray(STARTS)[None, :, None]
    starts = jnp.broadcast_to(starts, (len(prior.free), len(STARTS), N_COMPONENTS))
    white, distance = system.drift.white, system.drift.distance_m

    def evidence(first: Int[Array, ""], scale_m: Float[Array, ""]) -> Float[Array, ""]:
        each = white[:, first] - white[:, first - 1]
        between_m = jnp.maximum(distance[first] - distance[first - 1], 1e-9)
        covariance = each[TRANS].sum(axis=0) + each[ROT].sum(axis=0) / lever_m**2
        after = masks.learn * (jnp.arange(k) >= first).astype(float)
        moved = found.basis.T @ (system.jacobian * after[:, None, None]).reshape(k * d, 6)
        extra = scale_m**2 / between_m * moved @ covariance @ moved.T
        fit = fit_family(eqx.tree_at(lambda f: f.base, found, found.base + extra), learned.prior, starts)
        return log_mean_evidence(fit)

    without = evidence(jnp.array(1), jnp.zeros(()))
    return jax.lax.map(lambda job: evidence(*job), (first, scale_m)) - without
