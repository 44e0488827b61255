"""`jaxgeo study montecarlo`: the same bits on any number of devices, and after any interruption."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import jax
import numpy as np
import pytest

from eval.montecarlo.batch import evaluate_sessions, on_devices, session_mesh
from eval.montecarlo.regimes import regimes_named
from eval.montecarlo.sessions import session_arrays, stacked
from eval.montecarlo.settings import study_settings
from jaxgeo.cli.main import main
from jaxgeo.cli.montecarlo_bar import SessionBar

ROOT = Path(__file__).resolve().parents[2]
SMALL = ("--draws", "8", "--poses", "128", "--chunk", "2", "--batch", "1", "--regimes", "white,biased")
RESULTS = ("sessions.csv", "summary.json", "summary.md", "summary.csv", "sigmas.tex", "uncertainty.md")


def start(out: Path, *options: str, devices: int | None = None) -> subprocess.Popen:
    environment = os.environ | {"JAXGEO_CACHE": str(ROOT / ".cache" / "xla")}
    flags = re.sub(r"\S*host_platform_device_count\S*", "", environment.get("XLA_FLAGS", ""))
    if devices is not None:
        flags = f"{flags} --xla_force_host_platform_device_count={devices}"
    return subprocess.Popen(
        [sys.executable, "-m", "jaxgeo.cli.main", "study", "montecarlo", "--out", str(out), *SMALL, *options],
        env=environment | {"XLA_FLAGS": flags.strip()},
        cwd=ROOT,
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def finish(process: subprocess.Popen) -> str:
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    return out + err


def wait_for(path: Path, process: subprocess.Popen) -> None:
    while not path.exists():
        assert process.poll() is None, process.communicate()[1]
        time.sleep(0.01)


def arrays(out: Path) -> dict[str, np.ndarray]:
    found = []
    for path in sorted((out / "chunks").glob("*.npz")):
        with np.load(path) as file:
            found.append(dict(file))
    return {name: np.stack([each[name] for each in found]) for name in found[0]}


@pytest.fixture(scope="module")
def eight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The study on eight virtual devices, in one call, simulated by a worker."""
    out = tmp_path_factory.mktemp("montecarlo") / "eight"
    assert "on 8 x cpu" in finish(start(out, "--workers", "1", devices=8))
    return out


def test_killed_and_on_other_devices_the_results_are_the_same_bits(eight, tmp_path):
    out = tmp_path / "killed"
    process = start(out, "--workers", "0", "--devices", "1")
    wait_for(out / "chunks" / "00000.npz", process)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    there = sorted((out / "chunks").glob("[0-9]*.npz"))
    assert 1 <= len(there) < 4
    assert not (out / "summary.json").exists()
    before = {path: path.stat().st_mtime_ns for path in there}
    said = finish(start(out, "--workers", "0", "--devices", "1"))
    assert f"going on: {2 * len(there)} of 8 simulated sessions are there" in said
    assert {path: path.stat().st_mtime_ns for path in there} == before
    for name, array in arrays(eight).items():
        equal = np.array_equal(array, arrays(out)[name], equal_nan=array.dtype.kind == "f")
        assert equal, name
    for name in RESULTS:
        assert (out / name).read_bytes() == (eight / name).read_bytes(), name


@pytest.mark.slow
def test_side_by_side_as_on_an_accelerator_gives_the_same(eight):
    """By `vmap` instead of one after the other: the last digits may differ, nothing else."""
    settings = study_settings(8, 0, regimes_named("white,biased"), platform="gpu", poses=128, chunk=2, batch=2)
    assert settings.side_by_side
    mesh = session_mesh(jax.devices()[:1])
    sessions = on_devices(stacked([session_arrays(settings.regime_of(i), i, settings.layout) for i in (0, 1)], 2), mesh)
    found = jax.tree.map(np.asarray, evaluate_sessions(sessions, mesh, settings.side_by_side))
    expected = arrays(eight)
    assert found.good.all()
    visits = expected["error_m"].shape[3]
    np.testing.assert_allclose(found.error_m[:, :, :visits], expected["error_m"][0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.covariance_m2[:, :, :visits], expected["covariance_m2"][0], rtol=1e-7)


def test_a_finished_study_is_only_tabulated_again(eight, capsys):
    (eight / "summary.json").unlink()
    # In this process, whose JAX has one device: what is there needs none.
    assert main(["study", "montecarlo", "--out", str(eight), *SMALL]) == 0
    assert "going on: 8 of 8" in capsys.readouterr().err
    found = json.loads((eight / "summary.json").read_text(encoding="utf-8"))
    assert found["simulated"] is True
    assert found["failed"] == 0
    ratio = found["regimes"]["white"]["ratio"]
    assert 0.7 < ratio["learned"] < 1.4
    # With the noise known, a graph is better than a similarity: errors are not mixed up among the stages.
    assert ratio["similarity"] > 1.05


def test_every_file_says_simulated(eight):
    for path in eight.iterdir():
        if path.suffix in (".csv", ".md", ".tex", ".json"):
            assert "simulated" in path.read_text(encoding="utf-8").lower(), path.name
    assert bool(arrays(eight)["simulated"].all())


def test_other_settings_are_refused(eight, capsys):
    assert main(["study", "montecarlo", "--out", str(eight), *SMALL, "--seed", "5"]) == 2
    assert "seed is 0 there and 5 here" in capsys.readouterr().err


def test_bad_options_are_refused(tmp_path, capsys):
    assert main(["study", "montecarlo", "--out", str(tmp_path / "new"), "--regimes", "purple"]) == 2
    assert "expected some of white, biased" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()
    file = tmp_path / "file"
    file.touch()
    assert main(["study", "montecarlo", "--out", str(file)]) == 2
    assert "is a file" in capsys.readouterr().err


@pytest.mark.parametrize(("stop", "code"), [(KeyboardInterrupt, 130), (signal.SIGTERM, 143)])
def test_an_interrupted_study_says_how_to_go_on(eight, tmp_path, monkeypatch, capsys, stop, code):
    import eval.montecarlo.study as study

    out = tmp_path / "stopped"

    def run_study(*_: object) -> None:
        (out / "chunks" / "00000.npz").write_bytes((eight / "chunks" / "00000.npz").read_bytes())
        if stop is KeyboardInterrupt:
            raise stop
        signal.raise_signal(stop)

    monkeypatch.setattr(study, "run_study", run_study)
    assert main(["study", "montecarlo", "--out", str(out), *SMALL]) == code
    said = capsys.readouterr().err
    assert "stopped: 1 of 4 chunks are in" in said
    assert "the same command goes on from there" in said


def test_the_bar_counts_what_was_there_apart(capsys, monkeypatch):
    clock = [0.0]
    monkeypatch.setattr("jaxgeo.cli.montecarlo_bar.time.perf_counter", lambda: clock[0])
    with SessionBar(100, "2 x cpu") as bar:
        bar.begin(40)
        clock[0] = 10.0
        bar.done(30)
        clock[0] = 26.0
        bar.done(10)
        clock[0] = 30.0
        bar.done(20)
    lines = capsys.readouterr().err.splitlines()
    assert lines == [
        "going on: 40 of 100 simulated sessions are there",
        "80 of 100 simulated sessions, 1.5 a second on 2 x cpu, 26 s, 13 s left",
        "100 of 100 simulated sessions, 2.0 a second on 2 x cpu, 30 s",
    ]
