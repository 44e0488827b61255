"""Folders and packed files of scans: stamps, order, what does not fit; and that what is written reads back."""

import itertools
import pickle

import numpy as np
import pytest
from data_root import data_root
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from jaxgeo.data import Scan
from jaxgeo.errors import InputError, ScanError
from jaxgeo.io.input_warning import InputWarning
from jaxgeo.io.scans import FolderScans, PackedScans, open_scans, write_packed_scans, write_scan

NS = (1_403_636_579_763_555_584, 1_403_636_579_863_555_456, 1_403_636_579_963_555_584)


def scan(i: int, stamp_s: float = 0.0, times: bool = False, intensity: bool = True) -> Scan:
    rng = np.random.default_rng(i)
    points_m = rng.uniform(1, 50, size=(20, 3))
    points_m[0] = i + 1
    return Scan(
        stamp_s,
        points_m,
        np.linspace(0, 0.09, 20) if times else None,
        rng.uniform(0, 255, 20) if intensity else None,
        "made",
        i,
    )


def save(folder, *names: str) -> None:
    """Scan i under name i."""
    for i, name in enumerate(names):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        write_scan(folder / name, scan(i))


def shown(source) -> list[tuple[float, int]]:
    """(stamp, which scan) of all scans."""
    return [(scan.stamp_s, round(scan.points_m[0, 0]) - 1) for scan in source]


def text(path, content: str):
    path.write_text(content)
    return path


def test_a_rate_and_the_natural_order_of_names(tmp_path):
    save(tmp_path, "frame10.ply", "frame2.ply", "frame1.ply")
    (tmp_path / "._frame1.ply").write_bytes(b"what some systems leave")
    source = open_scans(tmp_path, rate_hz=10, start_s=5.0)
    assert isinstance(source, FolderScans)
    assert source.n_scans == 3
    assert shown(source) == shown(source) == [(5.0, 2), (5.1, 1), (5.2, 0)]
    assert shown(pickle.loads(pickle.dumps(source)).scans(2)) == [(5.2, 0)]


@pytest.mark.parametrize("names", [[f"{ns}.bin" for ns in NS], [f"cloud_{ns // 10**9}.{ns % 10**9}.bin" for ns in NS]])
def test_stamps_in_names(tmp_path, names):
    save(tmp_path, *names)
    assert shown(open_scans(tmp_path)) == [(ns / 10**9, i) for i, ns in enumerate(NS)]


def test_stamps_in_a_list_and_in_a_table(tmp_path):
    save(tmp_path / "velodyne", *(f"{i:06d}.bin" for i in range(3)))
    times = text(tmp_path / "times.txt", "0.000000e+00\n1.037359e-01\n2.073381e-01\n")
    assert shown(open_scans(tmp_path / "velodyne", stamps=times)) == [(0.0, 0), (0.1037359, 1), (0.2073381, 2)]
    times = text(tmp_path / "ns.txt", "".join(f"{ns}\n" for ns in NS))
    assert [stamp for stamp, _ in shown(open_scans(tmp_path / "velodyne", stamps=times))] == [ns / 10**9 for ns in NS]
    table = text(tmp_path / "table.csv", "stamp_s,file\n3.5,000001.bin\n2.5,velodyne/000002.bin\n")
    with pytest.warns(InputWarning, match=r"1 of 3 scans, which are not in .*table\.csv.*first is 000000\.bin"):
        assert shown(open_scans(tmp_path / "velodyne", stamps=table)) == [(2.5, 2), (3.5, 1)]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("0.0\n0.1\n", r"has 3 scans, but .*t\.txt has 2 stamps"),
        ("0.0\n0.2\n0.1\n", r"t\.txt:3: stamp 0\.1 s after 0\.2 s \(.*t\.txt:2\), expected stamps that increase"),
        ("0.0\n0.1\n0.1\n", r"t\.txt:3: stamp 0\.1 s after 0\.1 s"),
        ("0.0\n0.1\nnan\n", r"t\.txt:3: stamp 'nan', expected a number"),
        ("1 a.ply\n2 b.ply\n3 d.ply\n", r"t\.txt:3: names 'd\.ply', which is not in"),
        ("1 a.ply\n2 b.ply\n2 c.ply\n", r"t\.txt:3: c\.ply has the stamp 2\.0 s of b\.ply"),
        ("1 a.ply\n2 b.ply\n3 b.ply\n", r"t\.txt:3: .*b\.ply is named a second time"),
        ("", "the file is empty"),
        ("5e13\n6e13\n7e13\n", "neither of the size of seconds nor of nanoseconds"),
    ],
)
def test_stamps_that_do_not_fit(tmp_path, content, message):
    save(tmp_path / "scans", "a.ply", "b.ply", "c.ply")
    with pytest.raises(ScanError, match=message):
        open_scans(tmp_path / "scans", stamps=text(tmp_path / "t.txt", content))


