"""Drifts by name: the reference study's sizes, and one for each way in which odometry can err.

The study gives no drift, only what came of it. `paper` is set so that the raw revisit gaps come out near its 9.4 m
and 7.6 m (UAV, ICP and dense) and 101 m and 0.13 m (UGV); docs/simulator.md has the values reached. The UGV's gap is
more than half its path: a steady turn of about a degree a metre unwinds the round into an arc, its ends a hundred
metres apart, while the six locations keep errors of the study's size.
"""

import dataclasses

from jaxgeo.errors import InputError
from jaxgeo.simulate.drift import Drift, LoopClosure
from jaxgeo.simulate.layout import UAV, UGV, Layout
from jaxgeo.simulate.session import DENSE_DRIFT, ICP_DRIFT

_WANDER = {
    "wander_trans_m_per_m": (0.005, 0.005, 0.005),
    "wander_rot_rad_per_m": (0.0005, 0.0005, 0.0005),
    "wander_correlation_m": 30.0,
}
_UAV_ICP = Drift(
    sigma_trans_m_per_sqrt_m=(0.02, 0.02, 0.02),
    sigma_rot_rad_per_sqrt_m=(0.003, 0.003, 0.003),
    sigma_turn_rad_per_sqrt_rad=0.003,
    bias_trans_m_per_m=(0.01, 0.0, 0.02),
    bias_rot_rad_per_m=(0.0, 0.0, -0.0017),
    **_WANDER,
)
_UGV_ICP = Drift(
    sigma_trans_m_per_sqrt_m=(0.02, 0.02, 0.02),
    sigma_rot_rad_per_sqrt_m=(0.002, 0.002, 0.002),
    sigma_turn_rad_per_sqrt_rad=0.002,
    bias_trans_m_per_m=(0.01, 0.0, 0.02),
    bias_rot_rad_per_m=(0.0, 0.0, -0.0197),
    **_WANDER,
)
# What the map recognised. On the UAV's way neighbouring places only, so that the whole round stays open; on the UGV's
# the first place from across the site, and there from it on coming back, and then itself.
_UAV_CLOSURES = (LoopClosure(1, 2, 0.03, 0.003), LoopClosure(4, 5, 0.03, 0.003))
_UGV_CLOSURES = (LoopClosure(1, 4, 0.08, 0.003), LoopClosure(4, 7, 0.08, 0.003), LoopClosure(1, 7, 0.06, 0.003))

# For the first trajectory; the second has half of each size.
_SINGLE = {
    "white": Drift(
        sigma_trans_m_per_sqrt_m=(0.14, 0.14, 0.14),
        sigma_rot_rad_per_sqrt_m=(0.007, 0.007, 0.007),
    ),
    "gauss-markov": Drift(
        sigma_trans_m_per_sqrt_m=(0.02, 0.02, 0.02),
        sigma_rot_rad_per_sqrt_m=(0.002, 0.002, 0.002),
        wander_trans_m_per_m=(0.03, 0.03, 0.03),
        wander_rot_rad_per_m=(0.002, 0.002, 0.002),
        wander_log_scale=0.03,
        wander_correlation_m=30.0,
    ),
    "heavy-tailed": Drift(
        sigma_trans_m_per_sqrt_m=(0.14, 0.14, 0.14),
        sigma_rot_rad_per_sqrt_m=(0.007, 0.007, 0.007),
        student_dof=3.0,
    ),
    "scale": Drift(
        sigma_trans_m_per_sqrt_m=(0.02, 0.02, 0.02),
        sigma_rot_rad_per_sqrt_m=(0.002, 0.002, 0.002),
        log_scale=0.1,
    ),
}
REGIMES: tuple[str, ...] = ("paper", "white", "biased", "gauss-markov", "heavy-tailed", "scale")


def paper_drift(layout: Layout) -> dict[str, Drift]:
    """The study's two trajectories of one session: ICP odometry, and the loop-closed map built on it.

    Raises:
        InputError: a layout that is not the study's, by its name.
    """
    if layout.name == UAV.name:
        icp, closures = _UAV_ICP, _UAV_CLOSURES
    elif layout.name == UGV.name:
        icp, closures = _UGV_ICP, _UGV_CLOSURES
    else:
        raise InputError(f"layout {layout.name!r}: the study's drift is known for UAV and UGV only; give your own.")
    return {"icp": icp, "dense": dataclasses.replace(icp, closures=closures, draws_of="icp")}


def drift_of(regime: str, layout: Layout) -> dict[str, Drift]:
    """The trajectories `icp` and `dense` of a regime.

    `biased` is the default of `simulate_session`: white noise and a constant bias. The others have one kind of error
    each, `dense` half of it.

    Raises:
        InputError: no such regime.
    """
    if regime == "paper":
        return paper_drift(layout)
    if regime == "biased":
        return {"icp": ICP_DRIFT, "dense": DENSE_DRIFT}
    if regime not in _SINGLE:
        raise InputError(f"drift {regime!r}: expected one of {', '.join(REGIMES)}.")
    return {"icp": _SINGLE[regime], "dense": scaled(_SINGLE[regime], 0.5)}


def scaled(drift: Drift, factor: float) -> Drift:
    """Every size times `factor`: sigmas, biases, scale; not lengths, degrees of freedom or closures."""
    sizes = {
        field.name: value
        for field in dataclasses.fields(drift)
        if field.name.startswith(("sigma_", "bias_", "wander_", "log_scale")) and field.name != "wander_correlation_m"
        for value in [getattr(drift, field.name)]
    }
    changed = {
        name: tuple(factor * v for v in value) if isinstance(value, tuple) else factor * value
        for name, value in sizes.items()
    }
    return dataclasses.replace(drift, **changed)
