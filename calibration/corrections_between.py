"""What the visits' misfit to the survey says of the corrections, with the odometry's noise learned beside them.

The anchors' contrasts, linearised at some corrections g0 (`reml.contrasts`), move with them: c(g) = c(g0) + X (g - g0).
With a normal prior N(m, P) of g the odometry's noise is learned from

    c(g0) + X (m - g0)  ~  N(0, R + sum_c sigma_c^2 V_c + X P X')

so that the noise does not swallow what a wrong clock explains; and under each draw of the noise g has the normal
posterior of generalised least squares. Noise and corrections are a mixture over the same draws.
"""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from calibration.fit import STARTS, ModelFit, fit_family
from calibration.learn import FamilyPriorArrays, LearnOptions, ensemble_from
from calibration.observations import learnable
from calibration.reml import Contrasts, Prior, contrasts
from jaxgeo.graph.anchor_table import AnchorTable
from jaxgeo.graph.chain import Chain
from jaxgeo.graph.components import N_COMPONENTS, NoiseEnsemble
from jaxgeo.graph.pose_graph import at_anchors
from jaxgeo.solve.anchor_system import AnchorSystem, State, anchor_system, chain_linearised
from jaxgeo.solve.corrections import N_CORRECTIONS
from jaxgeo.solve.ensemble import ensemble_step, solve_set
from jaxgeo.solve.ensemble_fold import moved_m, observe, start_of


class CorrectionStep(eqx.Module):
    """One linearisation.

    Attributes:
        state: the poses, moved to what the noise's draws predict with the new corrections; `moved_m` a marker's most.
        fit: every noise model.
        mean, covariance: (7,), (7, 7) posterior of the corrections themselves.
        log_evidence: of the contrasts, corrections integrated out, over all models.
        information: (7, 7) what the contrasts alone say of the corrections: X' M^-1 X, mean over the draws.
    """

    state: State
    moved_m: Float[Array, ""]
    fit: ModelFit
    mean: Float[Array, "7"]
    covariance: Float[Array, "7 7"]
    log_evidence: Float[Array, ""]
    information: Float[Array, "7 7"]


class Between(eqx.Module):
    """A normal state of knowledge of the corrections before the contrasts: `mean`, and S with S S' the covariance."""

    mean: Float[Array, "7"]
    root: Float[Array, "7 7"]


@functools.partial(jax.jit, static_argnames="options")
def first_state(chain: Chain, table: AnchorTable, use: Array, loss_width: Array, options: LearnOptions) -> State:
    """The poses at the coarse fit of the anchors used."""
    use = use * table.real
    masks = learnable(table, use, options.observations)
    return start_of(observe(chain, table, use, masks.relative, loss_width, options.fold)[0])


@functools.partial(jax.jit, static_argnames="options")
def correction_step(
    chain: Chain,
    table: AnchorTable,
    influence: Float[Array, "k 3 7"],
    at: Float[Array, "7"],
    before: Between,
    family: FamilyPriorArrays,
    theta: Float[Array, "models n"] | None,
    state: State,
    use: Float[Array, "k"],
    loss_width: Float[Array, ""],
    options: LearnOptions,
) -> CorrectionStep:
    """Learn noise and corrections from anchors made at the corrections `at`, linearised at `state`.

    Args:
        influence: derivative of the anchors' lever arms, body axes, by the corrections.
        theta: where the noise's search starts; None: at the prior, as `learn_fold` does.
    """
    use = use * table.real
    masks = learnable(table, use, options.observations)
    observed, _ = observe(chain, table, use, masks.relative, loss_width, options.fold)
    own = Prior(
        jnp.broadcast_to(family.mean + family.per_log_span * jnp.log(observed.span_m), family.free.shape),
        family.precision,
        family.free,
    )
    linear = chain_linearised(state, observed.graph)
    system = anchor_system(state, linear, observed)
    rotation = at_anchors(state.poses, observed.graph).rotation
    x = jnp.einsum("kda,kab,kbg->kdg", system.jacobian[..., :3], rotation, influence).reshape(-1, N_CORRECTIONS)
    found = contrasts(system, masks)
    x_contrast = found.basis.T @ (x * jnp.repeat(masks.learn, system.jacobian.shape[1])[:, None])
    spread = x_contrast @ before.root
    blurred = eqx.tree_at(
        lambda f: (f.c, f.base), found, (found.c + x_contrast @ (before.mean - at), found.base + spread @ spread.T)
    )
    if theta is None:
        starts = own.mean[:, None] + jnp.asarray(STARTS)[None, :, None]
        starts = jnp.broadcast_to(starts, (len(family.free), len(STARTS), N_COMPONENTS))
    else:
        starts = theta[:, None]
    fit = fit_family(blurred, own, starts)
    noise = ensemble_from(fit, own, observed.correlation_m)
    mean, covariance, information = posterior_of_corrections(found, blurred.c, x_contrast, before, noise)
    system = _moved(system, x * jnp.repeat(use, system.jacobian.shape[1])[:, None], mean - at)
    solved = jax.vmap(lambda sigma: solve_set(system, sigma))(noise.sigma)
    after = ensemble_step(state, linear, system, solved, noise, observed)
    evidence = jnp.where(fit.converged, fit.log_evidence, -jnp.inf)
    # Whitened rows have lost the level of the anchors' own covariances, which another offset changes.
    level = jnp.diagonal(observed.graph.anchors.sqrt_information, axis1=1, axis2=2)
    level = jnp.where((masks.learn > 0)[:, None], jnp.log(jnp.where(level > 0, level, 1.0)), 0.0)
    log_evidence = jax.scipy.special.logsumexp(evidence) + level.sum()
    return CorrectionStep(after, moved_m(state, after, observed), fit, mean, covariance, log_evidence, information)


def _moved(system: AnchorSystem, x: Float[Array, "m 7"], step: Float[Array, "7"]) -> AnchorSystem:
    """The system with its anchors moved as the corrections' step moves them."""
    return eqx.tree_at(lambda s: s.residual, system, system.residual + x @ step)


def posterior_of_corrections(
    found: Contrasts, c: Array, x: Float[Array, "m 7"], before: Between, noise: NoiseEnsemble
) -> tuple[Float[Array, "7"], Float[Array, "7 7"], Float[Array, "7 7"]]:
    """Mean and covariance over the noise's draws, the spread between them included; and the mean information."""
    rhs = jnp.concatenate([x, c[:, None]], axis=1)

    def one(sigma: Array) -> tuple[Array, Array, Array]:
        factor = jnp.linalg.cholesky(found.base + jnp.einsum("c,cxy->xy", sigma**2, found.components))
        white = jax.scipy.linalg.solve_triangular(factor, rhs, lower=True)
        information = white[:, :-1].T @ white[:, :-1]
        curvature = jnp.eye(N_CORRECTIONS) + before.root.T @ information @ before.root
        covariance = before.root @ jnp.linalg.solve(curvature, before.root.T)
        return before.mean - covariance @ (white[:, :-1].T @ white[:, -1]), covariance, information

    mean, covariance, information = jax.vmap(one)(noise.sigma)
    centre = noise.weight @ mean
    apart = mean - centre[None]
    total = jnp.einsum("q,qab->ab", noise.weight, covariance + apart[:, :, None] * apart[:, None])
    return centre, total, jnp.einsum("q,qab->ab", noise.weight, information)
