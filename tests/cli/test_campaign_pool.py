"""`jaxgeo campaign --pool`: who is pooled with whom, in a file that `noise.file` reads; held out of its own prior."""

import dataclasses
import json
import re

import numpy as np
import pytest
from campaign_inputs import asked, row, run_here, sessions_of, summary_of, write_session

from calibration.models import MODELS, family_prior
from calibration.pooling import population
from jaxgeo.cli import campaign_task
from jaxgeo.cli.campaign import run_campaign
from jaxgeo.cli.campaign_noise_file import drawn_sigmas, pooled_noise_text, pooled_values
from jaxgeo.cli.campaign_pool import pooled_platforms, recordings
from jaxgeo.cli.campaign_second_pass import learned_from
from jaxgeo.cli.campaign_summary import gain
from jaxgeo.config import load_config
from jaxgeo.errors import ConfigError
from jaxgeo.graph.components import BOUNDED, COMPONENTS, TRANS
from jaxgeo.graph.noise_defaults import default_noise
from jaxgeo.io.noise_json import read_noise

FAMILY = family_prior("lidar", default_noise("lidar"))
LEARNED = "noise: {mode: learned}"


def learned(times: float, kind: str = "lidar") -> dict:
    """As a row has it: the white model alone, its white sigmas so many times the prior's, and known to 20 %."""
    own = [COMPONENTS.index(name) for name in COMPONENTS[:8]]
    family = family_prior(kind, default_noise(kind))
    sigma = np.exp(family.mean[own])
    sigma[:6] *= times
    log_sd = np.where(np.arange(8) < 6, 0.2, np.sqrt(np.diag(family.covariance))[own])
    white = {
        "name": "white",
        "weight": 1.0,
        "log_evidence": 0.0,
        "log_predictive": 0.0,
        "components": [COMPONENTS[i] for i in own],
        "sigma": sigma.tolist(),
        "log_sd": log_sd.tolist(),
        "correlation": np.eye(8).tolist(),
        "converged": True,
    }
    # What JSON makes of a model that was not found.
    lost = white | {"name": "bounded", "weight": 0.0, "sigma": [None] * 8, "converged": False, "log_evidence": None}
    sigmas = [{"component": name, "prior_median": float(np.exp(m))} for name, m in zip(COMPONENTS, family.mean)]  # noqa: B905
    return {
        "kind": kind,
        "observations": "both",
        "n_contrasts": 9,
        "models": [white, lost],
        "sigmas": sigmas,
        "correlation_m": 10.0,
    }


@pytest.fixture(scope="module")
def configs(tmp_path_factory):
    """Three sessions that learn, and one that does not."""
    place = tmp_path_factory.mktemp("platform")
    found = []
    for name in ("one", "two", "three", "fixed"):
        path = write_session(place / name, name)
        if name != "fixed":
            path.write_text(path.read_text().replace("noise: {mode: fixed}", LEARNED))
        found.append(path)
    return found


def rows_of(sessions, times=(2.0, 3.0, 4.0, 9.0)):
    return [
        row(session.key, learned={"icp": learned(t)} if session.name != "fixed" else {}, odometry={"icp": "lidar"})
        for session, t in zip(sessions, times, strict=True)
    ]


def test_sessions_of_one_kind_are_one_platform_and_the_others_are_said(configs, tmp_path):
    sessions = sessions_of(*configs, out=tmp_path)
    (platform,), said = pooled_platforms(sessions, rows_of(sessions), None)
    assert platform.label == "lidar_icp"
    assert [member.session.name for member in platform.members] == ["one", "two", "three"]
    assert said == ["1 session(s) with noise.mode: fixed or a noise.file are not pooled"]
    times = np.exp(platform.whole.mean - FAMILY.mean)[TRANS]
    np.testing.assert_allclose(times, (2 * 3 * 4) ** (1 / 3), rtol=0.15)


