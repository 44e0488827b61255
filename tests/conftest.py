"""JAX as strict as it goes, its compiled programs kept in the repository's `.cache`, hypothesis short and repeatable.

No silent promotion of dtypes or ranks in anything that the tests touch. jaxlie breaks under both: `jaxgeo.geometry`
wraps it; a test that calls jaxlie itself does so inside `jax.numpy_dtype_promotion("standard")` and
`jax.numpy_rank_promotion("allow")`.
"""

import os
from collections.abc import Iterator
from pathlib import Path

# Most of a cold run is compiling, each program for a few calls: half of LLVM's work on them is not worth its time.
os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_backend_optimization_level=0".strip()

import hypothesis
import jax
import pytest

import jaxgeo  # noqa: F401  (float64 before any test makes an array)
from jaxgeo.precision import assert_float64, enable_compilation_cache

jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")
enable_compilation_cache(Path(__file__).resolve().parents[1] / ".cache" / "xla")

# No deadline: the first example of a property compiles. In CI the same examples every time.
hypothesis.settings.register_profile("default_jaxgeo", deadline=None, max_examples=25)
hypothesis.settings.register_profile("ci", deadline=None, max_examples=25, derandomize=True)
hypothesis.settings.load_profile("ci" if os.environ.get("CI") else "default_jaxgeo")


# Files that compile for the same shapes run in one process, one after the other: each of their programs is compiled
# once. A file that stands nowhere here is a group of its own.
GROUPS = {
    "200 poses": (
        "calibration/test_baselines.py",
        "cli/test_evaluate.py",
        "cli/test_learned_noise.py",
        "cli/test_study_paper.py",
        "eval_/test_cost.py",
        "eval_/test_first_visits.py",
        "eval_/test_loo.py",
        "eval_/test_noise_baselines.py",
        "eval_/test_oracles.py",
        "eval_/test_subsets.py",
    ),
}


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "xdist_group(name): tests that one process runs (pytest-xdist)")


# First: xdist's own hook reads the marks.
@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    tests = Path(__file__).parent
    group = {tests / name: title for title, names in GROUPS.items() for name in names}
    assert all(path.exists() for path in group)
    for item in items:
        item.add_marker(pytest.mark.xdist_group(group.get(item.path, str(item.path))))


@pytest.fixture(autouse=True, scope="session")
def _float64() -> None:
    assert_float64()


# A compiled program takes hundreds of memory maps; Linux gives a process 65 530, and XLA crashes without a word when
# they run out. Programs that are needed again come from the cache on disk.
_MANY_MAPS = 20_000


@pytest.fixture(autouse=True, scope="module")
def _programs_let_go() -> Iterator[None]:
    yield
    maps = Path("/proc/self/maps")
    if maps.exists() and len(maps.read_text().splitlines()) > _MANY_MAPS:
        jax.clear_caches()
