"""Files of one scan each, against the readers and writers of Open3D and small_gicp, and damaged ones."""

import numpy as np
import pytest
from data_root import data_root

from jaxgeo.io.scans.lzf import unpacked
from jaxgeo.io.scans.scan_file import read_scan_file
from jaxgeo.io.scans.scan_source import UnreadableScanError

open3d = pytest.importorskip("open3d")


def points(n: int = 300) -> np.ndarray:
    rng = np.random.default_rng(1)
    out = rng.normal(size=(n, 3)).astype(np.float32) * 20
    out[n // 3 : n // 2] = out[0]  # what a compressor can shorten, overlapping itself
    return out


def xyz(columns) -> np.ndarray:
    return np.stack([columns[name] for name in "xyz"], axis=1)


def write_open3d(path, with_intensity=True, **options):
    cloud = open3d.t.geometry.PointCloud(open3d.core.Tensor(points()))
    if with_intensity:
        cloud.point["intensity"] = open3d.core.Tensor(np.arange(300, dtype=np.float32)[:, None])
    assert open3d.t.io.write_point_cloud(str(path), cloud, **options)
    return path


@pytest.mark.parametrize("suffix", [".pcd", ".ply"])
@pytest.mark.parametrize("options", [{"write_ascii": True}, {}, {"compressed": True}])
def test_what_open3d_writes(tmp_path, suffix, options):
    columns = read_scan_file(write_open3d(tmp_path / f"a{suffix}", **options))
    tolerance = 1e-4 if "write_ascii" in options else 0.0
    np.testing.assert_allclose(xyz(columns), points(), atol=tolerance)
    np.testing.assert_allclose(columns["intensity"], np.arange(300))


def test_what_small_gicp_reads():
    small_gicp = pytest.importorskip("small_gicp")
    path = data_root() / "lidar" / "small_gicp" / "source.ply"
    np.testing.assert_array_equal(xyz(read_scan_file(path)), np.asarray(small_gicp.read_ply(str(path)).points())[:, :3])


def pcd(fields: str, sizes: str, kinds: str, counts: str, n: int, data: str) -> bytes:
    return (
        f"# .PCD v0.7\nVERSION 0.7\nFIELDS {fields}\nSIZE {sizes}\nTYPE {kinds}\nCOUNT {counts}\nWIDTH {n}\nHEIGHT 1\n"
        f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {n}\nDATA {data}\n"
    ).encode()


ROW = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("_", "u1", (4,)), ("t", "<u4"), ("normal", "<f4", (3,))])
HEAD = ("x y z _ t normal", "4 4 4 1 4 4", "F F F U U F", "1 1 1 4 1 3", 5)


def rows() -> np.ndarray:
    out = np.zeros(5, ROW)
    for i, name in enumerate("xyz"):
        out[name] = np.arange(5) + i + 0.5
    out["t"] = np.arange(5) * 4_000_000_000 // 4
    return out


@pytest.mark.parametrize("data", ["ascii", "binary"])
def test_pcd_with_padding_and_fields_of_several_numbers(tmp_path, data):
    path = tmp_path / "a.pcd"
    written = rows()
    if data == "ascii":
        lines = [" ".join(map(str, [r["x"], r["y"], r["z"], *r["_"], r["t"], *r["normal"]])) for r in written]
        path.write_bytes(pcd(*HEAD, data) + "\n".join(lines).encode() + b"\n")
    else:
        path.write_bytes(pcd(*HEAD, data) + written.tobytes())
    columns = read_scan_file(path)
    assert set(columns) == {"x", "y", "z", "t"}
    np.testing.assert_array_equal(columns["t"], written["t"])
    assert columns["t"].dtype == np.uint32
    np.testing.assert_array_equal(columns["z"], written["z"])


