"""Learned noise through the command line: learned by default, read back as a prior and as it is, and refused clearly.

Every run holds the locations out, so that all of them share one compiled program.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from cli.small_session import write_small_session
from cli.spoil import on_a_line

from jaxgeo.cli.main import main

LEARN = ("--set", "noise.mode=learned")
HOLD_OUT = ("--set", "evaluate.leave_one_out=true", "--set", "evaluate.check=false", "--quiet")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("learned")
    write_small_session(path)
    return path


def run(folder: Path, out: Path, *options: str) -> dict[str, dict]:
    """The outputs of one sound run of the small session."""
    assert main(["run", str(folder / "poses.yaml"), "--out", str(out), *HOLD_OUT, *options]) == 0
    return outputs(out)


def outputs(out: Path) -> dict[str, dict]:
    return {
        name: json.loads((out / name).read_text(), parse_constant=pytest.fail)["trajectories"]["icp"]
        for name in ("metrics.json", "noise.json")
        if (out / name).exists()
    }


@pytest.fixture(scope="module")
def learned(folder, tmp_path_factory) -> tuple[Path, dict]:
    out = tmp_path_factory.mktemp("out") / "learned"
    return out, run(folder, out, *LEARN)


@pytest.fixture(scope="module")
def calibrated(folder, tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("out") / "calibrated"
    assert main(["calibrate", str(folder / "poses.yaml"), "--out", str(out), "--quiet", *LEARN]) == 0
    return out


def grid_positions(out: Path) -> np.ndarray:
    lines = [line for line in (out / "trajectory_grid.csv").read_text().splitlines() if not line.startswith("#")]
    return np.array([line.split(",")[1:4] for line in lines[1:]], dtype=float)


def test_a_run_learns_and_has_every_stage(learned):
    out, found = learned
    metrics = found["metrics.json"]
    for stage in ("coarse", "fixed", "learned"):
        assert metrics["loo"][stage]["mean_m"] > 0.0
        assert metrics["loo"][stage]["n_failed"] == 0
    assert metrics["loo"]["learned"]["mean_m"] != metrics["loo"]["fixed"]["mean_m"]
    assert metrics["solver"]["result"] == "converged"
    assert set(metrics["loo"]["learned"]["result"].values()) == {"converged"}
    assert metrics["loo"]["learned"]["n_with_covariance"] == 7
    assert set(found["noise.json"]) == {"fixed", "learned"}
    assert "Odometry noise, learned" in (out / "report.html").read_text()


def test_learned_is_what_a_config_without_a_mode_asks_for(folder, capsys):
    lines = (folder / "poses.yaml").read_text().splitlines(keepends=True)
    silent = folder / "silent.yaml"
    silent.write_text("".join(line for line in lines if not line.startswith("noise:")))
    assert main(["run", str(silent), "--dump-config"]) == 0
    assert "mode: learned" in capsys.readouterr().out


def test_the_written_trajectory_is_that_of_the_mode(folder, learned, tmp_path):
    out, _ = learned
    fixed = run(folder, tmp_path / "fixed", "--set", "noise.mode=fixed")
    assert fixed["metrics.json"]["loo"]["learned"] is None
    assert set(fixed["noise.json"]) == {"fixed"}
    apart_m = np.linalg.norm(grid_positions(out) - grid_positions(tmp_path / "fixed"), axis=1)
    assert apart_m.max() > 1e-5
    assert apart_m.max() < 0.5


def test_calibrate_learns_the_same_and_draws_it(learned, calibrated):
    _, found = learned
    stages = outputs(calibrated)["noise.json"]
    assert {p.name for p in calibrated.iterdir()} == {"noise.json", "calibration.html"}
    for key in ("theta_mean", "theta_covariance"):
        np.testing.assert_allclose(stages["learned"][key], found["noise.json"]["learned"][key], rtol=1e-6, atol=1e-9)
    assert {"trans_m_per_sqrt_m", "rot_rad_per_sqrt_m"} <= {p["component"] for p in stages["learned"]["profiles"]}
    page = (calibrated / "calibration.html").read_text()
    assert page.count("data:image/svg+xml") == 2
    assert "simulated" not in page.lower()


def test_calibrate_prints_sigmas_models_and_the_file(folder, calibrated, capsys, tmp_path):
    assert main(["calibrate", str(folder / "poses.yaml"), "--out", str(tmp_path / "again"), *LEARN]) == 0
    said = capsys.readouterr().out
    assert "random position drift" in said
    assert "white + bias" in said
    assert said.rstrip().endswith("again/calibration.html")
    assert (tmp_path / "again" / "noise.json").read_bytes() == (calibrated / "noise.json").read_bytes()


def test_another_sessions_noise_as_prior(folder, learned, tmp_path):
    """What was learned is what is expected, less surely by a factor of e^0.5."""
    out, found = learned
    again = run(folder, tmp_path, *LEARN, "--set", f"noise.file={out / 'noise.json'}")
    before, sigmas = found["noise.json"]["learned"], again["noise.json"]["learned"]["sigmas"]
    for sigma in sigmas:
        if sigma["component"] not in before["components"]:
            continue  # the mean of three axes
        i = before["components"].index(sigma["component"])
        assert sigma["prior_median"] == pytest.approx(np.exp(before["theta_mean"][i]), rel=1e-9)
        assert sigma["prior_log_sd"] ** 2 == pytest.approx(before["theta_covariance"][i][i] + 0.5**2, rel=1e-9)
    assert again["metrics.json"]["loo"]["learned"]["n_failed"] == 0


def test_another_sessions_noise_as_it_is(folder, learned, tmp_path):
    """The ensemble of this very session corrects it as learning did."""
    out, _ = learned
    options = ("--set", f"noise={{mode: fixed, use: fixed, file: {out / 'noise.json'}}}")
    found = run(folder, tmp_path, *options)
    np.testing.assert_allclose(grid_positions(tmp_path), grid_positions(out), atol=1e-3)
    assert found["metrics.json"]["loo"]["learned"] is None
    assert found["metrics.json"]["loo"]["fixed"]["n_failed"] == 0
    assert found["noise.json"]["fixed"]["trajectory"] == "icp"


def refused(capsys, *arguments: str) -> str:
    assert main([*arguments]) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: ")
    assert "Traceback" not in said
    return said


@pytest.mark.parametrize("command", ["run", "calibrate"])
def test_nothing_is_learned_where_the_anchors_do_not_fix_the_frame(command, capsys, tmp_path):
    write_small_session(tmp_path)
    on_a_line(tmp_path)
    arguments = [command, str(tmp_path / "truth.yaml"), "--out", str(tmp_path / "out"), *LEARN]
    assert main(arguments) == 3
    assert "do not fix the frame" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_calibrate_with_fixed_noise_is_refused(folder, capsys, tmp_path):
    said = refused(capsys, "calibrate", str(folder / "poses.yaml"), "--out", str(tmp_path / "out"))
    assert "poses.yaml: noise.mode is 'fixed', and jaxgeo calibrate learns" in said
    assert not (tmp_path / "out").exists()


def test_noise_of_another_kind_of_odometry_is_refused(folder, learned, capsys, tmp_path):
    options = (*LEARN, "--set", f"noise.file={learned[0] / 'noise.json'}", "--set", "trajectories.icp.odometry=vio")
    said = refused(capsys, "run", str(folder / "poses.yaml"), "--out", str(tmp_path / "out"), *HOLD_OUT, *options)
    assert "noise.json: trajectory 'icp' is of kind 'lidar', this one of kind 'vio'" in said
    assert not (tmp_path / "out").exists()


def test_a_noise_file_without_learned_noise_is_refused(folder, capsys, tmp_path):
    path = tmp_path / "noise.json"
    path.write_text('{"session": "s", "trajectories": {"icp": {"fixed": {}}}}')
    said = refused(capsys, "run", str(folder / "poses.yaml"), *HOLD_OUT, *LEARN, "--set", f"noise.file={path}")
    assert "noise.json: trajectories.icp holds no learned noise, only a fixed one" in said
