from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from jaxgeo.errors import InputError, SurveyError
from jaxgeo.io import float_columns, read_table, text_column
from jaxgeo.io.text_table import column_index


def write(tmp_path: Path, text: str | bytes) -> Path:
    path = tmp_path / "table.txt"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=60)
@given(
    values=hnp.arrays(float, st.tuples(st.integers(1, 5), st.integers(2, 5)), elements=st.floats(-1e300, 1e300)),
    separator=st.sampled_from([",", ", ", ";", "\t", " ", "   ", " ; "]),
    end=st.sampled_from(["\n", "\r\n", "\r"]),
    header=st.sampled_from(["", "# ", "#", "plain"]),
    bom=st.booleans(),
)
def test_all_ways_to_write_a_table_read_the_same(
    tmp_path: Path, values: np.ndarray, separator: str, end: str, header: str, bom: bool
) -> None:
    names = [f"c{i}" for i in range(values.shape[1])]
    lines = [separator.join(map(repr, row)) for row in values.tolist()]
    if header:
        lines.insert(0, header.replace("plain", "") + separator.join(names))
    path = write(
        tmp_path,
        ("\ufeff" if bom else "")
        + end.join(["# more words than columns, whatever, the, separator, may, turn, out, to be", "", *lines]),
    )
    table = read_table(path)
    assert table.header == (tuple(names) if header else ())
    np.testing.assert_array_equal(float_columns(table, range(values.shape[1])), values)
    first = 4 if header else 3
    assert table.line.tolist() == list(range(first, first + len(values)))


def test_columns_by_name_or_index(tmp_path: Path) -> None:
    table = read_table(write(tmp_path, 'id, E (m), N [m]\n"T 6", 1.5, 2\nB, 3, 4\n'))
    assert table.header == ("id", "E", "N")
    assert text_column(table, "id") == ["T 6", "B"]
    assert float_columns(table, ["n", 1]).tolist() == [[2, 1.5], [4, 3]]  # case ignored where there is no doubt
    with pytest.raises(InputError, match=r"no column named 'h'; the header has id, E, N\."):
        column_index(table, "h")
    for bad in (3, -1):
        with pytest.raises(InputError, match=rf"column index {bad}, but the table has 3 columns: expected 0 to 2"):
            column_index(table, bad)


def test_names_that_differ_in_case_stay_apart(tmp_path: Path) -> None:
    table = read_table(write(tmp_path, "h H\n1 2\n"))
    assert float_columns(table, ["h", "H"]).tolist() == [[1, 2]]
    repeated = read_table(write(tmp_path, "h h\n1 2\n"))
    with pytest.raises(InputError, match="2 columns named 'h'"):
        column_index(repeated, "h")


def test_a_header_of_another_length_is_none(tmp_path: Path) -> None:
    table = read_table(write(tmp_path, "# stamp id x y\n1 2 3\n"))
    assert table.header == ()
    with pytest.raises(InputError, match=r"asked for by name, but the file has no header line with 3 names.*indices"):
        column_index(table, "x")


def test_blank_cells_are_nan_only_where_asked(tmp_path: Path) -> None:
    table = read_table(write(tmp_path, "1,,3\n4,5,6\n"))
    np.testing.assert_array_equal(float_columns(table, [1], blank_is_nan=True), [[np.nan], [5]])
    with pytest.raises(InputError, match=r"table\.txt:1: column 1 \(counted from 0\) holds ''; expected a number"):
        float_columns(table, [1])


@pytest.mark.parametrize("cell", ["1_000", "٣", "0x10", "1d3", "--1"])
def test_what_only_looks_like_a_number(tmp_path: Path, cell: str) -> None:
    table = read_table(write(tmp_path, f"1 2\n3 {cell}\n"))
    with pytest.raises(InputError, match=rf"table\.txt:2: column 1 .* holds '{cell}'; expected a number"):
        float_columns(table, [0, 1])


def test_the_guilty_line_is_found_far_down(tmp_path: Path) -> None:
    rows = ["1 2"] * 50_000
    rows[34_567] = "1 x"
    with pytest.raises(InputError, match=r"table\.txt:34568: column 1"):
        float_columns(read_table(write(tmp_path, "\n".join(rows))), [0, 1])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", r"table\.txt: the file is empty"),
        (b" \n\n", r"table\.txt: the file is empty"),
        (b"# a\n# b\n", r"table\.txt: no data rows, only comments"),
        (b"name,E,N\n", r"table\.txt:2: a header \('name,E,N'\) but no data rows"),
        (b"1,2\n3,4,5\n", r"table\.txt:2: 3 columns, expected 2 as in line 1 \(separator: comma\)"),
        (b"1 2\n\n3\n", r"table\.txt:3: 1 columns, expected 2 as in line 1 \(separator: blanks\)"),
        (b"1 2\n3 \x00\x01\x02\n", r"table\.txt:2: byte 0x00 is not UTF-8 text.*binary"),
        (b"\x89PNG\r\n\x1a\n", r"table\.txt:1: byte 0x89 is not UTF-8 text"),
        ("name,1\nZürich,2\n".encode("latin-1"), r"table\.txt:2: byte 0xfc is not UTF-8 text.*another encoding"),
        (b"1;2,5\n", r"table\.txt:1: column 1 .* holds '2,5'; a decimal comma\? write a decimal point"),
    ],
)
def test_bad_files(tmp_path: Path, content: bytes, message: str) -> None:
    path = write(tmp_path, content)
    with pytest.raises(SurveyError, match=message):
        float_columns(read_table(path, error=SurveyError), [0, 1])


def test_a_delimiter_is_one_character(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="delimiter '::': expected one character"):
        read_table(write(tmp_path, "1::2\n"), delimiter="::")
    assert float_columns(read_table(write(tmp_path, "1|2\n"), delimiter="|"), [1]).tolist() == [[2]]


def test_a_file_that_may_not_be_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_table(tmp_path / "gone")
    with pytest.raises(InputError, match="is a folder"):
        read_table(tmp_path)
    with pytest.raises(InputError, match="cannot be read: "):
        read_table(write(tmp_path, "1 2") / "below")
