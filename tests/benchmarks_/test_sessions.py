"""The sentences under the table of real sessions, on made-up rows."""

import pytest

from benchmarks.sessions import failed_row, geometric_mean_ratio, markdown, ratio_of, summary


def row(session: str, coarse: float, fixed: float, learned: float | None) -> dict:
    known = {"coarse_mean_m": coarse, "fixed_mean_m": fixed, "learned_mean_m": learned, "result": "converged"}
    return failed_row(session, "", 1.0) | known | {"n_poses": 1, "n_visits": 1, "n_locations": 1}


ROWS = [row("a", 1.0, 0.5, 0.25), row("b", 1.0, 2.0, 1.2), row("c", 1.0, 0.5, 0.52), row("d", 1.0, 1.0, None)]


def test_ratios_leave_out_what_is_missing():
    assert geometric_mean_ratio(ROWS, "fixed") == pytest.approx((0.5 * 2.0 * 0.5 * 1.0) ** 0.25)
    assert geometric_mean_ratio(ROWS, "learned") == pytest.approx((0.25 * 1.2 * 0.52) ** (1 / 3))
    assert ratio_of(ROWS[2], ["coarse", "fixed"], "learned") == pytest.approx(1.04)
    assert ratio_of(ROWS[3], ["coarse"], "learned") is None


def test_summary_counts_where_learning_costs():
    *_, last = summary([*ROWS, failed_row("e", "no file", 1.0)])
    assert last == (
        "Learned noise at most 5 % worse than the better of similarity and fixed noise: 2 of 3 rows; the worst ratio "
        "is 1.20 (b)."
    )


def test_every_row_of_the_table_has_every_column():
    lines = markdown([*ROWS, failed_row("e", "a | b", 1.0)]).splitlines()
    table = [line.replace("\\|", "") for line in lines if line.startswith("|")]
    assert len({line.count("|") for line in table}) == 1
    assert len(table) == 2 + 5
