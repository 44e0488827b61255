import os
from pathlib import Path

import numpy as np
import pytest
from data_root import data_root
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from jaxgeo.errors import CloudError, ScanError
from jaxgeo.io.ply import PlyHeader, PlyWriter, ply_vertices, read_ply_header

CODES = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
TYPE_NAME = dict(zip(CODES, ("char", "uint8", "short", "ushort", "int32", "uint", "float", "float64"), strict=True))
XYZ = np.dtype([("x", "f4"), ("y", "f4"), ("z", "f4")])


@st.composite
def tables(draw: st.DrawFn) -> np.ndarray:
    codes = draw(st.lists(st.sampled_from(CODES), min_size=1, max_size=5))
    n = draw(st.integers(0, 7))
    table = np.empty(n, [(f"p{i}", code) for i, code in enumerate(codes)])
    for name in table.dtype.names:
        table[name] = draw(hnp.arrays(table.dtype[name], n))
    return table


def whole(path: Path, header: PlyHeader, chunk: int = 3) -> np.ndarray:
    chunks = list(ply_vertices(path, header, chunk))
    assert all(0 < len(c) <= chunk for c in chunks)
    return np.concatenate([np.empty(0, header.dtype), *chunks])


def same(a: np.ndarray, b: np.ndarray) -> bool:
    """Equal field by field, NaN to NaN, whatever the byte order."""
    return a.dtype.names == b.dtype.names and all(
        np.array_equal(a[n], b[n], equal_nan=b.dtype[n].kind == "f") for n in b.dtype.names
    )


def text_of(table: np.ndarray, form: str, n: int | None = None, extra: str = "") -> bytes:
    lines = ["ply", f"format {form} 1.0", "comment made by hand", f"element vertex {len(table) if n is None else n}"]
    lines += [f"property {TYPE_NAME[table.dtype[name].str[1:]]} {name}" for name in table.dtype.names]
    return ("\n".join(lines) + f"\n{extra}end_header\n").encode()


@given(tables(), st.integers(1, 9), st.lists(st.text("abc :+.0", max_size=9).map(str.strip), max_size=3))
def test_what_is_written_reads_back(tmp_path_factory, table: np.ndarray, block: int, comments: list[str]) -> None:
    path = tmp_path_factory.mktemp("ply") / "a.ply"
    with PlyWriter(path, table.dtype, comments) as writer:
        for start in range(0, len(table), block):
            writer.append(table[start : start + block])
    header = read_ply_header(path)
    assert header.n_vertices == len(table) == writer.count
    assert header.comments == tuple(comments)
    assert header.dtype == table.dtype
    assert same(whole(path, header), table)


@pytest.mark.parametrize("form", ["ascii", "binary_big_endian", "binary_little_endian"])
@given(table=tables())
def test_every_format_reads_the_same(tmp_path_factory, form: str, table: np.ndarray) -> None:
    path = tmp_path_factory.mktemp("ply") / "a.ply"
    faces = b"3 0 1 2\n" if form == "ascii" else b"\x03\0\0\0\0"
    extra = "element face 1\nproperty list uchar int vertex_indices\n"
    if form == "ascii":
        body = "".join(" ".join(repr(float(v)) for v in row) + "\n" for row in table.tolist()).encode()
    else:
        body = table.astype(table.dtype.newbyteorder(">" if "big" in form else "<")).tobytes()
    path.write_bytes(text_of(table, form, extra=extra) + body + faces)
    assert same(whole(path, read_ply_header(path)), table)


def test_another_librarys_cloud() -> None:
    path = data_root() / "lidar/small_gicp/source.ply"
    header = read_ply_header(path)
    assert header.comments[0].startswith("Created by CloudCompare")
    points = whole(path, header, 20_000)
    assert points.dtype.names == ("x", "y", "z", "scalar_intensity")
    assert len(points) == header.n_vertices == 69792
    assert np.isfinite(points["x"]).all()


def test_an_element_before_the_vertices_is_skipped(tmp_path: Path) -> None:
    head = "ply\r\nformat {} 1.0\r\nelement camera 2\r\nproperty double f\r\nelement vertex 1\r\nproperty uchar v\r\n"
    path = tmp_path / "a.ply"
    path.write_bytes(head.format("ascii").encode() + b"end_header\r\n1.5\r\n2.5\r\n7\r\n")
    assert whole(path, read_ply_header(path))["v"].tolist() == [7]
    path.write_bytes(head.format("binary_little_endian").encode() + b"end_header\r\n" + bytes(16) + b"\x07")
    assert whole(path, read_ply_header(path))["v"].tolist() == [7]


