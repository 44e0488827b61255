"""Simulated sessions of one platform: the same ways of erring in all of them, drawn anew in each; short and small."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from eval.montecarlo.regimes import Regime
from jaxgeo.simulate import UAV, Layout, simulate_session, write_session_files

# Four and five locations, one of them visited twice in every other session: what an hour in the field often leaves.
SHORT_ORDERS: tuple[tuple[str, ...], ...] = (
    ("A", "C", "D", "F"),
    ("A", "B", "D", "F", "A"),
    ("B", "C", "D", "E", "F"),
    ("A", "C", "D", "E", "F", "A"),
)
N_POSES = 128
SIGHTINGS = 4
DURATION_S = 200.0


def write_platform_sessions(
    folder: Path,
    regime: Regime,
    n: int,
    *,
    orders: Sequence[tuple[str, ...]] = SHORT_ORDERS,
    first_seed: int = 0,
    n_poses: int = N_POSES,
) -> list[Path]:
    """Write `n` sessions into folders of their own, the orders in turn; their configs' paths. What is there stays.

    Session i has the seed `first_seed + i`; its constant biases and scale are drawn by the regime.
    """
    configs = []
    for i in range(n):
        seed = first_seed + i
        place = folder / f"{regime.name}_{seed:04d}"
        config = place / "config.yaml"
        if not config.is_file():
            layout = _layout(f"{regime.name}_{seed:04d}", orders[i % len(orders)], n_poses)
            drift = {"icp": regime.drawn(seed)}
            config = write_session_files(simulate_session(seed, layout, drift=drift), place)
        configs.append(config)
    return configs


def _layout(name: str, order: tuple[str, ...], n_poses: int) -> Layout:
    k = len(order)
    return dataclasses.replace(
        UAV,
        name=name,
        order=order,
        counts=(SIGHTINGS,) * k,
        repeatability_m=(0.05,) * k,
        duration_s=DURATION_S,
        n_poses=n_poses,
    )
