"""The odometry noise of a run: from the config, from another session's noise.json, and to this session's own."""

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from calibration.calibrate import LearnSettings
from calibration.models import FamilyPrior, family_prior
from calibration.profile import ProfileLikelihood
from calibration.result import Calibration
from jaxgeo.config.inputs import AnyTrajectoryInput
from jaxgeo.config.schema import SessionConfig
from jaxgeo.errors import ConfigError
from jaxgeo.graph.components import COMPONENTS, N_COMPONENTS, NoiseEnsemble
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.graph.noise_defaults import default_noise
from jaxgeo.io.noise_json import StoredNoise, read_noise

# Standard deviation of log sigma by which the noise of one platform differs from session to session.
BETWEEN_SESSIONS_LOG_SD = 0.5


def noise_of(source: AnyTrajectoryInput, config: SessionConfig) -> OdometryNoise:
    """Fixed noise: the defaults of the kind of odometry, the session's values, then the trajectory's own."""
    values = config.noise.values.model_dump(exclude_none=True) | source.noise.model_dump(exclude_none=True)
    return default_noise(source.odometry, **values)


def noise_values(noise: OdometryNoise) -> dict[str, float | list[float]]:
    """Noise as plain numbers, named as in the config."""
    return {name: np.asarray(value).tolist() for name, value in vars(noise).items()}


def stored_noise(config: SessionConfig, source: AnyTrajectoryInput) -> StoredNoise | None:
    """What `noise.file` holds; None where the config names no file.

    Raises:
        ConfigError: the file cannot be used, or is of another kind of odometry.
    """
    if config.noise.file is None:
        return None
    stored = read_noise(config.noise.file, COMPONENTS, config.noise.trajectory)
    if stored.kind != source.odometry:
        raise ConfigError(
            f"{config.noise.file}: trajectory {stored.trajectory!r} is of kind {stored.kind!r}, this one of kind "
            f"{source.odometry!r}: their noise has nothing in common. Name another with noise.trajectory, or remove "
            "noise.file."
        )
    return stored


def learn_settings(
    config: SessionConfig, source: AnyTrajectoryInput, noise: OdometryNoise, stored: StoredNoise | None
) -> LearnSettings:
    """Where learning starts: from the documented prior of the kind, or from another session's posterior."""
    chosen = config.noise
    free = chosen.free_anchor_factor
    prior = (
        None if stored is None else session_prior(stored, family_prior(source.odometry, noise, free_anchor_factor=free))
    )
    return LearnSettings(source.odometry, noise, chosen.observations, free, prior)


def session_prior(stored: StoredNoise, family: FamilyPrior) -> FamilyPrior:
    """Another session's posterior as this one's prior, widened by what changes between sessions; absolute values."""
    between = 0.0 if stored.between_sessions else BETWEEN_SESSIONS_LOG_SD**2
    covariance = stored.theta_covariance + between * np.eye(N_COMPONENTS)
    return FamilyPrior(stored.theta_mean, np.zeros(N_COMPONENTS), covariance, family.free)


def stored_ensemble(stored: StoredNoise) -> NoiseEnsemble:
    """Another session's ensemble, to be used as it is."""
    return NoiseEnsemble(jnp.asarray(stored.sigma), jnp.asarray(stored.weight), jnp.asarray(stored.correlation_m))


def stored_values(stored: StoredNoise) -> dict[str, Any]:
    """What noise.json says of a run with another session's noise: whose it is, and every component's mean square root.

    The components are the same numbers as `NoiseEnsemble`'s, in the root mean square over its sets.
    """
    rms = np.sqrt(stored.weight @ stored.sigma**2)
    return {
        "session": stored.session,
        "trajectory": stored.trajectory,
        "sigma_rms": dict(zip(COMPONENTS, rms.tolist(), strict=True)),
    }


def learned_values(calibration: Calibration) -> dict[str, Any]:
    """The `learned` part of noise.json."""
    ensemble = calibration.ensemble
    return {
        "kind": calibration.kind,
        "observations": calibration.observations,
        "n_contrasts": calibration.n_contrasts,
        "n_revisits": calibration.n_revisits,
        "rounds": calibration.rounds,
        "sentences": list(calibration.sentences),
        "sigmas": [vars(sigma) for sigma in calibration.sigmas],
        "models": [vars(model) for model in calibration.models],
        "components": list(COMPONENTS),
        "theta_mean": calibration.theta_mean,
        "theta_covariance": calibration.theta_covariance,
        "ensemble": {
            "sigma": np.asarray(ensemble.sigma),
            "weight": np.asarray(ensemble.weight),
            "correlation_m": float(ensemble.correlation_m),
        },
    }


def profile_values(profiles: Sequence[ProfileLikelihood]) -> list[dict[str, Any]]:
    """The `profiles` part of `learned` in noise.json, of the most probable model."""
    return [vars(profile) for profile in profiles]
