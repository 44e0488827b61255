"""What a simulated session was made from: beside its files, read by no estimator."""

import dataclasses
import json
import math
from typing import Any

import numpy as np

from jaxgeo.graph.components import COMPONENTS
from jaxgeo.simulate.layout import ORIGIN_ENH_M
from jaxgeo.simulate.revisit import raw_revisit_gaps_m
from jaxgeo.simulate.session import SimulatedSession


def truth_json(session: SimulatedSession) -> str:
    """Seed, layout, drifts, faults, the true noise of each trajectory and the gap of its revisits as it came.

    Infinite degrees of freedom (normal noise) are null. Markers are in the local frame: grid (E, N, h) minus origin.
    """
    return json.dumps(_plain(_truth(session)), indent=2, allow_nan=False) + "\n"


def _truth(session: SimulatedSession) -> dict[str, Any]:
    noise = {name: session.true_noise(name) for name in session.trajectories}
    return {
        "simulated": True,
        "seed": session.seed,
        "layout": dataclasses.asdict(session.layout),
        "faults": dataclasses.asdict(session.faults),
        "order_told": session.order,
        "visit_sigma_m": session.visit_sigma_m,
        "origin_enh_m": ORIGIN_ENH_M,
        "marker_enh_m": session.marker_enh_m,
        "trajectories": {
            name: {
                "raw_revisit_gap_m": raw_revisit_gaps_m(session, name),
                "drift": dataclasses.asdict(session.drift[name]),
                "true_noise": {
                    **dict(zip(COMPONENTS, np.asarray(noise[name].sigma[0]), strict=True)),
                    "correlation_m": np.asarray(noise[name].correlation_m),
                },
            }
            for name in session.trajectories
        },
    }


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _plain(v) for name, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return _plain(value.tolist())
    return None if isinstance(value, float) and math.isinf(value) else value
