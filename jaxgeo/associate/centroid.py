"""One visit's sightings, composed into the map frame, to one robust position and an honest covariance.

Three kinds of error act on a composed sighting, and the rule here keeps them apart:

1. Random error kappa^2 C_i, with C_i as PnP predicts it. kappa^2 is measured: the normalised median of squared
   Mahalanobis differences between successive sightings less than `independent_s` apart.
2. Odometry drift between the sighting and the reference. Over a few seconds it grows like time, not like its square
   root, so its variance is (g dt)^2 per axis. The rate g is measured too: with it, differences between sightings
   further apart have the median Mahalanobis distance they should have. A visit with poor odometry then leans on the
   sightings near its reference pose instead of smearing them all.
3. Systematic error (calibration, corner bias, printing) that every sighting of the visit shares and no scatter shows:
   f^2 C_i, f = `common_fraction`. It never averages out. Where there are too few sightings to measure the scatter,
   kappa^2 = 1 - f^2, so that one sighting keeps its own covariance.

Weights are the information (kappa^2 C_i + (g dt_i)^2 I)^-1 times Huber's, started at the weighted median, so that a
wild detection does not count. What is random averages over independent sightings, one per `independent_s`, not frames:

    covariance = n (sum Lambda_i)^-1 / n_ind  +  f^2 (mean of C_i)  +  floor^2 I,

Lambda_i the weights as 3x3 matrices, n and n_ind Kish's effective numbers of sightings and of independent ones.
"""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.optimize import root_scalar

_MEDIAN_CHI2_3 = 2.365973884  # median of chi-square with three degrees of freedom
_HUBER = 2.5  # Mahalanobis distance beyond which a sighting loses weight; 90 % of clean ones lie inside
_MAX_PAIRED = 100  # pairs grow with the square: a longer visit is thinned evenly for the drift estimate
_MIN_PAIRS = 5  # fewer successive differences say nothing about the scatter
_MIN_NOISE_SCALE2 = 1e-4  # repeated identical sightings would make every weight infinite
_MAX_ITERATIONS = 50


@dataclasses.dataclass(frozen=True)
class CentroidRule:
    """The assumptions of the covariance rule above; see there.

    Attributes:
        common_fraction: f, in [0, 1]. 0.5: the two cameras of a calibrated stereo rig, looking at one marker,
            differed by a visit-long constant of about half the standard deviation that 1 px corner noise predicts.
        independent_s: sightings closer in time than this count as one.
        floor_m: what stamps, extrinsics and the marker's own make add to any visit's position; per axis.
        floor_rad: the same for its rotation.
    """

    common_fraction: float = 0.5
    independent_s: float = 0.5
    floor_m: float = 0.003
    floor_rad: float = 0.005


@dataclasses.dataclass(frozen=True)
class Centroid:
    """A visit's position (or rotation vector) and how it came about.

    Attributes:
        mean, covariance: in the axes and units of the values given.
        weight: (n,) Huber weight of each sighting, 1 for good ones.
        noise_scale: kappa.
        drift_rate: g, units per second.
        independent: n_ind, effective number of independent sightings.
    """

    mean: Float[np.ndarray, "3"]
    covariance: Float[np.ndarray, "3 3"]
    weight: Float[np.ndarray, "n"]
    noise_scale: float
    drift_rate: float
    independent: float


def visit_centroid(
    stamp_s: Float[np.ndarray, "n"],
    value: Float[np.ndarray, "n 3"],
    covariance: Float[np.ndarray, "n 3 3"],
    reference_s: float,
    rule: CentroidRule,
    floor: float,
) -> Centroid:
    """Robust centroid of positions (or rotation vectors) as seen at the reference's stamp. Sightings in time order."""
    scale2 = _noise_scale2(stamp_s, value, covariance, rule)
    drift2 = _drift2(stamp_s, value, scale2 * covariance, rule.independent_s)
    grown = scale2 * covariance + (drift2 * (stamp_s - reference_s) ** 2)[:, None, None] * np.eye(3)
    information = np.linalg.inv(grown)
    mean, weight = robust_mean(value, information)
    information = weight[:, None, None] * information
    size = np.trace(information, axis1=1, axis2=2)
    count, independent = effective_counts(stamp_s, size, rule.independent_s)
    random = count / independent * np.linalg.inv(information.sum(axis=0))
    common = rule.common_fraction**2 * np.einsum("n,nij->ij", size / size.sum(), covariance)
    total = random + common + floor**2 * np.eye(3)
    return Centroid(mean, total, weight, float(np.sqrt(scale2)), float(np.sqrt(drift2)), independent)


