"""pooled_noise.json: a platform's noise in the words of noise.json, so that `noise.file` reads it."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import norm, qmc

from calibration.models import MODELS
from calibration.pooling import Population
from jaxgeo.cli.campaign_pool import Member, Platform
from jaxgeo.export.json_text import json_text
from jaxgeo.graph.components import COMPONENTS, N_COMPONENTS
from jaxgeo.io.atomic import atomic_path

# Sets of sigmas a model, for `use: fixed`.
DRAWS = 16


def pooled_noise_text(session: str, simulated: bool, platforms: Mapping[str, dict[str, Any]]) -> str:
    """The file; `platforms` by the name that `noise.trajectory` gives, each of `pooled_values`."""
    return json_text(
        {
            "session": session,
            "simulated": simulated,
            "trajectories": {label: {"learned": values} for label, values in platforms.items()},
        }
    )


def pooled_values(platform: Platform, population: Population, members: Sequence[Member]) -> dict[str, Any]:
    """The `learned` part of noise.json. `theta_mean`, `theta_covariance`: of a session yet to come.

    `between_sessions` says that what changes between sessions is in the covariance already.
    """
    weight = {name: float(np.mean([member.model_weight.get(name, 0.0) for member in members])) for name in MODELS}
    sigma, share = drawn_sigmas(population, platform.family.free, np.array(list(weight.values())))
    return {
        "kind": platform.kind,
        "observations": "pooled",
        "components": list(COMPONENTS),
        "theta_mean": population.mean,
        "theta_covariance": population.predictive_covariance,
        "between_sessions": True,
        "ensemble": {"sigma": sigma, "weight": share, "correlation_m": correlation_m(members)},
        "pooled": {
            "n_sessions": population.n_sessions,
            "sessions": [member.session.folder for member in members],
            "settled": population.settled,
            "rounds": population.rounds,
            "model_weight": weight,
            "median": dict(zip(COMPONENTS, np.exp(population.mean).tolist(), strict=True)),
            "between_log_sd": dict(zip(COMPONENTS, np.sqrt(np.diag(population.between)).tolist(), strict=True)),
            "mean_log_sd": dict(zip(COMPONENTS, np.sqrt(np.diag(population.mean_covariance)).tolist(), strict=True)),
        },
    }


def drawn_sigmas(population: Population, free: np.ndarray, model_weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sets of sigmas and their weights: low-discrepancy draws of the population, those of a model with its components.

    Models without weight are left out.
    """
    sobol = qmc.Sobol(N_COMPONENTS, scramble=True, rng=np.random.default_rng(0)).random(DRAWS)
    root = np.linalg.cholesky(population.predictive_covariance)
    drawn = np.exp(population.mean + norm.ppf(sobol) @ root.T)
    has = model_weight > 0
    sigma = (drawn[None] * free[has][:, None]).reshape(-1, N_COMPONENTS)
    return sigma, np.repeat(model_weight[has] / (model_weight[has].sum() * DRAWS), DRAWS)


def correlation_m(members: Sequence[Member]) -> float:
    """Over which wander and bounded error forget: the sessions' median."""
    return float(np.median([member.row.learned[member.trajectory]["correlation_m"] for member in members]))


def any_simulated(members: Sequence[Member]) -> bool:
    """Whether any of them is, and so what comes of them."""
    return any(member.session.config is not None and member.session.config.simulated for member in members)


def keep_or_write(path: Path, text: str) -> None:
    """Leave a file that holds the same as it is: what was computed from it stays valid."""
    if path.is_file() and path.read_text(encoding="utf-8") == text:
        return
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
