"""noise.json of another session: the learned noise of one of its trajectories, read back and checked."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxgeo.errors import ConfigError
from jaxgeo.io.json_file import read_json

# A covariance is taken as one where its least eigenvalue is above minus this share of its largest.
_ROUNDING = 1e-9
# Of logarithms of standard deviations: no learning leaves a variance near this.
_LARGEST = 1e12


@dataclasses.dataclass(frozen=True)
class StoredNoise:
    """Learned noise as another session wrote it, components in the order that the reader asked for.

    Attributes:
        session, trajectory: where it was learned; `kind` of odometry, `observations` what it was learned from.
        theta_mean, theta_covariance: (n,), (n, n) of log sigma.
        sigma, weight: (q, n) and (q,) of the ensemble; the weights sum to 1.
        correlation_m: over which wander and bounded error forget.
        between_sessions: whether the covariance has in it what changes between sessions: pooled over several.
    """

    session: str
    trajectory: str
    kind: str
    observations: str
    theta_mean: Float[np.ndarray, "n"]
    theta_covariance: Float[np.ndarray, "n n"]
    sigma: Float[np.ndarray, "q n"]
    weight: Float[np.ndarray, "q"]
    correlation_m: float
    between_sessions: bool = False


def read_noise(path: str | Path, components: Sequence[str], trajectory: str | None = None) -> StoredNoise:
    """The learned noise of one trajectory.

    Args:
        path: a noise.json as `jaxgeo run` and `jaxgeo calibrate` write it.
        components: names of the noise components, in the order wanted.
        trajectory: which one, where the file holds several.

    Raises:
        ConfigError: the file is no noise.json, was cut off, holds several trajectories and none is named, has nothing
            learned, or numbers that cannot be noise; with file and key.
    """
    content = read_json(path, "a noise.json", ConfigError)
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: holds a {type(content).__name__}; expected a noise.json, with 'trajectories'")
    trajectories = _mapping(path, content, "trajectories")
    name = _which(path, trajectories, trajectory)
    stages = _mapping(path, trajectories, name, "trajectories")
    place = f"trajectories.{name}.learned"
    if stages.get("learned") is None:
        raise ConfigError(
            f"{path}: trajectories.{name} holds no learned noise, only a fixed one. Name a noise.json that was written "
            "with noise.mode: learned, or by jaxgeo calibrate."
        )
    learned = _mapping(path, stages, "learned", f"trajectories.{name}")
    order = _order(path, place, learned.get("components"), components)
    n = len(order)
    mean = _numbers(path, place, learned, "theta_mean", (n,))
    covariance = _numbers(path, place, learned, "theta_covariance", (n, n))
    ensemble = _mapping(path, learned, "ensemble", place)
    inside = f"{place}.ensemble"
    weight = _numbers(path, inside, ensemble, "weight", (None,))
    sigma = _numbers(path, inside, ensemble, "sigma", (len(weight), n))
    correlation_m = float(_numbers(path, inside, ensemble, "correlation_m", ()))
    if not _is_covariance(covariance):
        raise _wrong(path, f"{place}.theta_covariance", "is not a covariance (symmetric, no negative eigenvalue)")
    if (sigma < 0).any():
        raise _wrong(path, f"{inside}.sigma", f"holds {sigma.min():g}; expected standard deviations, none negative")
    if not sigma.any():
        raise _wrong(path, f"{inside}.sigma", "is zero everywhere: that is no noise")
    if (weight < 0).any() or abs(weight.sum() - 1.0) > 1e-6:
        raise _wrong(path, f"{inside}.weight", f"sums to {weight.sum():g}; expected non-negative weights of sum 1")
    if correlation_m <= 0:
        raise _wrong(path, f"{inside}.correlation_m", f"is {correlation_m:g}; expected a length above 0, in metres")
    return StoredNoise(
        session=str(content.get("session", "")),
        trajectory=name,
        kind=str(learned.get("kind", "")),
        observations=str(learned.get("observations", "")),
        theta_mean=mean[order],
        theta_covariance=covariance[np.ix_(order, order)],
        sigma=sigma[:, order],
        weight=weight / weight.sum(),
        correlation_m=correlation_m,
        between_sessions=learned.get("between_sessions") is True,
    )


def _is_covariance(matrix: Float[np.ndarray, "n n"]) -> bool:
    if np.abs(matrix).max() > _LARGEST or not np.allclose(matrix, matrix.T, rtol=1e-6, atol=1e-9):
        return False
    least, *_, most = np.linalg.eigvalsh(0.5 * (matrix + matrix.T))
    return bool(least >= -_ROUNDING * max(most, 1.0))


def _which(path: str | Path, trajectories: dict[str, Any], wanted: str | None) -> str:
    known = ", ".join(map(str, trajectories))[:400]
    if wanted is not None:
        if wanted not in trajectories:
            raise ConfigError(f"{path}: has no trajectory {wanted!r}, which noise.trajectory names (known: {known})")
        return wanted
    if len(trajectories) != 1:
        how = f"{len(trajectories)} trajectories ({known})" if trajectories else "no trajectory"
        raise ConfigError(f"{path}: holds {how}; expected one, or one of them named: noise.trajectory: NAME")
    return next(iter(trajectories))


def _order(path: str | Path, place: str, found: Any, wanted: Sequence[str]) -> list[int]:
    names = found if isinstance(found, list) else []
    if sorted(map(str, names)) != sorted(wanted):
        odd = sorted(set(map(str, names)) ^ set(wanted))
        raise _wrong(
            path,
            f"{place}.components",
            f"differs from the noise components of this version ({', '.join(odd)[:400] or 'one stands twice'}): learn "
            "it anew with jaxgeo calibrate",
        )
    return [names.index(name) for name in wanted]


def _mapping(path: str | Path, content: dict[str, Any], key: str, place: str = "") -> dict[str, Any]:
    value = content.get(key)
    if not isinstance(value, dict):
        dotted = f"{place}.{key}" if place else key
        found = "is missing" if value is None else f"is a {type(value).__name__}"
        raise _wrong(path, dotted, f"{found}; expected a mapping. Is this a noise.json?")
    return value


def _numbers(
    path: str | Path, place: str, content: dict[str, Any], key: str, shape: tuple[int | None, ...]
) -> np.ndarray:
    """An array of finite numbers of this shape; None stands for any length but 0."""
    try:
        value = np.array(content.get(key), dtype=float)
    except (TypeError, ValueError, OverflowError):
        value = np.full((), np.nan)
    fits = value.ndim == len(shape) and all(
        have == want or (want is None and have > 0) for have, want in zip(value.shape, shape, strict=False)
    )
    if not fits or not np.isfinite(value).all():
        sizes = " x ".join("n" if size is None else str(size) for size in shape)
        expected = f"{sizes} finite numbers" if shape else "a finite number"
        raise _wrong(path, f"{place}.{key}", f"does not hold what it should; expected {expected}")
    return value


def _wrong(path: str | Path, key: str, what: str) -> ConfigError:
    return ConfigError(f"{path}: {key} {what}.")
