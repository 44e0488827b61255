import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from jaxgeo.associate.centroid import CentroidRule, effective_counts, robust_mean, visit_centroid, weighted_median

RULE = CentroidRule()


def _isotropic(n, sigma):
    return np.tile(sigma**2 * np.eye(3), (n, 1, 1))


def _centroid(stamp_s, value, covariance, reference_s=0.0, rule=RULE):
    return visit_centroid(stamp_s, value, covariance, reference_s, rule, rule.floor_m)


def test_one_sighting_keeps_its_own_covariance():
    covariance = np.diag([1e-4, 4e-4, 9e-4])
    centroid = _centroid(np.array([3.0]), np.array([[1.0, 2.0, 3.0]]), covariance[None], 3.0)
    np.testing.assert_allclose(centroid.mean, [1.0, 2.0, 3.0], atol=1e-12)
    np.testing.assert_allclose(centroid.covariance, covariance + RULE.floor_m**2 * np.eye(3), rtol=1e-12)


def test_clean_sightings_give_the_information_weighted_mean():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(12, 3, 3))
    covariance = 1e-4 * (root @ np.swapaxes(root, 1, 2) + np.eye(3))
    value = 1e-3 * rng.normal(size=(12, 3))
    mean, weight = robust_mean(value, np.linalg.inv(covariance))
    information = np.linalg.inv(covariance)
    expected = np.linalg.solve(information.sum(axis=0), np.einsum("nij,nj->i", information, value))
    np.testing.assert_array_equal(weight, 1.0)
    np.testing.assert_allclose(mean, expected, atol=1e-12)


@given(st.floats(0.5, 1e4), st.integers(0, 19), st.integers(0, 2**31))
def test_a_single_wild_detection_does_not_move_the_centroid(far_m, row, seed):
    rng = np.random.default_rng(seed)
    stamp_s = np.arange(20) * 0.05
    value = 0.01 * rng.normal(size=(20, 3))
    wild = value.copy()
    direction = rng.normal(size=3)
    wild[row] += far_m * direction / np.linalg.norm(direction)
    clean, dirty = (_centroid(stamp_s, x, _isotropic(20, 0.01), 0.5) for x in (value, wild))
    # Nor does it blow the covariance up; an isolated outlier may cost a few sightings' worth of information.
    assert np.linalg.norm(dirty.mean - clean.mean) < 0.01
    assert np.trace(dirty.covariance) < 3.0 * np.trace(clean.covariance)
    assert dirty.weight[row] < 0.1


@pytest.mark.parametrize("spacing_s", [0.05, 0.01])
def test_more_frames_in_the_same_time_do_not_claim_more(spacing_s):
    rng = np.random.default_rng(1)
    stamp_s = np.arange(0.0, 4.0, spacing_s)
    value = 0.02 * rng.normal(size=(len(stamp_s), 3))
    centroid = _centroid(stamp_s, value, _isotropic(len(stamp_s), 0.02), 2.0)
    claimed = np.sqrt(np.trace(centroid.covariance) / 3.0)
    independent = np.sqrt(0.02**2 * (0.25 + 1.0 / 8.0) + 0.003**2)  # common half, and eight half-seconds
    assert claimed == pytest.approx(independent, rel=0.15)
    assert centroid.independent == pytest.approx(8.0, rel=0.05)
    assert claimed > 5.0 * 0.02 / np.sqrt(len(stamp_s))


def test_scatter_larger_than_predicted_widens_the_covariance():
    rng = np.random.default_rng(2)
    stamp_s = np.arange(0.0, 4.0, 0.05)
    value = 0.1 * rng.normal(size=(len(stamp_s), 3))
    centroid = _centroid(stamp_s, value, _isotropic(len(stamp_s), 0.01), 2.0)
    assert centroid.noise_scale == pytest.approx(10.0, rel=0.2)
    assert np.sqrt(np.trace(centroid.covariance) / 3.0) == pytest.approx(0.1 / np.sqrt(8.0), rel=0.25)


def test_drift_is_measured_and_the_reference_end_of_the_visit_believed():
    rng = np.random.default_rng(3)
    stamp_s = np.arange(0.0, 8.0, 0.1)
    velocity = np.array([0.05, 0.0, 0.02])
    for reference_s in (0.0, 4.0, 8.0):
        value = velocity * (stamp_s - reference_s)[:, None] + 0.004 * rng.normal(size=(len(stamp_s), 3))
        centroid = _centroid(stamp_s, value, _isotropic(len(stamp_s), 0.005), reference_s)
        # A median over pairs of a constant velocity: its norm, spread over three axes and over chi's median.
        assert centroid.drift_rate == pytest.approx(np.linalg.norm(velocity) / np.sqrt(2.366), rel=0.1)
        # Inside, the two sides cancel; with the reference at an end the plain mean is off by velocity times 4 s.
        assert np.linalg.norm(centroid.mean) < (0.004 if reference_s == 4.0 else 0.04)
        assert reference_s == 4.0 or np.linalg.norm(value.mean(axis=0)) > 0.2