def test_lzf_by_hand():
    assert unpacked(b"\x02abc\x20\x02\x00d", 7) == b"abcabcd"
    assert unpacked(b"\x00a" + bytes([0xE0, 10, 0]), 20) == b"a" * 20  # a copy that reaches into itself
    assert unpacked(b"\x01ab" + bytes([0x60, 1]), 7) == b"abababa"
    for data, size, text in (
        (b"\x05abc", 6, "middle of a run"),
        (b"\x02abc\xe0", 9, "middle of a run"),
        (b"\x02abc\x20\x05", 6, "points 6 bytes back, where there are 3"),
        (b"\x02abc", 4, "3 bytes come out, expected 4"),
        (b"\x00a" + bytes([0xE0, 255, 0]) * 9, 20, "more than the announced 20"),
    ):
        with pytest.raises(ValueError, match=text):
            unpacked(data, size)


def refused(path, data: bytes, text: str) -> None:
    path.write_bytes(data)
    with pytest.raises(UnreadableScanError, match=text):
        read_scan_file(path)


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"", "is empty and has no line `DATA`"),
        (b"ply\nformat", r"begins with b'ply\\nformat' and has no line `DATA`"),
        (pcd("x y z", "4 4", "F F F", "1 1 1", 1, "ascii") + b"1 2 3\n", "3 FIELDS and 2 of SIZE"),
        (
            pcd("x y z", "4 4 4", "F F F", "1 1 1", 2, "ascii") + b"1 2 3\n",
            "announces 2 points, but the file ends after 1",
        ),
        (
            pcd("x y z", "4 4 4", "F F F", "1 1 1", 2, "ascii") + b"1 2 3\n1 two 3\n",
            r"a\.pcd:13: '1 two 3'; expected 3",
        ),
        (pcd("x y z", "4 4 2", "F F F", "1 1 1", 1, "ascii") + b"1 2 3\n", "'z' is of TYPE F SIZE 2"),
        (pcd("x y z", "4 4 4", "F F F", "1 1 99999999999", 1, "binary"), "COUNT 99999999999; expected"),
        (
            pcd("x y z", "4 4 4", "F F F", "1 1 1", 10**12, "binary") + b"1" * 30,
            "1000000000000 points.*ends after 2 of",
        ),
        (pcd("x y z", "4 4 4", "F F F", "1 1 1", 1, "packed"), "DATA 'packed', expected ascii"),
        (pcd("x y z", "4 4 4", "F F F", "1 1 1", 10**12, "binary_compressed") + b"1" * 30, "need 12000000000000"),
        (pcd("x y z", "4 4 4", "F F F", "1 1 1", 9, "binary_compressed") + b"1", "1 bytes of data announce"),
        (pcd("x y z", "4 4 4", "F F F", "1 1 1", -1, "binary"), "POINTS -1, expected a number"),
    ],
)
def test_damaged_pcd(tmp_path, data, text):
    refused(tmp_path / "a.pcd", data, text)


def test_damaged_compressed_pcd(tmp_path):
    data = bytearray(write_open3d(tmp_path / "whole.pcd", compressed=True).read_bytes())
    refused(tmp_path / "a.pcd", bytes(data[:-50]), "was copying or writing it cut off|need 4800")
    data[-400:] = b"\xff" * 400
    refused(tmp_path / "a.pcd", bytes(data), "compressed points are damaged")


@pytest.mark.parametrize("cut", [0, 3, 60, 150, 1000])
def test_ply_and_npz_that_were_cut_off(tmp_path, cut):
    whole = write_open3d(tmp_path / "whole.ply").read_bytes()
    refused(tmp_path / "a.ply", whole[:cut], r"a\.ply.*cut off")
    np.savez_compressed(tmp_path / "whole.npz", xyz=points())
    whole = (tmp_path / "whole.npz").read_bytes()
    refused(tmp_path / "a.npz", whole[:cut], r"a\.npz: cannot be read as NumPy's")


