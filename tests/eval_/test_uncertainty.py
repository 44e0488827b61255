"""Covariances that are right, too small and missing: NEES, coverage, predicted and achieved RMS, over many sessions."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from eval.uncertainty import calibration_row, inside_ellipsoid, pooled_calibration
from jaxgeo.export.result import HeldOut

LOCATIONS = ("A", "B", "C", "D", "E", "F", "A")
K = len(LOCATIONS)


def drawn(seed: int, size: float = 1.0) -> HeldOut:
    """Errors `size` times as large as their covariances say."""
    rng = np.random.default_rng(seed)
    turn = Rotation.random(K, rng=rng).as_matrix()
    covariance = np.einsum("kij,kj,klj->kil", turn, rng.uniform(0.1, 1.0, (K, 3)) ** 2, turn)
    error = np.einsum("kij,kj->ki", np.linalg.cholesky(covariance), rng.standard_normal((K, 3)))
    return HeldOut(size * error, covariance, ("converged",) * K)


SESSIONS = [(LOCATIONS, drawn(seed)) for seed in range(300)]


def test_right_covariances_are_found_right():
    row = pooled_calibration("right", SESSIONS)
    assert (row.n, row.n_failed, row.n_groups) == (300 * K, 0, 300 * 6)
    assert row.nees_band[0] < row.nees_mean < row.nees_band[1]
    assert row.coverage_50 == pytest.approx(0.5, abs=0.04)
    assert row.coverage_95 == pytest.approx(0.95, abs=0.02)
    assert row.achieved_over_predicted == pytest.approx(1.0, abs=0.04)


def test_errors_twice_as_large_are_seen():
    row = pooled_calibration("too sure", [(LOCATIONS, drawn(seed, 2.0)) for seed in range(300)])
    assert row.nees_mean == pytest.approx(12.0, rel=0.05)
    assert row.coverage_95 == pytest.approx(chi2.cdf(chi2.ppf(0.95, 3) / 4.0, 3), abs=0.03)
    assert row.achieved_over_predicted == pytest.approx(2.0, rel=0.04)


def test_the_figures_by_hand():
    """Visits weigh alike in coverage and RMS, locations in the NEES; the two visits of A are one of the six."""
    held_out = drawn(11)
    row = calibration_row("one", LOCATIONS, held_out)
    nees = [e @ np.linalg.inv(p) @ e for e, p in zip(held_out.error_enh_m, held_out.covariance_m2, strict=True)]
    assert row.nees_mean == pytest.approx(np.mean([(nees[0] + nees[6]) / 2, *nees[1:6]]))
    assert row.coverage_50 == np.mean(np.array(nees) <= chi2.ppf(0.5, 3))
    assert row.predicted_rms_m == pytest.approx(np.sqrt(np.mean([np.trace(p) for p in held_out.covariance_m2])))
    assert row.achieved_rms_m == pytest.approx(np.sqrt(np.mean([e @ e for e in held_out.error_enh_m])))
    assert_allclose(row.nees_band, chi2.ppf([0.025, 0.975], 18) / 6)


def test_what_failed_and_what_has_no_covariance_is_in_no_figure():
    held_out = drawn(12)
    held_out.error_enh_m[3] = np.nan
    held_out.covariance_m2[4] = np.nan
    row = calibration_row("some", LOCATIONS, held_out)
    assert (row.n, row.n_failed, row.n_groups) == (5, 1, 4)
    keep = [0, 1, 2, 5, 6]
    assert row.achieved_rms_m == pytest.approx(np.sqrt(np.mean(np.sum(held_out.error_enh_m[keep] ** 2, axis=1))))
    nothing = pooled_calibration("nothing", [])
    assert nothing.n == 0
    assert np.isnan([nothing.nees_mean, nothing.coverage_95, nothing.achieved_rms_m]).all()


def test_inside_the_ellipsoid_over_many_folds_at_once():
    rng = np.random.default_rng(0)
    error, covariance = rng.standard_normal((4, 5, 3)), np.tile(np.diag([1.0, 2.0, 0.5]), (4, 5, 1, 1))
    error[1, 2], covariance[2, 3] = np.nan, np.nan
    found = inside_ellipsoid(error, covariance, 0.5)
    for s in range(4):
        for v in range(5):
            squared = np.sum(error[s, v] ** 2 / [1.0, 2.0, 0.5])
            expected = np.nan if (s, v) in {(1, 2), (2, 3)} else float(squared <= chi2.ppf(0.5, 3))
            assert_array_equal(found[s, v], expected)
    assert {0.0, 1.0} <= set(found.ravel())