def test_a_session_is_held_out_of_its_own_prior(configs, tmp_path):
    sessions = sessions_of(*configs, out=tmp_path)
    (platform,), _ = pooled_platforms(sessions, rows_of(sessions), None)
    for group in platform.groups:
        (member,) = group.members
        assert member not in group.others
        assert len(group.others) == 2
        alone = population([other.evidence for other in group.others], FAMILY.covariance)
        assert group.population is not None
        np.testing.assert_array_equal(group.population.mean, alone.mean)
    other = rows_of(sessions, times=(50.0, 3.0, 4.0, 9.0))
    (changed,), _ = pooled_platforms(sessions, other, None)
    first, again = platform.groups[0].population, changed.groups[0].population
    assert first is not None
    assert again is not None
    np.testing.assert_array_equal(first.mean, again.mean)
    assert np.abs(platform.whole.mean - changed.whole.mean).max() > 0.1


def test_two_sessions_of_one_recording_are_held_out_together(configs, tmp_path):
    twin = configs[0].with_name("twin.yaml")
    twin.write_text(configs[0].read_text().replace("name: one", "name: twin"))
    sessions = sessions_of(*configs[:3], twin, out=tmp_path)
    rows = [row(session.key, learned={"icp": learned(3.0)}) for session in sessions]
    (platform,), _ = pooled_platforms(sessions, rows, None)
    assert recordings(platform.members) == [0, 1, 2, 0]
    together = [{member.session.name for member in group.members} for group in platform.groups]
    assert together == [{"one", "twin"}, {"two"}, {"three"}]
    alone = pooled_platforms([sessions[0], sessions[3]], [rows[0], rows[3]], None)[0][0]
    assert [group.population for group in alone.groups] == [None]


def test_recordings_are_joined_through_a_third(configs, tmp_path):
    sessions = sessions_of(*configs[:3], out=tmp_path)
    rows = [row(session.key, learned={"icp": learned(3.0)}) for session in sessions]
    (platform,), _ = pooled_platforms(sessions, rows, None)
    a, b, c = platform.members
    both = dataclasses.replace(c, files=a.files | b.files)
    assert recordings([a, b, both]) == [0, 0, 0]
    assert recordings([a, both, b]) == [0, 0, 0]


def test_a_key_tells_platforms_apart(configs, tmp_path):
    sessions = sessions_of(*configs[:3], out=tmp_path)
    rows = rows_of([*sessions, sessions[0]])[:3]
    (platform,), _ = pooled_platforms(sessions, rows, "trajectories.icp.file")  # three copies of one file
    assert re.fullmatch(r"lidar_icp_icp-[0-9a-f]{8}", platform.label)
    (platform,), _ = pooled_platforms(sessions, rows, "coarse")
    assert re.fullmatch(r"lidar_icp_[A-Za-z0-9.-]+-[0-9a-f]{8}", platform.label)
    platforms, _ = pooled_platforms(sessions, rows, "name")
    assert [platform.label for platform in platforms] == ["lidar_icp_one", "lidar_icp_two", "lidar_icp_three"]
    with pytest.raises(ConfigError, match=r"one.*--pool-by rig.file: the config has no value there"):
        pooled_platforms(sessions, rows, "rig.file")


def test_nothing_to_pool_is_refused(configs, tmp_path):
    sessions = sessions_of(configs[3], out=tmp_path)
    with pytest.raises(ConfigError, match="there is nothing to pool"):
        pooled_platforms(sessions, [row(sessions[0].key)], None)


def test_the_file_is_one_that_noise_file_reads(configs, tmp_path):
    sessions = sessions_of(*configs, out=tmp_path)
    (platform,), _ = pooled_platforms(sessions, rows_of(sessions), None)
    path = tmp_path / "pooled_noise.json"
    values = pooled_values(platform, platform.whole, platform.members)
    path.write_text(pooled_noise_text("pooled", False, {platform.label: values}))
    stored = read_noise(path, COMPONENTS)
    assert stored.kind == "lidar"
    np.testing.assert_allclose(stored.theta_mean, platform.whole.mean)
    np.testing.assert_allclose(stored.theta_covariance, platform.whole.predictive_covariance)
    assert stored.correlation_m == 10.0
    # As it is: all sessions had the white model, and drew its sigmas alone.
    assert not stored.sigma[:, BOUNDED].any()
    middle = np.exp(stored.weight @ np.log(stored.sigma[:, TRANS]))
    np.testing.assert_allclose(middle, np.exp(platform.whole.mean[TRANS]), rtol=0.15)


