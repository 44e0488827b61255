"""Held-out errors in figures: means over visits and over locations, and whether the predicted covariance was right."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import gammaincinv

from jaxgeo.export.result import HeldOut, TrajectoryResult

STAGES = ("coarse", "fixed", "learned")
# ASPRS Positional Accuracy Standards, edition 2 (2023): no accuracy is to be stated from fewer check points.
MIN_CHECK_POINTS = 30


@dataclasses.dataclass(frozen=True)
class HeldOutStats:
    """Held-out errors of one stage, summed up. Visits whose fold failed (NaN) count in `n_failed` only.

    Attributes:
        norm_m: (k,) length of every visit's error; NaN where the fold failed.
        mean_m, rms_m: over visits.
        per_location_m: {location: mean over its visits}; NaN where all of them failed.
        mean_over_locations_m: mean of those.
        nees: (k,) e^T P^-1 e, chi-square with 3 degrees of freedom if P is right; NaN where there is no P.
        nees_mean: over locations, each location's visits averaged first, since they share one survey point.
        nees_band: 95 % band of `nees_mean` for a right P and independent locations.
        coverage_50, coverage_95: share of visits inside their own ellipsoid of that probability.
        n_locations: locations with at least one error.
        n_covariance: visits with a usable P.
    """

    norm_m: Float[np.ndarray, "k"]
    mean_m: float
    rms_m: float
    per_location_m: dict[str, float]
    mean_over_locations_m: float
    nees: Float[np.ndarray, "k"]
    nees_mean: float
    nees_band: tuple[float, float]
    coverage_50: float
    coverage_95: float
    n_locations: int
    n_failed: int
    n_covariance: int


def held_out_stats(location: tuple[str, ...], held_out: HeldOut) -> HeldOutStats:
    """Sum up the held-out errors of one stage; `location` names the location of every visit."""
    norm_m = np.linalg.norm(held_out.error_enh_m, axis=1)
    nees = normalised_squared_errors(held_out.error_enh_m, held_out.covariance_m2)
    per_location_m = mean_by_name(location, norm_m)
    nees_by_location = finite(np.array(list(mean_by_name(location, nees).values())))
    inside = nees[np.isfinite(nees)]
    good = finite(norm_m)
    return HeldOutStats(
        norm_m=norm_m,
        mean_m=mean_or_nan(good),
        rms_m=float(np.sqrt(mean_or_nan(good**2))),
        per_location_m=per_location_m,
        mean_over_locations_m=mean_or_nan(finite(np.array(list(per_location_m.values())))),
        nees=nees,
        nees_mean=mean_or_nan(nees_by_location),
        nees_band=nees_mean_band(len(nees_by_location)),
        coverage_50=mean_or_nan(inside <= chi_square_quantile(0.5, 3)),
        coverage_95=mean_or_nan(inside <= chi_square_quantile(0.95, 3)),
        n_locations=int(np.isfinite(list(per_location_m.values())).sum()),
        n_failed=int(np.isnan(norm_m).sum()),
        n_covariance=len(inside),
    )


def final_stage(trajectory: TrajectoryResult) -> str:
    """The stage whose noise the corrected trajectory was made with: `learned` where there is one, else `fixed`."""
    return "learned" if "learned" in trajectory.held_out or "learned" in trajectory.noise else "fixed"


def stats_by_stage(trajectory: TrajectoryResult) -> dict[str, HeldOutStats]:
    """Statistics of the stages that exist, in the order coarse, fixed, learned."""
    held_out = trajectory.held_out
    return {s: held_out_stats(trajectory.anchors.location, held_out[s]) for s in STAGES if s in held_out}


def revisit_gap_m(gap: dict[str, float]) -> tuple[float, bool]:
    """The gap that the location's own fold predicts, and True; else that with all anchors in, and False."""
    held_out_m = gap.get("held_out_m", float("nan"))
    return (held_out_m, True) if np.isfinite(held_out_m) else (gap["refined_m"], False)


def normalised_squared_errors(
    error_m: Float[np.ndarray, "k 3"], covariance_m2: Float[np.ndarray, "k 3 3"]
) -> Float[np.ndarray, "k"]:
    """e^T P^-1 e of every row; NaN where e or P is not finite or P is not positive definite."""
    nees = np.full(len(error_m), np.nan)
    rows = np.flatnonzero(np.isfinite(error_m).all(axis=1) & np.isfinite(covariance_m2).all(axis=(1, 2)))
    rows = rows[positive_definite(covariance_m2[rows])]
    if rows.size:
        e = error_m[rows]
        nees[rows] = np.einsum("ki,ki->k", e, np.linalg.solve(covariance_m2[rows], e[..., None])[..., 0])
    return nees


def positive_definite(matrix: Float[np.ndarray, "k 3 3"]) -> Bool[np.ndarray, "k"]:
    """True where the smallest eigenvalue is above the rounding error of the largest."""
    eigenvalues = np.linalg.eigvalsh(matrix)
    return eigenvalues[:, 0] > 1e-14 * np.abs(eigenvalues[:, -1])


def chi_square_quantile(probability: float, degrees: int) -> float:
    """The chi-square value below which `probability` lies."""
    return float(2.0 * gammaincinv(degrees / 2.0, probability))


def nees_mean_band(n: int, probability: float = 0.95) -> tuple[float, float]:
    """Band that the mean of n independent normalised squared 3-D errors keeps with this probability."""
    if n == 0:
        return (float("nan"), float("nan"))
    tail = (1.0 - probability) / 2.0
    return (chi_square_quantile(tail, 3 * n) / n, chi_square_quantile(1.0 - tail, 3 * n) / n)


def mean_by_name(name: tuple[str, ...], value: Float[np.ndarray, "k"]) -> dict[str, float]:
    """{name: mean of its finite values}, in order of first appearance; NaN where it has none."""
    names = np.asarray(name)
    return {n: mean_or_nan(finite(value[names == n])) for n in dict.fromkeys(name)}


def finite(value: Float[np.ndarray, "k"]) -> Float[np.ndarray, "m"]:
    return value[np.isfinite(value)]


def mean_or_nan(value: np.ndarray) -> float:
    """The mean; NaN, without NumPy's warning, of nothing."""
    return float(np.mean(value)) if len(value) else float("nan")
