"""Every reader is a target of fuzzing, or says why not: a new one fails here until it is."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.fuzz.once_crashed import ONCE_CRASHED
from benchmarks.fuzz.targets import EXCEPTIONS, TARGETS

ROOT = Path(__file__).resolve().parents[2]
COVERED = {name for target in TARGETS.values() for name in target.covers}
# Where files of others are read; elsewhere, whoever opens a file.
EDGES = ("jaxgeo/io", "jaxgeo/config")
OPENERS = {"open", "read_bytes", "read_text", "loads", "imread", "load", "VideoCapture", "fromfile", "loadtxt"}
READERS = {"read_lines", "read_table", "read_json", "read_yaml", "parse_yaml"}
FILES = {"path", "file", "folder", "source", "data", "text", "message", "stamps", "times"}


def readers() -> Iterator[str]:
    """Dotted names of the public functions and classes that take a file or its content."""
    for package in ("jaxgeo", "calibration", "eval"):
        for path in sorted((ROOT / package).rglob("*.py")):
            module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            edge = path.relative_to(ROOT).as_posix().startswith(EDGES)
            for node in ast.parse(path.read_text(encoding="utf-8")).body:
                if isinstance(node, ast.FunctionDef | ast.ClassDef) and (takes_a_file(node) if edge else opens(node)):
                    yield f"{module}.{node.name}"


def takes_a_file(node: ast.FunctionDef | ast.ClassDef) -> bool:
    if node.name.startswith(("_", "write", "check", "dump")) or node.name.endswith("Writer"):
        return False
    made = node if isinstance(node, ast.FunctionDef) else _init_of(node)
    return made is not None and bool({argument.arg for argument in made.args.args} & FILES)


def opens(node: ast.FunctionDef | ast.ClassDef) -> bool:
    called = [each.func for each in ast.walk(node) if isinstance(each, ast.Call)]
    return any(
        (isinstance(function, ast.Attribute) and function.attr in OPENERS)
        or (isinstance(function, ast.Name) and function.id in READERS | {"open"})
        for function in called
    )


def _init_of(node: ast.ClassDef) -> ast.FunctionDef | None:
    return next((each for each in node.body if isinstance(each, ast.FunctionDef) and each.name == "__init__"), None)


def test_every_reader_is_a_target_or_says_why_not() -> None:
    without = sorted(set(readers()) - COVERED - set(EXCEPTIONS))
    assert without == [], "give them a target in benchmarks/fuzz, or a reason in EXCEPTIONS of its targets.py"


def test_nothing_is_listed_that_is_not_there() -> None:
    modules = {name.rpartition(".")[0] for name in COVERED | set(EXCEPTIONS)}
    names = set()
    for module in modules:
        tree = ast.parse((ROOT / f"{module.replace('.', '/')}.py").read_text(encoding="utf-8"))
        names |= {f"{module}.{n.name}" for n in tree.body if isinstance(n, ast.FunctionDef | ast.ClassDef)}
    assert COVERED | set(EXCEPTIONS) <= names
    assert not COVERED & set(EXCEPTIONS)
    assert all(EXCEPTIONS.values())


def test_a_reader_without_a_target_is_seen() -> None:
    tree = ast.parse("def read_new(path): ...\nclass New:\n    def __init__(self, path): ...\ndef _own(path): ...")
    assert [takes_a_file(node) for node in tree.body] == [True, True, False]
    assert opens(ast.parse("def f(p):\n    return p.read_bytes()").body[0])


def test_every_file_that_once_crashed_has_its_target() -> None:
    assert set(ONCE_CRASHED) <= set(TARGETS)


@pytest.mark.parametrize("name", TARGETS)
def test_every_target_has_small_examples(name: str) -> None:
    assert TARGETS[name].name == name
    assert all(len(example) < 100_000 for example in TARGETS[name].examples())