def test_sets_of_sigmas_are_draws_of_the_population(configs, tmp_path):
    sessions = sessions_of(*configs, out=tmp_path)
    (platform,), _ = pooled_platforms(sessions, rows_of(sessions), None)
    weight = np.linspace(0.0, 1.0, len(MODELS))
    sigma, share = drawn_sigmas(platform.whole, FAMILY.free, weight / weight.sum())
    assert share.sum() == pytest.approx(1.0)
    assert len(sigma) == 16 * (len(MODELS) - 1)
    bounded_only = sigma[-16:]
    np.testing.assert_array_equal(bounded_only > 0, np.broadcast_to(FAMILY.free[-1] > 0, bounded_only.shape))
    spread = np.log(bounded_only[:, BOUNDED]).std()
    assert spread == pytest.approx(np.sqrt(platform.whole.predictive_covariance[BOUNDED, BOUNDED]), rel=0.3)


def test_the_second_pass_has_one_trajectory_and_its_prior(configs, tmp_path):
    prior = tmp_path / "prior.json"
    config = learned_from(load_config(configs[0]), "icp", prior)
    assert config.noise.file == prior
    assert config.noise.use == "prior"
    assert list(config.trajectories) == ["icp"]


def test_campaign_pools_and_reports_the_gain(configs, tmp_path, monkeypatch):
    """Both passes with a stand-in for the session: held-out error is what the prior's median is off by."""

    def _run(config, _folder, _outputs):
        truth = {"one": 2.0, "two": 3.0, "three": 4.0}[config.name]
        guess = 1.0
        if config.noise.file is not None:
            stored = read_noise(config.noise.file, COMPONENTS)
            guess = float(np.exp(stored.theta_mean - FAMILY.mean)[0])
        error_m = abs(np.log(truth / guess))
        held_out = {"mean_m": error_m, "rms_m": error_m, "coverage_50": 0.5, "coverage_95": 1.0, "n_failed": 0}
        figures = {"n_locations": 4, "loo": {"coarse": None, "fixed": None, "learned": held_out}, "warnings": []}
        found = learned(truth)
        found |= {"ensemble": {"correlation_m": found.pop("correlation_m")}}
        return {"trajectories": {"icp": figures}}, {"icp": {"learned": found}}

    monkeypatch.setattr(campaign_task, "_run", _run)
    ran = run_here(monkeypatch)
    assert run_campaign(asked(tmp_path, *configs[:3], pool=True)) == 0
    assert len(ran) == 6
    found = summary_of(tmp_path)
    pooled = found["pooled"]["all"]["pooled_over_learned"]
    assert pooled["n"] == 3
    assert pooled["ratio"] < 0.7
    assert found["pooled"]["at_most_5_locations"]["pooled_over_learned"] == pooled
    assert found["platforms"]["lidar_icp"]["n_sessions"] == 3
    import pyarrow.parquet as pq

    rows = pq.read_table(tmp_path / "campaign.parquet").to_pylist()
    assert [(each["pooled_status"], each["pooled_n_sessions"]) for each in rows] == [("ok", 2)] * 3
    # Nothing changed: neither pass is run again, and the priors' files stay.
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "priors").rglob("*.json")}
    assert run_campaign(asked(tmp_path, *configs[:3], pool=True)) == 0
    assert len(ran) == 6
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "priors").rglob("*.json")} == before
    assert set(json.loads((tmp_path / "pooled_noise.json").read_text())["trajectories"]) == {"lidar_icp"}


def test_gains_are_geometric_and_say_how_sure():
    rows = [{"held_out_a_mean_m": a, "held_out_b_mean_m": 1.0} for a in (0.5, 0.5, 2.0, None)]
    found = gain(rows, "a", "b")
    assert found["n"] == 3
    assert found["ratio"] == pytest.approx(0.5 ** (1 / 3))
    assert found["share_better"] == pytest.approx(2 / 3)
    assert found["interval_95"][0] < found["ratio"] < found["interval_95"][1]
    assert gain([], "a", "b")["ratio"] is None
