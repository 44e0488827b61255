"""Any bytes at all: every reader gives valid data or a refusal that says where, and nothing else.

`JAXGEO_FUZZ_EXAMPLES=N` tries N damaged files a reader; without it a few, the same ones every time.
"""

import os
import random
from pathlib import Path

import hypothesis
import pytest
from hypothesis import strategies as st

from benchmarks.fuzz.target import BrokenContractError, Target, attempt
from benchmarks.fuzz.targets import TARGETS
from jaxgeo.errors import InputError

EXAMPLES = int(os.environ.get("JAXGEO_FUZZ_EXAMPLES", "30"))


@pytest.fixture(scope="module", autouse=True)
def _quiet() -> None:
    """What OpenCV, FFmpeg and libpng print of damaged images is theirs."""
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


@pytest.mark.parametrize("name", TARGETS)
def test_the_examples_are_read(name: str, tmp_path: Path) -> None:
    for example in TARGETS[name].examples():
        assert attempt(TARGETS[name], example, tmp_path) is None


@pytest.mark.parametrize(("name", "why"), [(name, why) for name, t in TARGETS.items() for why in t.once_crashed])
def test_what_once_crashed(name: str, why: str, tmp_path: Path) -> None:
    attempt(TARGETS[name], TARGETS[name].once_crashed[why], tmp_path)


@pytest.mark.parametrize("name", TARGETS)
def test_damaged_files(name: str, folder: Path) -> None:
    target = TARGETS[name]
    place = folder / name
    place.mkdir()

    # Without shrinking: a damaged file is small, and its damage named by its generator's seed.
    @hypothesis.settings(
        max_examples=EXAMPLES, derandomize=True, database=None, deadline=None, phases=[hypothesis.Phase.generate],
        suppress_health_check=list(hypothesis.HealthCheck),
    )  # fmt: skip
    @hypothesis.given(st.integers(0, 2**63))
    def holds(seed: int) -> None:
        attempt(target, target.mutated(random.Random(seed)), place)

    holds()


@pytest.mark.parametrize("name", TARGETS)
def test_no_file_and_an_empty_one(name: str, tmp_path: Path) -> None:
    target = TARGETS[name]
    if target.places:
        with pytest.raises(InputError, match="missing"):
            _refused_without_a_file(target, tmp_path / f"missing{target.suffix}")
    attempt(target, b"", tmp_path)


def _refused_without_a_file(target: Target, path: Path) -> None:
    try:
        target.read(path)
    except FileNotFoundError as failure:  # a target that is handed the content: the file is its caller's
        raise InputError(f"{path}: missing") from failure


def _target(read, check=lambda value: None) -> Target:
    return Target("own", ".txt", "text", read, check, lambda: (b"1\n",), ())


def _raises(error: Exception):
    def read(path: Path) -> None:
        raise error

    return read


def _writes(path: Path) -> None:
    path.with_suffix(".log").touch()


def _warns(path: Path) -> None:
    import warnings

    warnings.warn("divide by zero", RuntimeWarning, stacklevel=1)


def _is_never_valid(value: object) -> None:
    raise AssertionError


@pytest.mark.parametrize(
    ("target", "says"),
    [
        (_target(_raises(ValueError("x"))), "ValueError"),
        (_target(_raises(InputError("no place"))), "name the file"),
        (_target(_writes), "wrote"),
        (_target(_warns), "RuntimeWarning"),
        (_target(lambda path: None, _is_never_valid), "AssertionError"),
        (_target(lambda path: _raises(InputError(f"{path}:9: x"))(path)), "line 9"),
        (_target(lambda path: _raises(InputError(f"{path}: {'x' * 3000}"))(path)), "characters"),
        (_target(lambda path: _raises(InputError(f"{path}: \ud800"))(path)), "printed"),
    ],
)
def test_breaches_are_seen(target: Target, says: str, tmp_path: Path) -> None:
    with pytest.raises(BrokenContractError, match=says):
        attempt(target, b"1\n", tmp_path)


def test_damage_is_the_same_for_the_same_seed() -> None:
    target = TARGETS["tum"]
    files = [target.mutated(random.Random(seed)) for seed in range(50)]
    assert files == [target.mutated(random.Random(seed)) for seed in range(50)]
    assert len(set(files)) > 40
