"""The drifts by name: the study's revisit gaps, and one kind of error each."""

import dataclasses

import numpy as np
import pytest

from jaxgeo.errors import InputError
from jaxgeo.simulate import UAV, UGV, drift_of, paper_drift, raw_revisit_gaps_m, simulate_session
from jaxgeo.simulate.regimes import REGIMES, scaled

# What the study reports between A and its revisit, metres.
GAP_M = {("UAV", "icp"): 9.42, ("UAV", "dense"): 7.631, ("UGV", "icp"): 101.02, ("UGV", "dense"): 0.129}


@pytest.mark.parametrize("layout", [UAV, UGV], ids=["UAV", "UGV"])
def test_papers_raw_revisit_gaps(layout):
    drift = paper_drift(layout)
    sessions = [simulate_session(seed, layout, drift=drift) for seed in range(20)]
    for name in drift:
        gap_m = np.array([raw_revisit_gaps_m(session, name)["A"] for session in sessions])
        wanted = GAP_M[layout.name, name]
        np.testing.assert_allclose(np.median(gap_m), wanted, rtol=0.15)
        np.testing.assert_allclose(gap_m[0], wanted, rtol=0.4 if wanted < 1 else 0.25)


@pytest.mark.parametrize("layout", [UAV, UGV], ids=["UAV", "UGV"])
def test_papers_gap_grows_all_along_the_way(layout):
    """No step is off by more than some centimetres: there is no jump, in a loop-closed map either."""
    session = simulate_session(0, layout, drift=paper_drift(layout))
    for name, trajectory in session.trajectories.items():
        way_m = [np.linalg.norm(np.diff(t.position_m, axis=0), axis=1) for t in (trajectory, session.truth)]
        assert np.abs(way_m[0] - way_m[1]).max() < 0.2, name


def test_dense_is_built_on_icp():
    drift = paper_drift(UAV)
    assert drift["dense"].draws_of == "icp"
    assert dataclasses.replace(drift["dense"], closures=(), draws_of="") == drift["icp"]


def test_paper_drift_knows_the_studys_layouts_only():
    with pytest.raises(InputError, match="known for UAV and UGV only"):
        paper_drift(dataclasses.replace(UAV, name="mine"))


@pytest.mark.parametrize("regime", REGIMES)
def test_every_regime_makes_icp_and_dense(regime):
    drift = drift_of(regime, UGV)
    assert list(drift) == ["icp", "dense"]
    session = simulate_session(0, UGV, drift=drift)
    gap_m = {name: raw_revisit_gaps_m(session, name)["A"] for name in drift}
    # A wrong scale closes its loops: the gap is noise.
    assert gap_m["icp"] > (0.05 if regime == "scale" else 1.0)


def test_half_of_a_drift_is_half_of_every_size():
    drift = dataclasses.replace(drift_of("gauss-markov", UAV)["icp"], log_scale=0.2, student_dof=3.0)
    half = scaled(drift, 0.5)
    assert half.wander_log_scale == drift.wander_log_scale / 2
    assert half.log_scale == 0.1
    assert half.sigma_trans_m_per_sqrt_m == (0.01, 0.01, 0.01)
    assert (half.wander_correlation_m, half.student_dof) == (drift.wander_correlation_m, 3.0)


def test_a_regime_that_is_not_there_lists_those_that_are():
    with pytest.raises(InputError, match=r"drift 'none': expected one of paper, white"):
        drift_of("none", UAV)
