"""JAX as strict as it goes, its compiled programs kept in the repository's `.cache`, hypothesis short and repeatable.

No silent promotion of dtypes or ranks in anything that the tests touch. jaxlie breaks under both: `jaxgeo.geometry`
wraps it; a test that calls jaxlie itself does so inside `jax.numpy_dtype_promotion("standard")` and
`jax.numpy_rank_promotion("allow")`.
"""

import gc
import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

# Most of a cold run is compiling, each program for a few calls: less of LLVM's work, the older generator of loops, and
# each program in one piece, since other processes keep the other cores busy. Together half the time of a cold run.
os.environ["XLA_FLAGS"] = " ".join(
    [
        os.environ.get("XLA_FLAGS", ""),
        "--xla_backend_optimization_level=0",
        "--xla_llvm_disable_expensive_passes=true",
        "--xla_cpu_use_fusion_emitters=false",
        "--xla_cpu_parallel_codegen_split_count=1",
    ]
).strip()

# Several processes share the cores already; torch and BLAS would start as many threads in each.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import hypothesis
import jax
import pytest
from xdist.scheduler import LoadScopeScheduling

import jaxgeo  # noqa: F401  (float64 before any test makes an array)
from jaxgeo.precision import assert_float64, enable_compilation_cache, let_programs_go

jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")
enable_compilation_cache(Path(__file__).resolve().parents[1] / ".cache" / "xla")

# No deadline: the first example of a property compiles. In CI the same examples every time.
hypothesis.settings.register_profile("default_jaxgeo", deadline=None, max_examples=25)
hypothesis.settings.register_profile("ci", deadline=None, max_examples=25, derandomize=True)
hypothesis.settings.load_profile("ci" if os.environ.get("CI") else "default_jaxgeo")


# Files that compile for the same shapes: one process runs them, so that each of their programs is compiled once.
SAME_SHAPES = (
    (
        "tests/calibration/test_baselines.py",
        "tests/cli/test_evaluate.py",
        "tests/cli/test_learned_noise.py",
        "tests/cli/test_study_paper.py",
        "tests/eval_/test_cost.py",
        "tests/eval_/test_first_visits.py",
        "tests/eval_/test_loo.py",
        "tests/eval_/test_noise_baselines.py",
        "tests/eval_/test_oracles.py",
        "tests/eval_/test_subsets.py",
    ),
    ("tests/cli/bad_input/",),
    (
        "tests/cli/test_check.py",
        "tests/cli/test_session_check.py",
        "tests/cli/test_session_corrections.py",
        "tests/cli/test_replay.py",
    ),
)


# Minutes of compiling in few tests: begun first, since whoever got one of them last would let the others wait.
LONGEST = (SAME_SHAPES[0][0], "tests/cli/test_study_montecarlo.py", "tests/calibration/faults/test_find.py")


def shapes_of(nodeid: str) -> str:
    """A test's file, or the first one of its group of `SAME_SHAPES`."""
    file = nodeid.split("::", 1)[0]
    return next((group[0] for group in SAME_SHAPES if file.startswith(group)), file)


class ByShapes(LoadScopeScheduling):
    """Hands out whole files, and those of one group of `SAME_SHAPES` together, in the order of the collection."""

    def _split_scope(self, nodeid: str) -> str:
        return shapes_of(nodeid)


@pytest.hookimpl(optionalhook=True)  # with -p no:xdist it is not there
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> ByShapes:
    config.option.loadscopereorder = False
    return ByShapes(config, log)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest first, then those with the most tests; slow ones where they are asked for."""
    if "JAXGEO_SLOW_TESTS" not in os.environ:
        for item in items:
            if item.get_closest_marker("slow"):
                item.add_marker(pytest.mark.skip(reason="half a minute of compiling: JAXGEO_SLOW_TESTS=1"))
    count = Counter(shapes_of(item.nodeid) for item in items)

    def place(item: pytest.Item) -> tuple[int, int]:
        shapes = shapes_of(item.nodeid)
        return LONGEST.index(shapes) if shapes in LONGEST else len(LONGEST), -count[shapes]

    items.sort(key=place)


@pytest.fixture(autouse=True, scope="session")
def _float64() -> None:
    assert_float64()


@pytest.fixture(autouse=True, scope="module")
def _programs_let_go() -> Iterator[None]:
    """Between files; what is still there is JAX's, which the garbage collector need not go through again and again."""
    yield
    let_programs_go()
    gc.collect()
    gc.freeze()
