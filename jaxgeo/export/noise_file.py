"""noise.json: the noise every trajectory was corrected with, by stage; strict JSON.

    trajectories.{name}.fixed      the values, named as in the config
    trajectories.{name}.learned    kind, observations, n_contrasts, n_revisits, rounds, sentences
                                   sigmas: [{component, median, low_95, high_95, ..}], models: [{name, weight, ..}]
                                   components, theta_mean, theta_covariance (log sigma), ensemble
                                   profiles, where they were worked out

`jaxgeo.io.noise_json` reads it back.
"""

from typing import Any

from jaxgeo.export.json_text import json_text
from jaxgeo.export.result import SessionResult


def noise_text(result: SessionResult) -> str:
    """Of a whole run."""
    return noise_json(result.name, result.simulated, {name: t.noise for name, t in result.trajectories.items()})


def noise_json(session: str, simulated: bool, noise: dict[str, dict[str, Any]]) -> str:
    """`noise` by trajectory and stage."""
    return json_text({"session": session, "simulated": simulated, "trajectories": noise})


def noise_figures(noise: dict[str, Any]) -> dict[str, Any]:
    """What metrics.json says of the noise: all but what is only good for computing with."""
    learned = noise.get("learned")
    if learned is None:
        return noise
    bulk = ("components", "theta_mean", "theta_covariance", "ensemble", "models", "sigmas", "profiles")
    figures = {key: value for key, value in learned.items() if key not in bulk}
    figures["models"] = {model["name"]: model["weight"] for model in learned["models"]}
    figures["sigmas"] = {
        sigma["component"]: {key: sigma[key] for key in ("median", "low_95", "high_95", "prior_median", "probability")}
        for sigma in learned["sigmas"]
    }
    return {**noise, "learned": figures}
