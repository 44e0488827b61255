import resource
import struct
import sys
from pathlib import Path

import laspy
import numpy as np
import pyproj
import pytest
from cloud_strategy import TYPES, some_cloud, whole

from jaxgeo.errors import CloudError, InputError
from jaxgeo.io.clouds import CloudChunk, cloud_writer, open_cloud
from jaxgeo.io.input_warning import InputWarning

LUREF_ENH_M = np.array([79_342.123, 76_839.456, 340.789])
ORIGIN = np.array([79_300.0, 76_800.0, 300.0])


def write(path: Path, cloud: CloudChunk, origin: np.ndarray = ORIGIN, crs: str | None = "EPSG:2169", **more) -> Path:
    types = {name: values.dtype for name, values in cloud.columns.items()}
    with cloud_writer(path, types, origin, crs, **more) as writer:
        writer.append(cloud)
    return path


@pytest.mark.parametrize("suffix", [".las", ".laz"])
@pytest.mark.parametrize(
    ("crs", "code", "height", "enh_m"),
    [
        ("EPSG:2169", 2169, None, LUREF_ENH_M),
        ("EPSG:9897", 2169, "NG95 height", LUREF_ENH_M),
        ("EPSG:2169+5774", 2169, "NG95 height", LUREF_ENH_M),
        ("EPSG:32632", 32632, None, np.array([291_234.567, 5_500_123.456, 351.0])),
    ],
)
def test_laspy_and_proj_read_place_and_system(tmp_path: Path, suffix: str, crs: str, code: int, height, enh_m) -> None:
    origin = np.round(enh_m, -2)
    path = write(tmp_path / f"a{suffix}", CloudChunk((enh_m - origin)[None], {}), origin, crs)
    las = laspy.read(path)
    assert str(las.header.version) == "1.4"
    assert las.header.point_format.id == 6
    assert las.header.global_encoding.wkt
    assert las.header.are_points_compressed == (suffix == ".laz")
    np.testing.assert_array_equal(las.header.scales, 0.001)
    np.testing.assert_array_equal(las.header.offsets, origin)
    np.testing.assert_allclose([las.x[0], las.y[0], las.z[0]], enh_m, atol=1e-9)

    found = pyproj.CRS.from_wkt(las.header.vlrs.get("WktCoordinateSystemVlr")[0].string)
    horizontal, *vertical = found.sub_crs_list if found.is_compound else [found]
    assert horizontal.to_json_dict()["id"] == {"authority": "EPSG", "code": code}
    assert [part.name for part in vertical] == ([] if height is None else [height])
    # x is the easting, whether a reader goes by the text's axes or by convention; the register has LUREF's N first
    assert [axis.direction for axis in horizontal.axis_info] == ["east", "north"]
    register = pyproj.CRS.from_epsg(code)
    in_order = enh_m[:2] if register.axis_info[0].direction == "east" else enh_m[1::-1]
    expected = pyproj.Transformer.from_crs(register, 4326).transform(*in_order)
    for text_order in ({}, {"always_xy": True}):
        answer = pyproj.Transformer.from_crs(horizontal, 4326, **text_order).transform(las.x[0], las.y[0])
        np.testing.assert_allclose(answer[::-1] if text_order else answer, expected, atol=1e-9, rtol=0)
    np.testing.assert_allclose(expected, (49.62, 6.16) if code == 2169 else expected, atol=0.01)


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_what_is_written_reads_back(tmp_path: Path, suffix: str) -> None:
    cloud = some_cloud(1000)
    source = open_cloud(write(tmp_path / f"a{suffix}", cloud))
    found = whole(source, 300)
    assert source.n_points == 1000
    # Half a step of a millimetre on each axis
    np.testing.assert_allclose(found.points_m, cloud.points_m + ORIGIN, atol=0.0005 + 1e-9, rtol=0)
    for name, values in cloud.columns.items():
        np.testing.assert_array_equal(found.columns[name], values)
    assert found.colour is not None
    assert found.normal is not None
    assert found.colour.tolist() == cloud.colour.tolist()