def test_no_stamps_or_too_many(tmp_path):
    save(tmp_path, "000000.ply", "000001.ply")
    for options, message in (
        ({}, "holds no stamp.*`rate_hz` for scans a second"),
        ({"rate_hz": 0}, "rate_hz is 0"),
        ({"rate_hz": 1, "stamps": "t.txt"}, "both `stamps` and `rate_hz`"),
        ({"start_s": 1.0}, "`start_s` is the stamp of the first"),
        ({"topic": "/a"}, "'topic' says nothing about a source of kind 'folder'"),
        ({"rate_hz": 1, "on_bad": "ignore"}, "on_bad is 'ignore'"),
        ({"kind": "zip"}, "kind 'zip', expected one of folder, packed, bag"),
    ):
        with pytest.raises(ScanError, match=message):
            open_scans(tmp_path, **options)
    with pytest.raises(ScanError, match="start at scan -1"):
        list(open_scans(tmp_path, rate_hz=1).scans(-1))


def test_paths_that_hold_no_scans(tmp_path):
    save(tmp_path / "below", "1.ply", "2.bin")
    text(tmp_path / "a.txt", "hello")
    for path, message in (
        (tmp_path, r"holds no scans \(\.ply.*such as 'below'"),
        (tmp_path / "below", r"several kinds \(1 \.\w+, 1 \.\w+\)"),
        (tmp_path / "none", "no such file or folder"),
        (tmp_path / "below" / "1.ply", "is a single scan.*Name its folder"),
        (tmp_path / "a.txt", r"suffix '\.txt', expected a folder of scans"),
    ):
        with pytest.raises(ScanError, match=message):
            open_scans(path, rate_hz=1)


def test_unreadable_scans_are_named_or_counted(tmp_path):
    save(tmp_path, *(f"{i}.ply" for i in range(5)))
    for i in (1, 3):
        (tmp_path / f"{i}.ply").write_bytes((tmp_path / f"{i}.ply").read_bytes()[:-10])
    with pytest.raises(ScanError, match=r"1\.ply: the header announces 20 vertices"):
        list(open_scans(tmp_path, rate_hz=1))
    source = open_scans(tmp_path, rate_hz=1, on_bad="skip")
    with pytest.warns(InputWarning) as caught:
        assert [scan.index for scan in source] == [0, 2, 4]
    assert sorted(source.bad) == [1, 3]
    assert "The scan is left out" in str(caught[0].message)
    assert "2 scans could not be read" in str(caught[1].message)
    assert source.n_scans == 5


@pytest.mark.parametrize(("suffix", "step_m"), [(".ply", 0.0), (".npz", 0.001), (".bin", 0.0)])
@pytest.mark.parametrize("times", [False, True])
@pytest.mark.parametrize("intensity", [False, True])
def test_what_is_written_reads_back(tmp_path, suffix, step_m, times, intensity):
    written = scan(3, times=times, intensity=intensity)
    path = tmp_path / f"1.5{suffix}"
    if suffix == ".bin" and times:
        with pytest.raises(ScanError, match="no place for the times"):
            write_scan(path, written)
        assert not list(tmp_path.iterdir())
        return
    write_scan(path, written)
    (read,) = open_scans(tmp_path)
    np.testing.assert_allclose(read.points_m, written.points_m, rtol=6e-8, atol=0.5 * step_m)
    assert (read.time_s is None) == (not times)
    if times:
        np.testing.assert_allclose(read.time_s, written.time_s, rtol=6e-8)
    if intensity:
        np.testing.assert_allclose(read.intensity, written.intensity, rtol=6e-8)
    else:
        assert read.intensity is None or not read.intensity.any()


@given(
    sizes=st.lists(st.integers(1, 6), min_size=1, max_size=4),
    extent_m=st.sampled_from([0.5, 100.0, 9e4]),
    data=st.data(),
)
def test_packed_scans_read_back(tmp_path_factory, sizes, extent_m, data):
    numbers = npst.arrays(np.float64, (sum(sizes), 3), elements=st.floats(0.01, extent_m))
    points_m = data.draw(numbers)
    stamp_s = 1.5e9 + np.cumsum(data.draw(npst.arrays(np.float64, len(sizes), elements=st.floats(0.01, 100))))
    bounds = np.cumsum([0, *sizes])
    written = [
        Scan(float(s), points_m[a:b], None, None, "", i)
        for i, (s, (a, b)) in enumerate(zip(stamp_s, itertools.pairwise(bounds), strict=True))
    ]
    path = tmp_path_factory.mktemp("packed") / "a.npz"
    write_packed_scans(path, iter(written))
    read = list(open_scans(path))
    assert [scan.stamp_s for scan in read] == stamp_s.tolist()
    for one, other in zip(read, written, strict=True):
        np.testing.assert_allclose(one.points_m, other.points_m, atol=0.5001e-3, rtol=0)


