"""The small session's files, to be spoilt, and the figures of a run that goes well."""

import json
import shutil
from pathlib import Path

import jax
import pytest
from cli.bad_input.runs import run
from cli.small_session import write_small_session


@pytest.fixture(scope="session")
def sound(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sound")
    write_small_session(folder)
    return folder


@pytest.fixture
def session(sound, tmp_path, monkeypatch):
    """The small session's files, to be spoilt."""
    monkeypatch.delenv("JAXGEO_DATA", raising=False)
    # The folder of compiled programs that the whole suite uses.
    monkeypatch.setenv("JAXGEO_CACHE", jax.config.jax_compilation_cache_dir)
    return Path(shutil.copytree(sound, tmp_path / "session"))


@pytest.fixture
def metrics(session, capsys):
    """The figures of a run that goes well."""

    def read(name: str = "poses", *overrides: str) -> dict:
        assert run(session, name, *overrides) == 0, capsys.readouterr().err
        return json.loads((session / "out" / "metrics.json").read_text())["trajectories"]["icp"]

    return read