def robust_mean(
    value: Float[np.ndarray, "n 3"], information: Float[np.ndarray, "n 3 3"]
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "n"]]:
    """Information-weighted mean with Huber weights, by reweighting from the weighted median of each coordinate."""
    mean = np.array([weighted_median(value[:, k], information[:, k, k]) for k in range(3)])
    weight = np.ones(len(value))
    for _ in range(_MAX_ITERATIONS):
        distance = np.sqrt(_mahalanobis2(value - mean, information))
        weight = _HUBER / np.maximum(distance, _HUBER)
        weighted = weight[:, None, None] * information
        new = np.linalg.solve(weighted.sum(axis=0), np.einsum("nij,nj->i", weighted, value))
        moved = np.linalg.norm(new - mean)
        mean = new
        if moved < 1e-9:
            break
    return mean, weight


def effective_counts(
    stamp_s: Float[np.ndarray, "n"], weight: Float[np.ndarray, "n"], independent_s: float
) -> tuple[float, float]:
    """Kish's effective number of sightings, and of groups of sightings less than `independent_s` long."""
    _, group = np.unique(np.floor((stamp_s - stamp_s[0]) / independent_s), return_inverse=True)
    grouped = np.bincount(group, weights=weight)
    return float(weight.sum() ** 2 / np.sum(weight**2)), float(grouped.sum() ** 2 / np.sum(grouped**2))


def _noise_scale2(
    stamp_s: Float[np.ndarray, "n"],
    value: Float[np.ndarray, "n 3"],
    covariance: Float[np.ndarray, "n 3 3"],
    rule: CentroidRule,
) -> float:
    """kappa^2 from successive sightings; 1 - f^2 where there are too few to tell."""
    near = np.diff(stamp_s) < rule.independent_s
    if np.count_nonzero(near) < _MIN_PAIRS:
        return max(1.0 - rule.common_fraction**2, _MIN_NOISE_SCALE2)
    spread = (covariance[1:] + covariance[:-1])[near]
    distance2 = _mahalanobis2(np.diff(value, axis=0)[near], np.linalg.inv(spread))
    return max(_MIN_NOISE_SCALE2, float(np.median(distance2)) / _MEDIAN_CHI2_3)


def _drift2(
    stamp_s: Float[np.ndarray, "n"],
    value: Float[np.ndarray, "n 3"],
    covariance: Float[np.ndarray, "n 3 3"],
    independent_s: float,
) -> float:
    """g^2 per axis, squared units over s^2; zero where no two sightings are `independent_s` apart."""
    chosen = np.unique(np.linspace(0, len(stamp_s) - 1, min(len(stamp_s), _MAX_PAIRED)).round().astype(int))
    i, j = (chosen[side] for side in np.triu_indices(len(chosen), k=1))
    apart = stamp_s[j] - stamp_s[i] >= independent_s
    if not apart.any():
        return 0.0
    i, j = i[apart], j[apart]
    lag2 = (stamp_s[j] - stamp_s[i]) ** 2
    # In the eigenbasis of its noise a pair's distance is a sum of three quotients for every trial of g.
    noise, axes = np.linalg.eigh(covariance[i] + covariance[j])
    difference2 = np.einsum("nji,nj->ni", axes, value[i] - value[j]) ** 2

    def excess(drift2: float) -> float:
        distance2 = np.sum(difference2 / (noise + drift2 * lag2[:, None]), axis=1)
        return float(np.median(distance2)) - _MEDIAN_CHI2_3

    most = float(np.max(difference2.sum(axis=1) / lag2))  # with this rate even the largest difference is explained
    if most <= 0.0 or excess(0.0) <= 0.0:
        return 0.0
    return float(root_scalar(excess, bracket=(0.0, most), rtol=1e-4).root)


def _mahalanobis2(value: Float[np.ndarray, "n 3"], information: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "n"]:
    return np.einsum("ni,nij,nj->n", value, information, value)


def weighted_median(value: Float[np.ndarray, "n"], weight: Float[np.ndarray, "n"]) -> float:
    """The smallest value with at least half of the weight at or below it."""
    order = np.argsort(value, kind="stable")
    sums = np.cumsum(weight[order])
    # A little less than half: rounding in equal weights must not decide which of two middle values it is.
    return float(value[order][np.searchsorted(sums, (0.5 - 1e-9) * sums[-1])])
