"""`jaxgeo replay`: what it writes of a session, and what it refuses."""

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest
import typer
from cli.small_session import N_POSES, RATE_HZ, write_small_session
from typer.testing import CliRunner

from jaxgeo.cli.replay import COLUMNS, replay_config
from jaxgeo.cli.replay_command import replay
from jaxgeo.errors import ConfigError, SightingError, UndeterminedError

# A visit ends two seconds after its last sighting.
FIRST_SOLVED_S = 2 * 6.0 + 1.6 + 2.0 + 1.0 / RATE_HZ


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("replay")
    write_small_session(made)
    return made


@pytest.fixture(scope="module")
def replayed(folder):
    replay_config(folder / "poses.yaml", folder / "out", [], None, quiet=True)
    return folder / "out"


def rows(path: Path) -> list[dict[str, str]]:
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    return list(csv.DictReader(lines))


def test_every_pose_has_its_row_as_it_was_known_then(replayed):
    found = rows(replayed / "online.csv")
    assert tuple(found[0]) == COLUMNS
    assert len(found) == N_POSES
    first = next(i for i, row in enumerate(found) if row["status"] == "georeferenced")
    assert float(found[first]["stamp_s"]) == pytest.approx(FIRST_SOLVED_S)
    assert all(row["status"] == "undetermined" and row["E_m"] == "" for row in found[:first])
    assert all(row["status"] == "georeferenced" for row in found[first:])
    count = [int(row["n_anchors"]) for row in found]
    assert count == sorted(count)
    assert count[-1] == 7
    # The uncertainty grows until the next anchor comes.
    sigma = np.array([float(row["sigma_E_m"]) for row in found[first:]])
    assert sigma[1] > sigma[0]
    came = np.flatnonzero(np.diff(count[first:]))
    assert np.all(sigma[came + 1] < sigma[came])


def test_the_end_is_the_batch_answer(replayed):
    found = json.loads((replayed / "replay.json").read_text())["trajectories"]["icp"]
    assert (found["n_poses"], found["n_anchors"], found["noise"]) == (N_POSES, 7, "fixed")
    assert found["final_minus_batch_m"]["max"] < 1e-3
    assert found["first_georeferenced_s"] == pytest.approx(FIRST_SOLVED_S)
    assert found["latency_ms"]["anchor"]["count"] == 7
    assert found["latency_ms"]["odometry"]["count"] == N_POSES
    assert found["behind_ms"] is None
    assert found["warnings"] == []


def test_positions_are_near_the_truth(replayed, folder):
    truth = np.loadtxt(folder / "truth.tum")
    found = [row for row in rows(replayed / "online.csv") if row["E_m"]]
    position = np.array([[float(row[key]) for key in ("E_m", "N_m", "h_m")] for row in found])
    off = position - truth[-len(found) :, 1:4]
    assert np.linalg.norm(off, axis=1).max() < 0.3


def test_a_rate_paces_it(folder):
    replay_config(folder / "truth.yaml", folder / "paced", [], 100.0, quiet=True)
    found = json.loads((folder / "paced" / "replay.json").read_text())
    assert found["rate"] == 100.0
    behind = found["trajectories"]["icp"]["behind_ms"]
    assert behind["count"] == N_POSES
    # Rows of the truth are visits each of its own: the next pose ends them.
    assert found["trajectories"]["icp"]["latency_ms"]["anchor"]["count"] == 7


def test_learned_noise_is_not_known_on_the_way(folder, capsys):
    replay_config(folder / "poses.yaml", folder / "learned", ["noise.mode=learned"], None, quiet=False)
    shown = capsys.readouterr()
    assert "warning: icp: noise.mode is learned, but a session's noise is learned from its end" in shown.err
    assert "E: 5 anchors, georeferenced, E 79" in shown.err
    assert "200 poses, 7 anchors; anchor p50" in shown.out


def test_what_it_refuses(folder, tmp_path):
    for rate in (0.0, -1.0, math.nan):
        with pytest.raises(ConfigError, match=r"--rate is .*; expected seconds of the recording a second, above 0"):
            replay_config(folder / "poses.yaml", tmp_path / "out", [], rate, quiet=True)
    with pytest.raises(SightingError, match=r"visits were found but visits\.order names 7"):
        replay_config(folder / "poses.yaml", tmp_path / "out", ["visits.gap_s=0.5"], None, quiet=True)
    two = ["visits.order=null", 'visits.locations={"A": A, "B": B}', "survey.ignore=[C, D, E, F]"]
    with pytest.raises(UndeterminedError, match=r"trajectories\.icp: the 3 anchor\(s\) at 2 location\(s\) \(A, B\)"):
        replay_config(folder / "corners.yaml", tmp_path / "out", two, None, quiet=True)
    assert not (tmp_path / "out").exists()


def test_the_command_line(folder):
    app = typer.Typer()
    app.command()(replay)
    shown = CliRunner().invoke(app, ["--help"])
    assert shown.exit_code == 0
    for word in ("--out", "--set", "--rate", "--quiet"):
        assert word in shown.output
    done = CliRunner().invoke(app, [str(folder / "poses.yaml"), "--out", str(folder / "command"), "--quiet"])
    assert (done.exit_code, done.output) == (0, "")
    assert sorted(path.name for path in (folder / "command").iterdir()) == ["online.csv", "replay.json"]
