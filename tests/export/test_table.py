"""One table in four formats: the numbers that are printed, what is missing, and marks that could break a format."""

import csv
import html
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxgeo.errors import InputError
from jaxgeo.export.table import (
    Column,
    Table,
    cell_text,
    csv_text,
    html_text,
    latex_text,
    markdown_text,
    table_files,
    write_tables,
)

CM = Column("mean", "cm", "held-out", 1, factor=100.0)
TABLE = Table(
    "loo",
    "Leave one location out, simulated",
    (
        Column("trajectory", align="left"),
        Column("k"),
        CM,
        Column("RMS", "cm", "held-out", 1, factor=100.0),
        Column("gain", "%", digits=0, factor=100.0),
    ),
    (("UAV_icp", 6, 2.159, 2.3194, 0.081), ("50 % & more | _x_", 3, float("nan"), None, -0.3)),
    ("Ours are simulated.", "100 % of $5 is #1."),
    (("mean", None, 2.159, 2.319, None),),
)


def csv_rows(text: str) -> list[list[str]]:
    return list(csv.reader(line for line in text.splitlines() if not line.startswith("#")))


@pytest.mark.parametrize(
    ("value", "column", "text"),
    [
        (1.2346, CM, "123.5"),
        (-0.0001, CM, "0.0"),
        (-0.5, CM, "−50.0"),
        (np.float64("nan"), CM, "–"),
        (None, CM, "–"),
        (float("inf"), Column("x"), "–"),
        (np.int64(7), Column("n", digits=2), "7"),
        (1, CM, "100.0"),
        (0.297, Column("share", "%", digits=1, factor=100.0), "29.7"),
        (1.23456789, Column("x"), "1.23457"),
        ("A_revisit", CM, "A_revisit"),
        (np.True_, Column("ok"), "yes"),
    ],
)
def test_a_value_is_printed_in_its_columns_unit_and_digits(value, column, text):
    assert cell_text(value, column) == text


@given(st.floats(-1e4, 1e4), st.floats(1e-3, 1e4))
def test_csv_reads_back_to_the_value(value, other):
    rows = csv_rows(csv_text(Table("t", "t", (CM, CM), ((value, other),))))
    assert float(rows[1][0]) / 100.0 == pytest.approx(value, rel=1e-11, abs=1e-300)
    assert float(rows[1][1]) / 100.0 == pytest.approx(other, rel=1e-11)


def test_csv_has_one_header_line_with_group_and_unit_and_empty_cells_for_what_is_missing():
    text = csv_text(TABLE)
    head, *rows = csv_rows(text)
    assert head == ["trajectory", "k", "held-out: mean [cm]", "held-out: RMS [cm]", "gain [%]"]
    assert rows == [["UAV_icp", "6", "215.9", "231.94", "8.1"], ["50 % & more | _x_", "3", "", "", "-30.0"]]
    assert text.startswith("# Leave one location out, simulated\n")
    assert "Ours" not in text


def test_markdown_has_as_many_cells_in_every_line():
    lines = [line for line in markdown_text(TABLE).splitlines() if line.startswith("|")]
    cells = [re.split(r"(?<!\\)\|", line)[1:-1] for line in lines]
    assert [len(row) for row in cells] == [5] * 5
    assert [c.strip() for c in cells[1]] == [":---", "---:", "---:", "---:", "---:"]
    assert [c.strip() for c in cells[2]] == ["UAV_icp", "6", "215.9", "231.9", "8"]
    assert [c.strip() for c in cells[3]] == [r"50 % & more \| \_x\_", "3", "–", "–", "−30"]
    assert cells[4][0].strip() == "**mean**"
    assert "\n- Ours are simulated.\n" in markdown_text(TABLE)