def test_kitti(tmp_path):
    rows = np.column_stack([points(), np.arange(300)]).astype("<f4")
    (tmp_path / "000000.bin").write_bytes(rows.tobytes())
    columns = read_scan_file(tmp_path / "000000.bin")
    np.testing.assert_array_equal(xyz(columns), points())
    np.testing.assert_array_equal(columns["intensity"], np.arange(300))
    refused(tmp_path / "a.bin", rows.tobytes()[:-3], "4797 bytes, expected KITTI's rows")
    refused(tmp_path / "a.pcd.bin", rows.tobytes(), "has it other columns")


def test_arrays(tmp_path):
    steps = np.array([[1, 2, 3], [-4, 5, 6]], np.int16)
    np.savez(
        tmp_path / "a.npz", xyz=steps, scale=0.5, offset=[10.0, 0, 0], intensity=[1, 2], t=np.array([0, 9], np.uint32)
    )
    columns = read_scan_file(tmp_path / "a.npz")
    np.testing.assert_array_equal(xyz(columns), [[10.5, 1, 1.5], [8, 2.5, 3]])
    assert columns["t"].dtype == np.uint32
    np.save(tmp_path / "b.npy", np.column_stack([points(), np.arange(300)]))
    np.testing.assert_array_equal(read_scan_file(tmp_path / "b.npy")["intensity"], np.arange(300))
    np.save(tmp_path / "c.npy", rows())
    assert set(read_scan_file(tmp_path / "c.npy")) == {"x", "y", "z", "t"}


@pytest.mark.parametrize(
    ("arrays", "text"),
    [
        ({"pts": np.ones((3, 3))}, r"no array 'xyz' of points. It holds pts \(float64 of shape \(3, 3\)\)"),
        ({"xyz": np.ones((3, 2))}, r"'xyz' is float64 of shape \(3, 2\)"),
        ({"xyz": np.ones((3, 3), int)}, "whole numbers.*no 'scale'"),
        ({"xyz": np.ones((3, 3)), "scale": np.float64(0)}, "'scale' is 0.0"),
        ({"xyz": np.ones((3, 3)), "offset": np.ones(2)}, "'offset' is float64 of shape"),
        ({"xyz": np.ones((3, 3)), "intensity": np.ones(2)}, r"'intensity' is float64 of shape \(2,\).*3 points"),
        ({"xyz": np.ones((3, 3)), "offsets": np.array([0, 3])}, "packed file of many scans"),
        ({"xyz": np.array([{}] * 3)}, "Python objects"),
    ],
)
def test_archives_that_do_not_fit(tmp_path, arrays, text):
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(UnreadableScanError, match=text):
        read_scan_file(tmp_path / "a.npz")


def test_other_arrays(tmp_path):
    np.save(tmp_path / "a.npy", np.array([{}]))
    refused(tmp_path / "a.npy", (tmp_path / "a.npy").read_bytes(), "cannot be read as an array")
    whole = (tmp_path / "a.npy").read_bytes()
    refused(tmp_path / "a.npy", whole.replace(b"}", b" "), "cannot be read as an array")  # a header without its end
    np.savez(tmp_path / "a.npz", xyz=points())
    method = bytearray((tmp_path / "a.npz").read_bytes())
    method[method.index(b"PK\x01\x02") + 10] = 77  # a compression that there is not
    refused(tmp_path / "a.npz", bytes(method), "That compression method is not supported")
    np.save(tmp_path / "a.npy", np.ones((5, 7)))
    refused(tmp_path / "a.npy", (tmp_path / "a.npy").read_bytes(), r"float64 of shape \(5, 7\)")
    refused(tmp_path / "b.npz", (tmp_path / "a.npy").read_bytes(), "is no zip archive")
    np.savez(tmp_path / "a.npz", xyz=points())
    refused(tmp_path / "b.npy", (tmp_path / "a.npz").read_bytes(), "archive of arrays")
    with pytest.raises(UnreadableScanError, match="no such file"):
        read_scan_file(tmp_path / "none.bin")
