"""Who may import whom, and what the tree may not say."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("jaxgeo", "calibration", "eval")

# A part imports itself and what stands before its line; the first line's parts also import each other.
LAYERS = (
    {"errors", "precision", "processes", "data"},
    {"geometry"},
    {"io", "associate", "georef", "graph"},
    {"solve", "detect", "odometry"},
    {"mapping", "online"},
    {"export", "simulate", "config"},
    {"cli"},
)
RANK = {part: rank for rank, parts in enumerate(LAYERS) for part in parts}

# Optional and heavy: the adapter files that may import them.
ADAPTERS: dict[str, set[str]] = {
    "torch": {"jaxgeo/detect/mask_batched.py", "jaxgeo/detect/tune.py", "jaxgeo/mapping/kornia_features.py"},
    "kornia": {"jaxgeo/detect/mask_batched.py", "jaxgeo/detect/tune.py", "jaxgeo/mapping/kornia_features.py"},
    "kornia_rs": {"jaxgeo/detect/kornia_quads.py"},
    "open3d": {"jaxgeo/mapping/fusion_open3d.py", "jaxgeo/simulate/sensors/ray_casting.py"},
    "laspy": {"jaxgeo/io/clouds/las.py"},
    "kiss_icp": {"jaxgeo/odometry/kiss.py"},
    "small_gicp": {"jaxgeo/odometry/registration.py"},
    "rosbags": {"jaxgeo/io/bag_reader.py", "jaxgeo/simulate/sensors/bag_file.py"},
    "rerun": set(),
    "rasterio": {"jaxgeo/io/orthophoto.py"},
    "dask": {"jaxgeo/cli/campaign_cluster.py"},
    "distributed": {"jaxgeo/cli/campaign_cluster.py"},
    "pyarrow": {"jaxgeo/cli/campaign_parquet.py"},
}
ORACLES = {"evo", "gtsam"}


def modules() -> Iterator[Path]:
    for package in PACKAGES:
        yield from sorted((ROOT / package).rglob("*.py"))


def imports(path: Path) -> list[tuple[int, str]]:
    """(line, dotted module) of everything imported anywhere in a file; `from a import b` counts as a.b."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            found += [(node.lineno, f"{node.module}.{alias.name}") for alias in node.names]
    return found


def refusal(path: Path, module: str) -> str | None:
    """Why this file may not import this module; None where it may."""
    here = path.relative_to(ROOT).with_suffix("").parts
    there = module.split(".")
    if there[0] in ORACLES:
        return "an oracle of the tests"
    if there[0] in ADAPTERS and path.relative_to(ROOT).as_posix() not in ADAPTERS[there[0]]:
        return "for its adapter files only"
    if there[0] not in PACKAGES:
        return None
    if here[:2] == ("jaxgeo", "cli"):
        return None
    if there[:2] == ["jaxgeo", "cli"] or PACKAGES.index(there[0]) > PACKAGES.index(here[0]):
        return "packages point one way: jaxgeo <- calibration <- eval <- jaxgeo/cli"
    if here[0] != "jaxgeo" or there[0] != "jaxgeo" or here[1] == "__init__" or there[1] == "__version__":
        return None
    lower = RANK[there[1]] < RANK[here[1]] or RANK[there[1]] == RANK[here[1]] == 0
    return None if lower or there[1] == here[1] else "layers inside jaxgeo point one way"


def test_imports_point_one_way():
    wrong = [
        f"{path.relative_to(ROOT)}:{line}: imports {module}: {why}"
        for path in modules()
        for line, module in imports(path)
        if (why := refusal(path, module))
    ]
    assert not wrong, "\n".join(wrong)


def test_every_part_of_jaxgeo_has_its_layer():
    parts = {
        path.stem for path in (ROOT / "jaxgeo").iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()
    }
    assert parts - {"__init__"} == set(RANK)


@pytest.mark.parametrize(
    ("file", "module"),
    [
        ("jaxgeo/solve/a.py", "eval.loo"),
        ("jaxgeo/graph/a.py", "calibration.reml"),
        ("calibration/a.py", "eval.loo"),
        ("calibration/a.py", "jaxgeo.cli.main"),
        ("eval/a.py", "jaxgeo.cli.main"),
        ("jaxgeo/errors.py", "jaxgeo.geometry.so3"),
        ("jaxgeo/graph/a.py", "jaxgeo.solve.solver"),
        ("jaxgeo/io/a.py", "jaxgeo.graph.chain"),
        ("jaxgeo/simulate/a.py", "jaxgeo.config.load"),
        ("jaxgeo/io/a.py", "rosbags.highlevel"),
        ("eval/a.py", "evo.core"),
        ("jaxgeo/solve/a.py", "gtsam"),
    ],
)
def test_the_rule_refuses(file, module):
    assert refusal(ROOT / file, module)


@pytest.mark.parametrize(
    ("file", "module"),
    [
        ("jaxgeo/cli/a.py", "eval.loo"),
        ("eval/a.py", "calibration.reml"),
        ("calibration/a.py", "jaxgeo.solve.solver"),
        ("jaxgeo/data/a.py", "jaxgeo.errors.InputError"),
        ("jaxgeo/export/a.py", "jaxgeo.io.tum"),
        ("jaxgeo/export/a.py", "jaxgeo.__version__"),
        ("jaxgeo/io/a.py", "numpy"),
    ],
)
def test_the_rule_allows(file, module):
    assert refusal(ROOT / file, module) is None


def test_everything_imports_without_the_heavy_libraries():
    adapters = {file for files in ADAPTERS.values() for file in files}
    names = [
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        for path in modules()
        if path.relative_to(ROOT).as_posix() not in adapters
    ]
    code = (
        f"import importlib, sys; [importlib.import_module(name) for name in {names!r}];"
        f"print([name for name in {sorted({*ADAPTERS, *ORACLES})!r} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "[]", done.stdout + done.stderr


def test_help_waits_for_nothing_that_commands_alone_need():
    slow = ["scipy", "cv2", "pyproj", "matplotlib", "pydantic", "equinox", "optimistix"]
    code = f"import jaxgeo.cli.main, sys; print([name for name in {slow!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "[]", done.stdout + done.stderr


def test_no_path_of_one_machine():
    machine = re.compile(r"(?<![\w.$}/])/(?:work|root|home|tmp|Users)/\w")
    own = [path for path in ROOT.rglob("*") if not set(path.relative_to(ROOT).parts) & IGNORED and path.is_file()]
    found = [
        f"{path.relative_to(ROOT)}: {match.group()}"
        for path in own
        if path.suffix not in (".png", ".jpg", ".gif", ".pyc")
        and (match := machine.search(path.read_text(encoding="utf-8", errors="replace")))
    ]
    assert len(own) > 50
    assert not found, "\n".join(found)


IGNORED = {
    ".git",
    ".venv",
    ".cache",
    "out",
    "__pycache__",
    ".pytest_cache",
    ".ruff_cache",
    ".hypothesis",
    "build",
    "dist",
}
