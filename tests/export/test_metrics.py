"""metrics.json: keys as agreed, figures recomputed here by other means."""

import dataclasses
import json
import math

import numpy as np
import pytest
from export.synthetic_result import local_session, luref_session
from scipy import stats

from jaxgeo.export.held_out_stats import held_out_stats, nees_mean_band
from jaxgeo.export.json_text import json_text
from jaxgeo.export.metrics import metrics_dict
from jaxgeo.export.result import HeldOut


@pytest.fixture(scope="module")
def session():
    return luref_session(n_poses=300)


def test_keys_of_the_contract(session):
    metrics = metrics_dict(session)
    assert set(metrics["trajectories"]) == {"icp", "dense"}
    icp = metrics["trajectories"]["icp"]
    assert (icp["n_poses"], icp["n_visits"], icp["n_locations"], icp["n_anchors"]) == (300, 7, 6, 7)
    assert set(icp["coarse"]) == {"scale", "rms_m"}
    assert icp["revisit"] == {"A": {"coarse_m": 2.24, "refined_m": 0.031, "held_out_m": 0.47}}
    assert set(icp["loo"]) == set(icp["reference"]) == {"coarse", "fixed", "learned"}
    assert {"mean_m", "rms_m", "per_location", "per_visit"} <= set(icp["loo"]["fixed"])
    assert {"ate_rmse_m", "ate_median_m"} <= set(icp["reference"]["learned"])
    assert set(icp["solver"]) == {"result", "steps", "cost"}
    assert (metrics["simulated"], icp["seed"], icp["versions"]["jax"]) == (True, 7, "0.10.2")


def test_noise_in_metrics_is_what_can_be_read(session):
    noise = metrics_dict(session)["trajectories"]["icp"]["noise"]
    assert noise["fixed"] == {"sigma_trans": 0.02, "sigma_rot": 0.003}
    assert noise["learned"]["models"] == {"white": 0.73, "white + bias": 0.27}
    assert noise["learned"]["sigmas"]["log_scale"]["probability"] == 0.73
    assert noise["learned"]["n_contrasts"] == 15
    assert not {"ensemble", "theta_covariance", "profiles"} & set(noise["learned"])


def test_stages_that_do_not_exist_are_null(session):
    dense = metrics_dict(session)["trajectories"]["dense"]
    assert dense["loo"]["learned"] is None
    assert dense["reference"] == {"coarse": None, "fixed": None, "learned": None}


def test_held_out_figures(session):
    result = session.trajectories["icp"]
    got = metrics_dict(session)["trajectories"]["icp"]["loo"]["learned"]
    errors = [math.hypot(*e) for e in result.held_out["learned"].error_enh_m]
    assert got["mean_m"] == pytest.approx(sum(errors) / 7, rel=1e-12)
    assert got["rms_m"] == pytest.approx(math.sqrt(sum(e**2 for e in errors) / 7), rel=1e-12)
    assert got["per_visit"]["A_revisit"] == pytest.approx(errors[6], rel=1e-12)
    assert got["per_location"]["A"] == pytest.approx((errors[0] + errors[6]) / 2, rel=1e-12)
    assert got["mean_over_locations_m"] == pytest.approx(np.mean(list(got["per_location"].values())), rel=1e-12)
    assert got["mean_over_locations_m"] != pytest.approx(got["mean_m"], rel=1e-3)


def test_uncertainty_figures_against_scipy(session):
    held_out = session.trajectories["icp"].held_out["learned"]
    got = metrics_dict(session)["trajectories"]["icp"]["loo"]["learned"]
    nees = [e @ np.linalg.inv(p) @ e for e, p in zip(held_out.error_enh_m, held_out.covariance_m2, strict=True)]
    np.testing.assert_allclose(list(got["nees_3dof"]["per_visit"].values()), nees, rtol=1e-9)
    probability = stats.chi2(3).cdf(nees)
    assert got["coverage_50"] == np.mean(probability <= 0.5)
    assert got["coverage_95"] == np.mean(probability <= 0.95)
    by_location = [(nees[0] + nees[6]) / 2, *nees[1:6]]
    assert got["nees_3dof"]["mean_over_locations"] == pytest.approx(np.mean(by_location), rel=1e-9)
    np.testing.assert_allclose(got["nees_3dof"]["mean_band_95"], stats.chi2(18).ppf([0.025, 0.975]) / 6, rtol=1e-12)


def test_failed_fold_is_null_and_counted_and_not_in_the_mean(session):
    got = metrics_dict(session)["trajectories"]["icp"]["loo"]["fixed"]
    assert got["n_failed"] == 1
    assert got["per_visit"]["D"] is None
    assert got["per_location"]["D"] is None
    assert got["result"]["D"] == "not determined"
    assert got["mean_m"] == pytest.approx(np.mean([v for v in got["per_visit"].values() if v is not None]))


def test_coarse_has_no_covariance(session):
    coarse = metrics_dict(session)["trajectories"]["icp"]["loo"]["coarse"]
    assert coarse["coverage_95"] is None
    assert coarse["n_with_covariance"] == 0
    assert coarse["mean_m"] > 0.0


def test_everything_failed_gives_nulls_without_a_warning():
    k = 3
    nothing = HeldOut(np.full((k, 3), np.nan), np.full((k, 3, 3), np.nan), ("failed",) * k)
    got = held_out_stats(("A", "B", "C"), nothing)
    assert math.isnan(got.mean_m)
    assert math.isnan(got.coverage_50)
    assert got.n_failed == k
    assert all(map(math.isnan, nees_mean_band(0)))


def test_indefinite_covariance_gives_no_nees():
    error = np.ones((3, 3))
    covariance = np.stack([np.eye(3), np.diag([1.0, 1.0, -1.0]), np.zeros((3, 3))])
    got = held_out_stats(("A", "B", "C"), HeldOut(error, covariance, ("converged",) * 3))
    np.testing.assert_array_equal(np.isfinite(got.nees), [True, False, False])


def test_nan_and_infinity_never_reach_json(session):
    icp = session.trajectories["icp"]
    broken = dataclasses.replace(
        icp, solver={"result": "x", "steps": np.int64(3), "cost": np.inf}, timing_s={"a": np.nan}
    )
    text = json_text(metrics_dict(dataclasses.replace(session, trajectories={"icp": broken})))
    assert "NaN" not in text
    assert "Infinity" not in text
    solver = json.loads(text)["trajectories"]["icp"]["solver"]
    assert solver == {"result": "x", "steps": 3, "cost": None}


def test_unknown_kinds_are_refused():
    with pytest.raises(TypeError, match="cannot write a set"):
        json_text({"a": {1, 2}})


def test_local_frame_is_named():
    assert metrics_dict(local_session(50))["crs"] == "local"
