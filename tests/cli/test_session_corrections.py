"""Corrections within a run: what is applied and what not, and that a held-out location stays out of its fold.

A stand-in estimates; learning and the folds are the real ones, in programs that other small sessions have compiled.
"""

import numpy as np
import pytest
from cli.small_session import write_small_session
from numpy.testing import assert_allclose

import calibration.corrections_folds as folds
import jaxgeo.cli.session_corrections as corrections
from calibration.calibrate import LearnSettings
from calibration.corrections import CorrectionEstimate
from jaxgeo.cli.ingest import ingest
from jaxgeo.cli.main import main
from jaxgeo.cli.progress import Progress
from jaxgeo.cli.session import Clock, anchored, run_session, settings_of
from jaxgeo.cli.session_corrections import SessionCorrections, as_recorded, estimated
from jaxgeo.config import load_config
from jaxgeo.export.metrics import metrics_dict
from jaxgeo.export.report import report_html
from jaxgeo.graph.noise_defaults import default_noise
from jaxgeo.solve.corrections import ARM, TIME, CorrectionPrior, Motion

PRIOR = CorrectionPrior(time_offset_s=0.1, lever_arm_m=0.05, rotation_rad=0.0)
OPTIONS = (
    "noise.mode=learned",
    "evaluate.leave_one_out=true",
    "corrections={time_offset: {}, lever_arm: {}}",
    "origin_enh_m=[77000, 69000, 300]",
)
# What E's survey point is moved by, N and E, metres.
MOVED_M = (0.3, -0.2)


def estimate(value: np.ndarray, share: float) -> CorrectionEstimate:
    """With standard deviations of `share` of the prior's."""
    motion = Motion(0.1, 0.05, 0.12, 0.03, (0.9, 0.9, 0.9))
    covariance = np.diag((share * PRIOR.sigma) ** 2)
    return CorrectionEstimate(value, covariance, PRIOR.sigma, np.eye(7), np.eye(7), None, 0.0, 5, 7, 21, motion)


def of_what_is_given(_trajectory, _sightings, visits, survey, *, prior, **_options) -> CorrectionEstimate:
    """A small offset, and an arm of centimetres that depends on the coordinates of every location visited."""
    assert_allclose(prior.sigma, PRIOR.sigma)
    places_m = np.array([survey.enh_m[survey.name.index(visit.location)] for visit in visits])
    value = np.zeros(7)
    value[ARM], value[TIME] = 1e-2 * np.sin(places_m.sum(axis=0)), 1e-3
    return estimate(value, 0.02)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("corrections")
    write_small_session(made)
    rows = [row.split(",") for row in (made / "survey.csv").read_text().splitlines()]
    for row in rows:
        if row[0] == "E":
            row[1:3] = (str(float(x) + by) for x, by in zip(row[1:3], MOVED_M, strict=True))
    (made / "moved.csv").write_text("".join(",".join(row) + "\n" for row in rows))
    return made


@pytest.fixture(scope="module")
def runs(folder):
    """The session as surveyed, and with E moved."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(corrections, "estimate_corrections", of_what_is_given)
        patch.setattr(folds, "estimate_corrections", of_what_is_given)
        return [
            run_session(load_config(folder / "poses.yaml", [*OPTIONS, f"survey.file={file}"]), Progress(quiet=True))
            for file in (folder / "survey.csv", folder / "moved.csv")
        ]


def test_nothing_of_a_held_out_location_reaches_its_fold(runs):
    """A visit's own fold predicts it at the same place, wherever its location was surveyed."""
    first, second = (
        t.anchors.surveyed_enh_m + t.held_out["learned"].error_enh_m for t in (r.trajectories["icp"] for r in runs)
    )
    at_e = np.array(runs[0].trajectories["icp"].anchors.location) == "E"
    assert_allclose(first[at_e], second[at_e], atol=1e-9)
    assert np.linalg.norm(first - second, axis=1)[~at_e].min() > 1e-4


def test_what_is_applied_is_in_the_anchors_the_metrics_and_the_report(runs, folder):
    result = runs[0]
    found = result.trajectories["icp"]
    plain = anchored_of(folder)[1]
    assert found.anchors.label == plain.label
    assert np.abs(found.anchors.lever_arm_m - plain.lever_arm_m).max() > 1e-3
    metrics = metrics_dict(result)["trajectories"]["icp"]
    assert metrics["corrections"]["applied"]
    assert [row["name"] for row in metrics["corrections"]["rows"]][:2] == ["time_offset_s", "lever_arm_x_m"]
    assert (metrics["corrections"]["visits"], metrics["corrections"]["sightings"]) == (7, 21)
    assert metrics["check"] is None  # only `jaxgeo run` asks for it
    assert set(metrics["loo"]["learned"]["result"].values()) == {"converged"}
    page = report_html(result)
    assert "Clock and camera" in page
    assert "time offset: observable, +1.0 ms" in page
    assert "The similarity and the fixed noise have the sightings as they were recorded" in page
    assert "Learned odometry noise and the corrections of clock and camera together: held out" in page


def anchored_of(folder, *more: str):
    config = load_config(folder / "poses.yaml", [*OPTIONS, *more])
    data = ingest(config)
    trajectory, anchors, _ = anchored("icp", settings_of(config), data, Clock(Progress(quiet=True), "icp"))
    return trajectory, anchors, data, config


def made_of(folder, monkeypatch, found: CorrectionEstimate, *more: str) -> SessionCorrections:
    monkeypatch.setattr(corrections, "estimate_corrections", lambda *_args, **_options: found)
    trajectory, anchors, data, config = anchored_of(folder, *more)
    learn = LearnSettings("lidar", default_noise("lidar"))
    assert config.corrections is not None
    return estimated(config.corrections, trajectory, anchors, data, settings_of(config), learn)


def test_what_is_not_applied_says_why(folder, monkeypatch):
    small = np.zeros(7)
    small[TIME] = 0.001
    blurred = made_of(folder, monkeypatch, estimate(small, 0.9)).facts()
    assert not blurred["applied"]
    assert blurred["sentences"][-1] == "Not applied: none of them is observable."
    told = made_of(
        folder, monkeypatch, estimate(small, 0.02), "corrections={time_offset: {}, lever_arm: {}, apply: false}"
    )
    assert told.anchors is None
    assert told.facts()["sentences"][-1] == "Not applied: corrections.apply is false."
    # Two seconds early: the first visit would be before the first pose.
    early = np.zeros(7)
    early[TIME] = -2.5
    lost = made_of(folder, monkeypatch, estimate(early, 0.02)).facts()
    assert not lost["applied"]
    assert lost["sentences"][-1].startswith(
        "Not applied, for with their stamps corrected 3 of 21 sightings lie outside"
    )


def test_mode_fixed_is_refused(folder, capsys):
    assert main(["run", str(folder / "poses.yaml"), "--set", "corrections={time_offset: {}}"]) == 2
    assert "noise.mode is fixed: learn it, or remove 'corrections'" in capsys.readouterr().err


def test_other_commands_say_that_they_take_the_sightings_as_recorded(folder):
    assert as_recorded(load_config(folder / "poses.yaml", []), "jaxgeo check") == ()
    (said,) = as_recorded(load_config(folder / "poses.yaml", OPTIONS), "jaxgeo check")
    assert said.endswith("jaxgeo check takes the sightings as recorded.")
