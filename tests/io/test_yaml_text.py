"""YAML as configs use it: what it reads as what, what it refuses, and that dumping is its inverse."""

import math
import time

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from jaxgeo.io.yaml_text import MAX_ALIASES, dump_yaml, parse_yaml

TEXT = st.text(st.characters(codec="utf-8", exclude_categories=["Cs", "Cc"]), max_size=12)
AWKWARD = st.sampled_from(
    ["no", "1:30", "012", "1e-3", "0x1f", "1_000", "~", "", "null", "<<", "2026-01-02", "=", ".5", "-"]
)
SCALAR = st.one_of(st.none(), st.booleans(), st.integers(-(10**20), 10**20), st.floats(allow_nan=False), TEXT, AWKWARD)
DATA = st.recursive(
    SCALAR,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXT | AWKWARD, inner, max_size=4),
    max_leaves=12,
)


@given(DATA)
def test_reads_back_what_it_dumps(data):
    assert parse_yaml(dump_yaml(data)) == data


@given(st.one_of(TEXT, AWKWARD))
def test_other_readers_see_dumped_text_as_text(text):
    assert yaml.safe_load(dump_yaml([text])) == [text]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 0.001),
        ("-2.5E+4", -25000.0),
        (".5", 0.5),
        ("+12", 12),
        ("012", "012"),
        ("1:30", "1:30"),
        ("no", "no"),
        ("True", True),
        ("2026-01-02", "2026-01-02"),
        ("1_000", "1_000"),
        ("0x10", "0x10"),
        ("-.inf", -math.inf),
        ("", None),
        ("{38: a, 007: b, no: c}", {"38": "a", "007": "b", "no": "c"}),
        ("{a: &x {p: 1, q: 2}, b: {<<: *x, q: 3}}", {"a": {"p": 1, "q": 2}, "b": {"p": 1, "q": 3}}),
    ],
)
def test_reads_scalars_and_keys_as_they_are_meant(text, value):
    assert parse_yaml(text) == value


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: 1\nb: 2\na: 3", "line 3, column 1: the key 'a' stands twice"),
        ("a: {38: 1, '38': 2}", "the key '38' stands twice"),
        ("a: [1, 2", "line 1"),
        ("a:\n\t- 1", "line 2"),
        ("{[1, 2]: 3}", "a key must be plain text"),
        ("a: !!python/object/apply:os.system ['true']", "python/object"),
        ("a: *missing", "missing"),
        ("a: 1\n---\nb: 2", "line 2"),
        ("a: \x00", "special characters"),
        ("seed: " + "9" * 5000, "5000 digits"),
        ("[" * 5000, "nested too deeply"),
        ("#" * (1 << 21), "is this a config?"),
    ],
)
def test_refuses_with_the_place(text, message):
    with pytest.raises(ValueError, match=r".") as refusal:
        parse_yaml(text)
    assert message in str(refusal.value)


def test_refuses_a_bomb_of_aliases_at_once():
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 10)]
    start_s = time.perf_counter()
    with pytest.raises(ValueError, match=f"more than {MAX_ALIASES} aliases"):
        parse_yaml("\n".join(lines))
    assert time.perf_counter() - start_s < 1.0