def test_an_origin_between_metres_is_no_offset(tmp_path: Path) -> None:
    path = write(tmp_path / "a.las", CloudChunk(np.array([[0.1, 0.2, 0.3]]), {}), ORIGIN + np.array([0.4, 0.6, 0.25]))
    las = laspy.read(path)
    assert las.header.offsets.tolist() == [79_300.0, 76_801.0, 300.0]
    np.testing.assert_allclose([las.x[0], las.y[0], las.z[0]], ORIGIN + np.array([0.5, 0.8, 0.55]), atol=1e-9)


def test_an_intensity_that_is_no_integer_is_kept(tmp_path: Path) -> None:
    columns = {"intensity": np.array([0.25, 70_000.5, 3.0], np.float32)}
    path = write(tmp_path / "a.laz", CloudChunk(np.zeros((3, 3)), columns))
    assert laspy.read(path).intensity.tolist() == [0, 65535, 3]
    np.testing.assert_array_equal(whole(open_cloud(path)).columns["intensity"], columns["intensity"])


def test_an_older_file(tmp_path: Path) -> None:
    header = laspy.LasHeader(version="1.2", point_format=3)
    header.add_crs(pyproj.CRS.from_epsg(32632))
    las = laspy.LasData(header)
    las.x, las.y, las.z = np.arange(3.0), np.zeros(3), np.ones(3)
    las.gps_time, las.scan_angle_rank, las.classification = np.arange(3.0), [-15, 0, 90], [2, 5, 31]
    las.red = las.green = las.blue = np.array([1, 2, 65535])
    las.write(tmp_path / "old.las")
    source = open_cloud(tmp_path / "old.las")
    found = whole(source)
    assert source.crs == "EPSG:32632"
    assert found.columns["scan_angle"].tolist() == [-2500, 0, 15000]
    assert found.stamp_s is not None
    assert found.stamp_s.tolist() == [0.0, 1.0, 2.0]
    again = laspy.read(write(tmp_path / "new.laz", found))
    assert again.header.point_format.id == 7
    assert again.scan_angle.tolist() == [-2500, 0, 15000]
    assert again.classification.tolist() == [2, 5, 31]


def test_comments_and_the_epoch_of_stamps_stay(tmp_path: Path) -> None:
    path = write(tmp_path / "a.laz", some_cloud(), standard_gps_time=True, comments=["SIMULATED DATA", "second line"])
    header = laspy.read(path).header
    texts = [vlr.record_data for vlr in header.vlrs if (vlr.user_id, vlr.record_id) == ("LASF_Spec", 3)]
    assert texts == [b"SIMULATED DATA\nsecond line\0"]
    assert open_cloud(path).standard_gps_time