HEAD = "ply\nformat ascii 1.0\nelement vertex {n}\nproperty float x\nproperty uchar v\nend_header\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"is empty; a PLY file starts with"),
        ("solid cube\n", r"starts with b'solid cube\\n'"),
        ("ply\nformat ascii 1.0\nelement vertex 5\n", r":3: the header does not come to its `end_header`"),
        ("ply\nelement vertex 5\nend_header\n", r"no `format` line; expected `format ascii\|binary"),
        ("ply\nformat ascii 1.0\nend_header\n", r"no `element vertex` in the header \(elements: none\)"),
        ("ply\nformat ascii 1.0\nelement vertex 1\nend_header\n", r":3: the vertices have no properties"),
        ("ply\nformat ascii 1.0\nelement vertex -4\nend_header\n", r":3: 'element vertex -4' in the header; expected"),
        (HEAD.format(n=1).replace("float", "half"), r":4: 'property half x' in the header"),
        (HEAD.format(n=1).replace("uchar v", "uchar x"), r":5: property 'x' a second time"),
        (HEAD.format(n=1).replace("uchar v", "list uchar int v"), r":3: element 'vertex' has the list property 'v'"),
        (HEAD.format(n=3) + "1 2\n3 4\n", r":9: the header announces 3 vertices, but the file ends after 2"),
        (HEAD.format(n=10**17) + "1 2\n", r":8: the header announces 1"),
        (HEAD.format(n=2) + "1 2\n3 4 5\n", r":8: '3 4 5'; expected 2 numbers: x, v"),
        (HEAD.format(n=2) + "1 2\n\n3 4\n", r":8: ''; expected 2 numbers"),
        (HEAD.format(n=2) + "1 2\nx 4\n", r":8: 'x 4'; expected 2 numbers"),
        (HEAD.format(n=2) + "1 2\n1 256\n", r":8: property 'v' holds 256; expected a whole number from 0 to 255"),
        (HEAD.format(n=2) + "1 2.5\n1 25\n", r":7: property 'v' holds 2.5"),
        (HEAD.format(n=1) + "1 nan\n", r":7: property 'v' holds nan"),
    ],
)
def test_what_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "a.ply"
    path.write_text(text)
    with pytest.raises(ScanError, match=message):
        list(ply_vertices(path, read_ply_header(path, ScanError)))


@pytest.mark.parametrize("kept", [0, 11, 12, 35])
def test_a_cut_binary_file_is_refused_before_the_first_row(tmp_path: Path, kept: int) -> None:
    path = tmp_path / "a.ply"
    with PlyWriter(path, XYZ) as writer:
        writer.append(np.zeros(3, XYZ))
    header = read_ply_header(path)
    os.truncate(path, header.offset + kept)
    with pytest.raises(CloudError, match=rf"3 vertices of 12 bytes, but the file ends after {kept // 12} of them"):
        next(ply_vertices(path, header))


def test_a_failure_leaves_no_file_and_keeps_the_old(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    path.write_text("old")
    rows = [np.zeros(3, XYZ), np.zeros(3, [("x", "f4")])]  # the second has other fields
    with pytest.raises(TypeError), PlyWriter(path, XYZ) as writer:  # noqa: PT012 (a block is what fails)
        for row in rows:
            writer.append(row)
    assert [p.name for p in tmp_path.iterdir()] == ["a.ply"]
    assert path.read_text() == "old"


@pytest.mark.parametrize(
    ("dtype", "comments", "message"),
    [
        ([("t", "i8")], [], "field 't' of type int64"),
        ([("a b", "f4")], [], "field 'a b'"),
        ([("x", "f4")], ["end_header\nx"], "one line of plain ASCII"),
    ],
)
def test_what_cannot_be_written(tmp_path: Path, dtype, comments: list[str], message: str) -> None:
    with pytest.raises(CloudError, match=message):
        PlyWriter(tmp_path / "a.ply", np.dtype(dtype), comments)
