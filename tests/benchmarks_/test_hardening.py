"""The figures that are quoted of wrong anchors, and of the parts together, on made-up rows."""

import pytest

from benchmarks.hardening import HEADLINE, headline
from benchmarks.wrong_anchors import line, rate, summary


def row(fault: str, *, found: bool, named: bool) -> dict:
    said = {"truth": "the truth", "said": "what was said", "beside": [], "truth_beside": False, "truth_open": False}
    return {"seed": 1, "fault": fault, "found": found, "named": named, "label_alarm": 0.0, "seconds": 1.0} | said


ROWS = [
    *[row("clean", found=i == 0, named=False) for i in range(4)],
    row("mislabelled", found=True, named=True),
    row("mislabelled", found=True, named=False),
    row("shifted", found=True, named=True),
    row("shifted", found=True, named=True),
    row("exchanged", found=False, named=False),
    row("jumped", found=False, named=False),
    row("jumped", found=True, named=False),
]


def test_a_fault_counts_only_where_it_is_named_and_a_clean_session_where_anything_is_found():
    found = summary(ROWS, [])
    assert found["mislabel_found"] == 0.75
    assert found["shift_found"] == 1.0
    assert found["swap_found"] == 0.0
    assert found["mislabel_false_alarm"] == 0.25
    assert found["rates"]["mislabelled: found and named"]["hits"] == 1
    assert found["rates"]["missed: found"] is None
    # The odometry's fault: to name nothing is right, to blame an anchor is not.
    assert found["rates"]["jumped: an anchor blamed alone"]["hits"] == 1


def test_intervals_are_clopper_and_pearsons():
    # Their tables: 0 of 10, 95 %.
    assert rate([False] * 10) == {
        "hits": 0,
        "of": 10,
        "share": 0.0,
        "interval_95": [0.0, pytest.approx(0.3085, abs=1e-4)],
    }
    assert rate([]) is None


def test_a_false_alarm_is_printed_as_what_it_is():
    assert line(ROWS[0]).startswith("NOT")
    assert line(ROWS[1]).startswith("ok")
    assert line(ROWS[4]).startswith("ok")
    assert line(ROWS[5]).startswith("NOT")
    assert line(ROWS[9]).startswith("ok")
    assert line(ROWS[10]).startswith("NOT")
    assert line(ROWS[10] | {"truth_beside": True}).startswith("open")


def test_a_part_that_was_not_run_has_no_figure():
    found = headline({"anchors": summary(ROWS, [])})
    assert list(found) == [key for keys in HEADLINE.values() for key in keys]
    assert found["mislabel_found"] == 0.75
    assert found["online_anchor_p99_ms"] is None
    assert found["campaign_rows"] is None
