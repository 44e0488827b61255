"""Marginal likelihood of the visits as a hypothesis labels them: the frame and the noise integrated out.

With r the visits' misclosures, W'W their inverse covariance, X the whitened frame (6 columns) and A the contrasts,
A'X = 0, A'A = 1,

    log p(r | h, theta) = log N(A'W r; 0, A'M(theta)A) - 1/2 log det X'X + log det W
    log E_h             = log mean over the models of  integral p(r | h, theta) p(theta | model) dtheta

the integral by Laplace, as `calibration.fit`. X'X and W count, since hypotheses that leave out other visits are
compared. The noise is integrated out under each hypothesis anew: a fault cannot hide behind the sigma that it inflates,
as r of 15 contrasts is f^15 times as likely under noise f times smaller. The linearisation is where the trajectory
settles under these labels, with a coarse fit and a noise of their own.
"""

import functools
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from calibration.faults.session import Session
from calibration.fit import ModelFit
from calibration.learn import FamilyPriorArrays, Learned, LearnOptions, learn_fold
from jaxgeo.graph.anchor_table import AnchorTable
from jaxgeo.graph.chain import Chain
from jaxgeo.graph.pose_graph import at_anchors
from jaxgeo.solve.anchor_system import AnchorSystem, anchor_system, chain_linearised
from jaxgeo.solve.ensemble import solve_set
from jaxgeo.solve.gauge import determined, gauge_covariance

# Hypotheses a call: one compiled program serves any number of them.
BATCH = 4
# Not read: sessions are weighed without a robust loss.
LOSS_WIDTH = 3.0


class Labels(eqx.Module):
    """What one hypothesis says of the visits, padded to k.

    Attributes:
        surveyed_m: (k, 3); `shared_m2` (k, 3, 3) covariance of it, common to the visits of a location.
        location: (k,) equal for visits of one location.
        use: (k,) 0 for a visit whose position is open.
    """

    surveyed_m: Float[Array, "k 3"]
    shared_m2: Float[Array, "k 3 3"]
    location: Int[Array, "k"]
    use: Float[Array, "k"]


class Evidence(eqx.Module):
    """Of one hypothesis, or of several on a leading axis.

    Attributes:
        log_marginal: of the used visits; -inf where they do not fix the frame or no model was found.
        point_m, error_covariance_m2: (k, 3), (k, 3, 3) every visit's marker as predicted, and the covariance of an open
            visit's surveyed position minus it.
        tail: (k,) probability, under what the used visits tell of the noise, of an open visit's surveyed position
            lying as far from the prediction as it does: of chi square with three degrees of freedom, averaged over
            the noise's ensemble. One noise value instead would alarm far too often on a dozen contrasts.
        settled: whether noise and trajectory settled.
        determined: whether the used visits fix the frame.
    """

    log_marginal: Float[Array, ""]
    point_m: Float[Array, "k 3"]
    error_covariance_m2: Float[Array, "k 3 3"]
    tail: Float[Array, "k"]
    settled: Bool[Array, ""]
    determined: Bool[Array, ""]


def evidences(session: Session, labels: Sequence[Labels]) -> Evidence:
    """NumPy arrays, hypotheses on the leading axis."""
    parts = []
    for start in range(0, len(labels), BATCH):
        some = list(labels[start : start + BATCH])
        full = some + [some[-1]] * (BATCH - len(some))
        stacked = jax.tree.map(lambda *x: jnp.stack(x), *full)
        found = _evidence_of(session.chain, session.table, session.prior, stacked, session.options)
        parts.append(jax.tree.map(np.asarray, found))
    return jax.tree.map(lambda *x: np.concatenate(x)[: len(labels)], *parts)


@functools.partial(jax.jit, static_argnames="options")
def _evidence_of(
    chain: Chain, table: AnchorTable, prior: FamilyPriorArrays, labels: Labels, options: LearnOptions
) -> Evidence:
    """Every hypothesis on the leading axis of `labels`, one after the other."""

    def one(own: Labels) -> Evidence:
        told = eqx.tree_at(
            lambda t: (t.surveyed_m, t.survey_covariance_m2, t.location),
            table,
            (own.surveyed_m, own.shared_m2, own.location),
        )
        found = learn_fold(chain, told, prior, own.use, jnp.asarray(LOSS_WIDTH), options)
        observed, state = found.fold.observed, found.fold.state
        system = anchor_system(state, chain_linearised(state, observed.graph), observed)
        anchors = observed.graph.anchors
        fixed = determined(
            *gauge_covariance(anchors.measured_m, anchors.sqrt_information, jnp.zeros_like(anchors.sqrt_information))
        )
        total = _log_marginal(found, system)
        return Evidence(
            jnp.where(fixed & jnp.isfinite(total), total, -jnp.inf),
            found.fold.point_m,
            found.fold.error_covariance_m2,
            _tail(found, system, told),
            found.fold.settled,
            fixed,
        )

    return jax.lax.map(one, labels)


def _log_marginal(found: Learned, system: AnchorSystem) -> Float[Array, ""]:
    observed = found.fold.observed
    x = system.jacobian.reshape(-1, 6) * system.known[:, None]
    used = (observed.known > 0)[:, None]
    diagonal = jnp.diagonal(observed.graph.anchors.sqrt_information, axis1=-2, axis2=-1)
    log_det_w = jnp.sum(jnp.where(used, jnp.log(jnp.where(used, diagonal, 1.0)), 0.0))
    constant = log_det_w - 0.5 * jnp.linalg.slogdet(x.T @ x)[1] - 0.5 * found.found.count * jnp.log(2.0 * jnp.pi)
    return log_mean_evidence(found.fit) + constant


def log_mean_evidence(fit: ModelFit) -> Float[Array, ""]:
    """Of the contrasts over all models, every model as likely before; -inf where none was found."""
    by_model = jnp.where(fit.converged, fit.log_evidence, -jnp.inf)
    by_model = jnp.where(jnp.isnan(by_model), -jnp.inf, by_model)
    return jax.scipy.special.logsumexp(by_model) - jnp.log(by_model.shape[0])


def _tail(found: Learned, system: AnchorSystem, table: AnchorTable) -> Float[Array, "k"]:
    fold = found.fold
    rotation = at_anchors(fold.state.poses, fold.observed.graph).rotation
    own = rotation @ table.lever_covariance_m2 @ jnp.swapaxes(rotation, -1, -2) + table.survey_covariance_m2

    def one(sigma: Float[Array, "n"]) -> Float[Array, "k"]:
        solved = solve_set(system, sigma)
        error = solved.point_m + fold.origin_m[None] - table.surveyed_m
        weighed = jnp.linalg.solve(solved.point_covariance_m2 + own, error[..., None])[..., 0]
        return chi_square_3_tail(jnp.maximum(jnp.einsum("ka,ka->k", error, weighed), 0.0))

    return fold.ensemble.weight @ jax.vmap(one)(fold.ensemble.sigma)


def chi_square_3_tail(squared: Float[Array, "..."]) -> Float[Array, "..."]:
    """P(chi square of three degrees of freedom > squared), in closed form."""
    root = jnp.sqrt(0.5 * squared)
    return jax.scipy.special.erfc(root) + 2.0 / jnp.sqrt(jnp.pi) * root * jnp.exp(-root * root)
