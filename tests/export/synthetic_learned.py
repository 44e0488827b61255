"""Learned noise of nobody's odometry, as noise.json holds it: right in shape, numbers made up."""

from typing import Any

import numpy as np

from jaxgeo.export.result import DriftGrowth
from jaxgeo.graph.components import COMPONENTS


def sigma(component: str, median: float, factor: float, probability: float = 1.0) -> dict[str, Any]:
    """Known to `factor` (95 %), before to e^3."""
    return {
        "component": component,
        "median": median,
        "low_68": median / factor**0.5,
        "high_68": median * factor**0.5,
        "low_95": median / factor,
        "high_95": median * factor,
        "log_sd": float(np.log(factor) / 1.96),
        "prior_median": 2.0 * median,
        "prior_log_sd": 3.0 / 1.96,
        "probability": probability,
    }


def learned_noise(draws: int = 4) -> dict[str, Any]:
    """Two models, four kinds of noise, one profile with a gap."""
    n = len(COMPONENTS)
    rng = np.random.default_rng(5)
    weight = rng.uniform(0.1, 1.0, draws)
    root = rng.normal(size=(n, n))
    return {
        "kind": "lidar",
        "observations": "both",
        "n_contrasts": 15,
        "n_revisits": 1,
        "rounds": 3,
        "sentences": ["The anchors say nothing about log_scale: the width is the prior's."],
        "sigmas": [
            sigma("trans_x_m_per_sqrt_m", 0.021, 3.0),
            sigma("trans_m_per_sqrt_m", 0.02, 2.0),
            sigma("rot_rad_per_sqrt_m", 0.001, 2.5),
            sigma("log_scale", 0.004, 4.0, 0.73),
        ],
        "models": [
            model("white", 0.73, 0.0),
            model("white + bias", 0.27, -1.0),
        ],
        "components": list(COMPONENTS),
        "theta_mean": rng.normal(-5.0, 1.0, n).tolist(),
        "theta_covariance": (root @ root.T / n).tolist(),
        "ensemble": {
            "sigma": rng.uniform(0.0, 0.02, (draws, n)).tolist(),
            "weight": (weight / weight.sum()).tolist(),
            "correlation_m": 12.5,
        },
        "profiles": [
            {
                "component": "trans_m_per_sqrt_m",
                "sigma": [0.005, 0.01, 0.02, 0.04, 0.08],
                "drop": [3.0, 0.8, 0.0, 1.1, None],
                "drop_likelihood": [0.4, 0.2, 0.0, 1.5, None],
                "interval_95": [0.007, None],
                "likelihood_interval_95": [None, 0.05],
            }
        ],
    }


def model(name: str, weight: float, log_evidence: float) -> dict[str, Any]:
    return {
        "name": name,
        "weight": weight,
        "log_evidence": log_evidence,
        "log_predictive": 0.5 * log_evidence,
        "components": ["log_scale"],
        "sigma": [0.004],
        "log_sd": [0.7],
        "correlation": [[1.0]],
        "converged": True,
    }


def drift_curves() -> DriftGrowth:
    """Fixed noise predicts 1 % of the distance, learned 2 %, known to a factor of two."""
    distance_m = np.linspace(0.0, 200.0, 21)
    learned_m = 0.02 * distance_m
    return DriftGrowth(
        distance_m=distance_m,
        fixed_m=0.01 * distance_m,
        learned_m=learned_m,
        learned_band_m=np.stack([0.5 * learned_m, 2.0 * learned_m]),
        observed_distance_m=np.array([0.0, 60.0, 130.0, 200.0]),
        observed_m=np.array([0.0, 1.0, 3.5, 2.0]),
    )
