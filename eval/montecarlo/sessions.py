"""One simulated session as the arrays that the compiled program takes."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from calibration.learn import FamilyPriorArrays, prior_arrays
from eval.loo import without_each_location
from eval.montecarlo.regimes import Regime
from eval.montecarlo.settings import SOLVE, StudySettings
from jaxgeo.associate import cut_visits, label_visits, make_anchors
from jaxgeo.data import Anchors, Trajectory
from jaxgeo.graph.anchor_table import AnchorTable, anchor_table
from jaxgeo.graph.chain import Chain, chain_of
from jaxgeo.graph.components import NoiseEnsemble
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.simulate import Layout, simulate_session
from jaxgeo.simulate.session import ORIGIN_ENH_M
from jaxgeo.simulate.true_noise import true_noise

GAP_S = 5.0


class SessionArrays(eqx.Module):
    """What is known of a session, and the truth of its noise.

    Attributes:
        chain, table: odometry and anchors, padded.
        use: (1 + locations, k) all anchors, then all but each location's.
        family: the prior that learning starts from; `assumed` the fixed noise.
        true: the noise that the session was drawn from; of what is constant over it, where that was drawn from.
    """

    chain: Chain
    table: AnchorTable
    use: Float[Array, "f k"]
    family: FamilyPriorArrays
    assumed: OdometryNoise
    true: NoiseEnsemble


def simulate(regime: Regime, seed: int, layout: Layout) -> tuple[Trajectory, Anchors, NoiseEnsemble]:
    """A session of this regime: its odometry, its anchors, and its true noise."""
    session = simulate_session(seed, layout, drift={"odometry": regime.drawn(seed)})
    trajectory = session.trajectories["odometry"]
    visits, _ = label_visits(cut_visits(session.sightings, GAP_S), session.survey, order=list(session.order))
    anchors, _ = make_anchors(trajectory, session.sightings, visits, session.survey, origin_enh_m=ORIGIN_ENH_M)
    return trajectory, anchors, true_noise(trajectory, session.truth, regime.drift)


def session_arrays(regime: Regime, seed: int, layout: Layout) -> SessionArrays:
    """The same as NumPy arrays."""
    trajectory, anchors, true = simulate(regime, seed, layout)
    chain = chain_of(trajectory)
    table = anchor_table(anchors, chain, SOLVE.extra_sigma_m)
    k = len(anchors)
    use = np.zeros((1 + int(anchors.location_index.max()) + 1, table.real.shape[0]))
    use[0, :k] = 1.0
    use[1:, :k] = without_each_location(anchors)
    arrays = SessionArrays(chain, table, jnp.asarray(use), prior_arrays(regime.learn.family), regime.assumed, true)
    return jax.tree.map(np.asarray, arrays)


def sessions_arrays(settings: StudySettings, sessions: tuple[int, ...]) -> list[SessionArrays]:
    """Several sessions of a study, by number."""
    return [session_arrays(settings.regime_of(i), settings.seed_of(i), settings.layout) for i in sessions]


def stacked(arrays: list[Any], length: int) -> Any:
    """Pytrees on a new leading axis of this length, the last one repeated: every call has one shape."""
    padded = [*arrays, *[arrays[-1]] * (length - len(arrays))]
    return jax.tree.map(lambda *leaves: np.stack(leaves), *padded)