def test_what_las_cannot_hold(tmp_path: Path) -> None:
    columns = {"a" * 33: np.zeros(1), "waveform": np.zeros(1, "c16"), "ok": np.ones(1, "i8")}
    with pytest.warns(InputWarning, match=r"columns a{33}, waveform are left out: LAS holds numbers"):
        path = write(tmp_path / "a.las", CloudChunk(np.zeros((1, 3)), columns))
    assert whole(open_cloud(path)).columns["ok"].tolist() == [1]
    with pytest.raises(CloudError, match=r"column 'classification' holds 256; its LAS dimension holds 0 to 255"):
        write(path, CloudChunk(np.zeros((1, 3)), {"classification": np.array([256])}))
    with pytest.raises(CloudError, match=r"point \[0\.0, 2200000\.0, 0\.0\] m from the origin; LAS holds 2147 km"):
        write(path, CloudChunk(np.array([[0.0, 2.2e6, 0.0]]), {}))
    with pytest.raises(CloudError, match=r"point \[nan"):
        write(path, CloudChunk(np.full((1, 3), np.nan), {}))
    with pytest.raises(CloudError, match=r"crs 'EPSG:999999' cannot be written as WKT"):
        write(path, CloudChunk(np.zeros((1, 3)), {}), crs="EPSG:999999")
    assert whole(open_cloud(path)).columns["ok"].tolist() == [1]  # the first, whole, stands
    assert [p.name for p in tmp_path.iterdir()] == ["a.las"]


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_a_cut_file_is_refused(tmp_path: Path, suffix: str) -> None:
    data = write(tmp_path / f"a{suffix}", some_cloud(500)).read_bytes()
    path = tmp_path / f"cut{suffix}"
    for kept in (0, 3, 100, 300, len(data) // 2, len(data) - 60):
        path.write_bytes(data[:kept])
        with pytest.raises(CloudError, match=r"cut\.la[sz]: .*cut off"):
            whole(open_cloud(path), 200)


@pytest.mark.filterwarnings("ignore::jaxgeo.io.input_warning.InputWarning")
@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_a_damaged_file_is_read_or_refused(tmp_path: Path, suffix: str) -> None:
    """Whatever byte is wrong: numbers, or a CloudError; never another exception."""
    data = bytearray(write(tmp_path / f"a{suffix}", some_cloud(20)).read_bytes())
    path, random = tmp_path / f"b{suffix}", np.random.default_rng(0)
    refused = 0
    for _ in range(100):
        at = int(random.integers(len(data)))
        kept, data[at] = data[at], int(random.integers(256))
        path.write_bytes(data)
        data[at] = kept
        try:
            source = open_cloud(path)
            for chunk in source.chunks(1000) if source.n_points < 10_000 else ():
                assert chunk.points_m.shape == (len(chunk), 3)
        except CloudError:
            refused += 1
    assert refused > 0


def test_what_laz_says_of_its_chunks_is_not_believed(tmp_path: Path) -> None:
    """The decompressor would ask for that much memory, and end the process."""
    data = write(tmp_path / "a.laz", some_cloud(20)).read_bytes()
    with laspy.open(tmp_path / "a.laz") as reader:
        start, record = reader.header.offset_to_point_data, reader.header.vlrs.get("LasZipVlr")[0].record_data
    (table,) = struct.unpack_from("<q", data, start)
    spoils = {
        r"would lie at byte 9\d+ of": (start, struct.pack("<q", 9 * 10**15)),
        "its table has 4000000000 chunks for 20 points": (table + 4, struct.pack("<I", 4_000_000_000)),
        "its chunks would hold 4000000000 points": (data.index(record) + 12, struct.pack("<I", 4_000_000_000)),
        "its compressed points have .* bytes, its format": (data.index(record) + 36, struct.pack("<H", 60_000)),
        "not readable as LA[SZ]": (table + 9, b"\xff\xff"),
    }
    for message, (at, wrong) in spoils.items():
        (tmp_path / "b.laz").write_bytes(data[:at] + wrong + data[at + len(wrong) :])
        with pytest.raises(CloudError, match=message):
            open_cloud(tmp_path / "b.laz")


def test_what_is_no_las(tmp_path: Path) -> None:
    path = tmp_path / "a.las"
    with pytest.raises(CloudError, match="no such file"):
        open_cloud(path)
    path.write_text("x y z\n1 2 3\n" * 100)
    with pytest.raises(CloudError, match="not readable as LAS at its head"):
        open_cloud(path)
    write(path, CloudChunk(np.zeros((0, 3)), {}))
    with pytest.raises(CloudError, match="holds no points"):
        open_cloud(path)
    with pytest.raises(CloudError, match=r"suffix '\.xyz'; expected a point cloud: \.las, \.laz, \.ply"):
        open_cloud(tmp_path / "a.xyz")


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_a_full_disk_and_an_interrupt_leave_nothing(tmp_path: Path, suffix: str) -> None:
    cloud = some_cloud(50_000)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (500_000, hard))  # Python ignores the signal: writing fails
    try:
        with pytest.raises(CloudError, match=rf"a\{suffix}: cannot be written: .*room on the disk"):
            write(tmp_path / f"a{suffix}", cloud)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    writer = cloud_writer(tmp_path / f"a{suffix}", TYPES, ORIGIN, None)
    with pytest.raises(KeyboardInterrupt), writer:  # noqa: PT012 (a block is what is interrupted)
        writer.append(cloud)
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_without_laspy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "laspy", None)
    with pytest.raises(InputError, match=r"pip install 'jaxgeo\[cloud\]'"):
        cloud_writer(tmp_path / "a.laz", TYPES, ORIGIN, None)