def test_latex_rows_fit_the_columns_and_nothing_is_left_unescaped():
    text = latex_text(TABLE)
    inside = text[text.index(r"\toprule") : text.index(r"\bottomrule")]
    spans = []
    for line in inside.replace("\\\\\n", "\x00").split("\x00")[:-1]:
        cells = re.split(r"(?<!\\)&", line)
        spans.append(sum(int(m.group(1)) if (m := re.search(r"multicolumn\{(\d+)\}", c)) else 1 for c in cells))
    assert spans == [5] * 5
    assert r"\begin{tabular}{@{}lrrrr@{}}" in text
    assert r"\cmidrule(lr){3-4}" in text
    assert r"UAV\_icp & 6 & 215.9 & 231.9 & 8 \\" in text
    assert r"50 \% \& more $|$ \_x\_ & 3 & -- & -- & $-$30 \\" in text
    assert r"100 \% of \$5 is \#1." in text
    assert text.count("{") == text.count("}")
    assert text.isascii()


def test_latex_of_a_first_cell_that_a_line_end_would_swallow():
    text = latex_text(Table("t", "t", (Column("x", align="left"),), (("[0, 1]",), ("*",))))
    assert "{}[0, 1] \\\\\n{}* \\\\" in text


def test_html_is_the_reports_table_with_notes_below():
    text = html_text(TABLE)
    assert html.escape("50 % & more | _x_") in text
    assert '<th class="group edge" colspan="2">held-out</th>' in text
    assert text.index("</table>") < text.index('<p class="note">Ours are simulated.</p>')
    assert text.count("<td") == 15


def test_columns_without_groups_have_one_header_line():
    table = Table("t", "t", (Column("a"), Column("b")), ((1, 2),))
    assert table.groups == []
    assert "multicolumn{2}" not in latex_text(table)
    assert "colspan" not in html_text(table)


def test_groups_of_one_name_apart_stay_apart():
    a, b = Column("x", group="a"), Column("x", group="b")
    assert Table("t", "t", (a, a, b, a), ()).groups == [("a", 2), ("b", 1), ("a", 1)]


def test_write_tables_writes_three_files_each_and_all_in_one(tmp_path):
    other = Table("other", "Other", (Column("a"),), ((1,),))
    paths = write_tables(tmp_path / "tables", [TABLE, other])
    names = ["loo.csv", "loo.md", "loo.tex", "other.csv", "other.md", "other.tex", "tables.md"]
    assert [p.name for p in paths] == names
    assert sorted(p.name for p in (tmp_path / "tables").iterdir()) == names
    assert (tmp_path / "tables" / "tables.md").read_text() == f"{markdown_text(TABLE)}\n{markdown_text(other)}"
    assert table_files([TABLE, other]) == {p.name: p.read_text() for p in paths}


def test_a_table_that_cannot_be_is_refused(tmp_path):
    with pytest.raises(ValueError, match="2 values for 1 columns"):
        Table("t", "t", (Column("a"),), ((1, 2),))
    with pytest.raises(ValueError, match="letters, digits"):
        Table("a/b", "t", (Column("a"),), ())
    with pytest.raises(ValueError, match="'loo' is taken"):
        table_files([TABLE, TABLE])
    with pytest.raises(ValueError, match="'tables' is taken"):
        table_files([Table("tables", "t", (Column("a"),), ())])
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="is a file"):
        write_tables(tmp_path / "file", [TABLE])


def test_what_is_for_the_csv_alone_is_printed_nowhere_else():
    columns = (*TABLE.columns, Column("versions", align="left", csv_only=True))
    table = Table(
        "loo",
        TABLE.title,
        columns,
        tuple((*row, "jaxgeo 1") for row in TABLE.rows),
        TABLE.notes,
        tuple((*row, "") for row in TABLE.footer),
    )
    assert csv_rows(csv_text(table))[0][-1] == "versions"
    assert csv_rows(csv_text(table))[1][-1] == "jaxgeo 1"
    for write in (markdown_text, latex_text, html_text):
        assert write(table) == write(TABLE)
