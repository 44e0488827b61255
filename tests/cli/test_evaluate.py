"""`jaxgeo evaluate` on small sessions: one with its own files and report, several with combined tables."""

import csv
import io
from pathlib import Path

import pytest
from cli.small_session import write_small_session

from jaxgeo.cli.main import main

FAST = ("--set", "evaluate.leave_one_out=true", "--set", "evaluate.cost=false", "--set", "evaluate.subsets=2")


@pytest.fixture(scope="module")
def config(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("session")
    write_small_session(folder)
    return folder / "poses.yaml"


@pytest.fixture(scope="module")
def one(config, tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("one") / "out"
    assert main(["evaluate", str(config), "--out", str(out), *FAST, "--quiet"]) == 0
    return out


def table(folder: Path, name: str) -> list[dict[str, str]]:
    lines = (folder / "tables" / f"{name}.csv").read_text(encoding="utf-8").splitlines()
    return list(csv.DictReader(io.StringIO("\n".join(line for line in lines if not line.startswith("#")))))


def test_one_session_has_its_own_files_with_the_tables_in_its_report(one):
    for name in ("metrics.json", "noise.json", "trajectory_grid.csv", "run.json", "tables/effect.tex"):
        assert (one / name).is_file(), name
    page = (one / "report.html").read_text(encoding="utf-8")
    for words in ("Accuracy against the number of anchors k", "Trajectory icp", "Near-collinear locations"):
        assert words in page


def test_simulated_is_not_said_of_what_was_not_simulated(one):
    assert "imulated" not in (one / "tables" / "tables.md").read_text(encoding="utf-8")
    assert "reference study" not in (one / "tables" / "tables.md").read_text(encoding="utf-8")


def test_rows_carry_what_they_were_computed_with(one):
    for row in table(one, "effect"):
        assert row["anchors"] == "7"
        assert row["result"].startswith("7 ")
        assert row["versions"].startswith("jaxgeo ")
    assert [row["noise"][:11] for row in table(one, "effect")] == ["none", "sigma_trans"]


def test_rows_of_fewer_anchors_say_what_their_choices_were_computed_with(one):
    for row in table(one, "by_count"):
        assert row["anchors"] == f"those of {row['k']} locations"
        assert row["result"] == f"{row['choices']} converged; 0 failed"


@pytest.mark.slow
def test_noise_of_a_file_is_that_of_every_choice_of_anchors(config, tmp_path):
    """All but one location is leave-one-out, under the noise of a file too; every visit is held out once in both."""
    learned, given = tmp_path / "learned", tmp_path / "given"
    learn = ("--set", "noise.mode=learned")
    assert main(["calibrate", str(config), "--out", str(learned), *learn, "--quiet"]) == 0
    noise = ("--set", "noise.use=fixed", "--set", f"noise.file={learned}/noise.json")
    all_choices = (*FAST[:4], "--set", "evaluate.subsets=6", *noise, "--quiet")
    assert main(["evaluate", str(config), "--out", str(given), *all_choices]) == 0
    (left_out,) = [row for row in table(given, "effect") if row["stage"] == "fixed noise"]
    (choices,) = [row for row in table(given, "by_count") if row["stage"] == "fixed noise" and row["k"] == "5"]
    assert choices["choices"] == "6"
    mean = float(left_out["leave one location out [cm]: mean"])
    assert float(choices["held out [cm]: mean"]) == pytest.approx(mean, rel=1e-6)


def test_several_sessions_are_told_apart_and_tabled_together(config, tmp_path):
    other = config.with_name("other.yaml")
    other.write_text(config.read_text(encoding="utf-8").replace("name: small", "name: other"), encoding="utf-8")
    out = tmp_path / "out"
    assert main(["evaluate", str(config), str(other), "--out", str(out), *FAST, "--quiet"]) == 0
    assert (out / "small" / "metrics.json").is_file()
    assert (out / "other" / "report.html").is_file()
    assert {row["session"] for row in table(out, "effect")} == {"small", "other"}
    rows = {session: [r for r in table(out, "effect") if r["session"] == session] for session in ("small", "other")}
    mean = "leave one location out [cm]: mean"
    assert [r[mean] for r in rows["small"]] == [r[mean] for r in rows["other"]]
    assert "together" in {row["trajectory"] for row in table(out, "uncertainty")}


def test_two_sessions_of_one_name_are_refused(config, tmp_path, capsys):
    again = config.with_name("again.yaml")
    again.write_text(config.read_text(encoding="utf-8"), encoding="utf-8")
    assert main(["evaluate", str(config), str(again), "--out", str(tmp_path / "out"), *FAST]) == 2
    message = capsys.readouterr().err
    assert "'small'" in message
    assert "poses.yaml" in message
    assert not (tmp_path / "out").exists()


def test_nothing_held_out_is_nothing_to_evaluate(config, tmp_path, capsys):
    assert main(["evaluate", str(config), "--out", str(tmp_path / "out")]) == 2
    assert "evaluate.leave_one_out" in capsys.readouterr().err


def test_an_orthophoto_that_cannot_be_read_is_named(config, tmp_path, capsys):
    photo = tmp_path / "photo.tif"
    photo.write_bytes(b"no TIFF")
    assert main(["evaluate", str(config), "--out", str(tmp_path / "out"), *FAST, "--set", f"basemap={photo}"]) == 2
    assert "photo.tif" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