def test_without_drift_none_is_found():
    rng = np.random.default_rng(4)
    stamp_s = np.arange(0.0, 8.0, 0.1)
    centroid = _centroid(stamp_s, 0.01 * rng.normal(size=(80, 3)), _isotropic(80, 0.01), 4.0)
    assert centroid.drift_rate < 0.001


def test_identical_sightings_give_a_finite_answer():
    centroid = _centroid(np.arange(0.0, 3.0, 0.1), np.ones((30, 3)), _isotropic(30, 0.01))
    np.testing.assert_allclose(centroid.mean, 1.0)
    assert np.all(np.linalg.eigvalsh(centroid.covariance) > 0.0)
    assert centroid.drift_rate == 0.0


def test_effective_counts():
    stamp_s = np.array([0.0, 0.1, 0.2, 1.1, 1.2, 1.3])
    assert effective_counts(stamp_s, np.ones(6), 0.5) == pytest.approx((6.0, 2.0))
    assert effective_counts(stamp_s, np.array([1.0, 0, 0, 0, 0, 0]), 0.5) == pytest.approx((1.0, 1.0))
    assert effective_counts(stamp_s, np.array([2.0, 0, 0, 1.0, 0, 0]), 0.5) == pytest.approx((1.8, 1.8))


def test_weighted_median():
    assert weighted_median(np.array([3.0, 1.0, 2.0]), np.ones(3)) == 2.0
    assert weighted_median(np.array([3.0, 1.0, 2.0]), np.array([5.0, 1.0, 1.0])) == 3.0
    for tiny in (-1e-15, 1e-15):  # rounding does not choose between two middle values
        assert weighted_median(np.arange(4.0), np.array([1.0 + tiny, 1.0, 1.0, 1.0])) == 1.0


def _simulated_visit(rng):
    """A walk past a marker: errors that are shared by the visit, correlated over 0.3 s, white, and drifting."""
    duration = rng.uniform(0.3, 8.0)
    stamp_s = np.sort(rng.uniform(0.0, duration, max(2, int(20 * duration))))
    reference_s = float(np.median(stamp_s))
    range_m = np.abs(rng.uniform(0.8, 4.0) + rng.uniform(-0.7, 0.7) * (stamp_s - reference_s)) + 0.5
    axes = Rotation.from_rotvec(
        rng.normal(size=3) + np.outer(stamp_s - reference_s, 0.15 * rng.normal(size=3))
    ).as_matrix()
    sigma = np.column_stack([0.002 * range_m, 0.002 * range_m, 0.01 * range_m**2])  # one pixel, range last
    root = axes * sigma[:, None, :]
    correlated = np.zeros((len(stamp_s), 3))
    correlated[0] = rng.normal(size=3)
    for i in range(1, len(stamp_s)):
        keep = np.exp(-(stamp_s[i] - stamp_s[i - 1]) / 0.3)
        correlated[i] = keep * correlated[i - 1] + np.sqrt(1.0 - keep**2) * rng.normal(size=3)
    unit = 0.5 * rng.normal(size=3) + 0.3 * correlated + 0.15 * rng.normal(size=correlated.shape)
    drift = np.outer(stamp_s - reference_s, rng.uniform(0.0, 0.03) * rng.normal(size=3))
    value = np.einsum("nij,nj->ni", root, unit) + drift
    return stamp_s, value, root @ np.swapaxes(root, 1, 2), reference_s


def test_the_covariance_is_honest_on_simulated_visits_with_correlated_errors():
    rng = np.random.default_rng(7)
    nees, naive = [], []
    for _ in range(300):
        stamp_s, value, covariance, reference_s = _simulated_visit(rng)
        centroid = _centroid(stamp_s, value, covariance, reference_s)
        information = np.linalg.inv(covariance)
        mean = np.linalg.solve(information.sum(axis=0), np.einsum("nij,nj->i", information, value))
        nees.append(centroid.mean @ np.linalg.solve(centroid.covariance, centroid.mean) / 3.0)
        naive.append(mean @ information.sum(axis=0) @ mean / 3.0)
    assert 0.5 < np.mean(nees) < 1.3
    assert np.mean(np.array(nees) * 3.0 < 7.815) > 0.9  # 95 % ellipsoid
    assert np.mean(naive) > 10.0  # what 1/sqrt(n) would have claimed