def test_packed_times_and_intensities(tmp_path):
    written = [scan(i, 1e9 + i / 10, times=True) for i in range(3)]
    write_packed_scans(tmp_path / "a.npz", written)
    source = pickle.loads(pickle.dumps(open_scans(tmp_path / "a.npz")))
    assert isinstance(source, PackedScans)
    assert source.n_scans == 3
    for one, other in zip(source, written, strict=True):
        np.testing.assert_allclose(one.time_s, other.time_s, rtol=1e-7)
        np.testing.assert_allclose(one.intensity, other.intensity, rtol=1e-7)
        assert one.stamp_s == other.stamp_s
    assert shown(source.scans(2)) == [(1e9 + 0.2, 2)]
    assert [stamp for stamp, _ in shown(open_scans(tmp_path / "a.npz", rate_hz=2))] == [0, 0.5, 1]
    times = text(tmp_path / "t.txt", "1\n2\n4\n")
    assert [stamp for stamp, _ in shown(open_scans(tmp_path / "a.npz", stamps=times))] == [1, 2, 4]


def test_what_cannot_be_packed(tmp_path):
    path = tmp_path / "a.npz"
    for scans, message in (
        ([], "no scans to write"),
        ([scan(0, 1.0), scan(1, 1.0)], r"a\.npz:1: stamp 1\.0 s after 1\.0 s"),
        ([scan(0, 1.0), scan(1, 2.0, times=True)], r"a\.npz:1: the scan has xyz, intensity, point_times, expected"),
        ([Scan(0.0, np.full((2, 3), np.nan), None, None, "made", 0)], "made has a coordinate that is not finite"),
    ):
        with pytest.raises(ScanError, match=message):
            write_packed_scans(path, scans)
    with pytest.raises(ScanError, match=r"suffix '\.ply', expected \.npz"):
        write_packed_scans(tmp_path / "a.ply", [scan(0)])
    with pytest.raises(ScanError, match=r"suffix '\.las', expected one of \.ply"):
        write_scan(tmp_path / "a.las", scan(0))
    with pytest.raises(InputError, match="cannot write into"):
        write_scan(tmp_path / "none" / "a.npz", scan(0))
    assert not list(tmp_path.iterdir())


def packed(**changed) -> dict[str, np.ndarray]:
    known = {"xyz": np.ones((6, 3)), "offsets": np.array([0, 2, 6]), "times": np.array([1.0, 2.0])}
    return {key: value for key, value in (known | changed).items() if value is not None}


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"xyz": None}, "no array 'xyz' of points. It holds offsets"),
        ({"offsets": None}, "no array 'offsets'.*It holds xyz, times"),
        ({"offsets": np.array([0, 2, 7])}, "run from 0 to 7, expected from 0 to the 6 rows"),
        ({"offsets": np.array([0, 9, 6])}, "falling after scan 1"),
        ({"offsets": np.array([0.0, 2, 6])}, "'offsets' is float64"),
        ({"times": None}, "no array 'times'.*Give `stamps`"),
        ({"times": np.array([1.0])}, r"'times' is float64 of shape \(1,\), expected 2"),
        ({"times": np.array([2.0, 1.0])}, r"a\.npz:1: stamp 1\.0 s after 2\.0 s \(.*a\.npz:0\)"),
        ({"times": np.array([1e18, 2e18])}, "Nanoseconds"),
        ({"times": np.array([1.0, np.nan])}, "finite seconds"),
        ({"point_times": np.ones(5)}, r"'point_times' is float64 of shape \(5,\)"),
        ({"intensity": np.array([{}] * 6)}, "Python objects"),
    ],
)
def test_packed_files_that_do_not_fit(tmp_path, changed, message):
    np.savez(tmp_path / "a.npz", **packed(**changed))
    with pytest.raises(ScanError, match=message):
        open_scans(tmp_path / "a.npz")


def test_an_empty_scan_among_packed_ones(tmp_path):
    np.savez(tmp_path / "a.npz", **packed(offsets=np.array([0, 0, 6])))
    source = open_scans(tmp_path / "a.npz", on_bad="skip")
    with pytest.warns(InputWarning, match=r"a\.npz:0: the scan is empty"):
        assert [scan.index for scan in source] == [1]


def test_real_packed_scans():
    lidar = data_root() / "lidar"
    source = open_scans(lidar / "hku1.npz")
    with np.load(lidar / "hku1.npz") as raw:
        xyz, offsets, scale, times = raw["xyz"], raw["offsets"], raw["scale"], raw["times"]
    for index in (0, 313):
        (scan,) = itertools.islice(source.scans(index), 1)
        rows = xyz[offsets[index] : offsets[index + 1]]
        np.testing.assert_array_equal(scan.points_m, rows[rows.any(axis=1)] * scale)
        assert scan.stamp_s == times[index]
    listed = open_scans(lidar / "hku1.npz", stamps=lidar / "hku1_times.txt")
    assert [s.stamp_s for s in listed] == [s.stamp_s for s in source]


def test_real_scans_of_a_folder():
    source = open_scans(data_root() / "lidar" / "small_gicp", rate_hz=10)
    assert [scan.stamp_s for scan in source] == [0.0, 0.1]
