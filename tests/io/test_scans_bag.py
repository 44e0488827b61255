"""Scans out of ROS 1 bags, ROS 2 bags and MCAP files, written here by rosbags' own writers."""

import pickle
from types import SimpleNamespace

import numpy as np
import pytest
from bags import KINDS, RawImage, write_bag
from cloud_bags import Cloud, write_cloud_bag
from data_root import data_root

from jaxgeo.errors import ScanError
from jaxgeo.io.input_warning import InputWarning
from jaxgeo.io.scans import BagScans, open_scans
from jaxgeo.io.scans.point_cloud2 import columns_of_message
from jaxgeo.io.scans.scan_source import UnreadableScanError

T0_NS = 1_403_636_579_763_555_584
OUSTER = np.dtype(
    {
        "names": ["x", "y", "z", "intensity", "t", "reflectivity", "ring"],
        "formats": ["<f4", "<f4", "<f4", "<f4", "<u4", "<u2", "u1"],
        "offsets": [0, 4, 8, 16, 20, 24, 26],
        "itemsize": 48,
    }
)


def points(seed: int, shape=(40,), dtype=OUSTER) -> np.ndarray:
    rng = np.random.default_rng(seed)
    out = np.zeros(shape, dtype)
    for name in "xyz":
        out[name] = rng.normal(size=shape) * 20
    if "intensity" in dtype.names:
        out["intensity"] = rng.integers(0, 255, shape)
    if "t" in dtype.names:
        out["t"] = np.linspace(0, 99_900_000, out.size).reshape(shape)
    return out


def sweep(n: int = 4) -> list[Cloud]:
    return [Cloud("/os/points", T0_NS + i * 100_000_000, points(i)) for i in range(n)]


@pytest.mark.parametrize("kind", KINDS)
def test_scans_come_back(tmp_path, kind):
    source = open_scans(write_cloud_bag(tmp_path, kind, sweep()))
    scans = list(source)
    assert isinstance(source, BagScans)
    assert source.n_scans == len(scans) == 4
    for i, scan in enumerate(scans):
        written = points(i)
        np.testing.assert_array_equal(scan.points_m, np.stack([written[name] for name in "xyz"], axis=1))
        np.testing.assert_array_equal(scan.intensity, written["intensity"])
        np.testing.assert_array_equal(scan.time_s, written["t"] / 1e9)
        assert scan.points_m.dtype == scan.time_s.dtype == scan.intensity.dtype == np.float64
        assert (scan.index, scan.stamp_s) == (i, (T0_NS + i * 100_000_000) / 10**9)
        assert f":{i} (/os/points)" in scan.source


@pytest.mark.parametrize("kind", KINDS)
def test_reads_again_and_resumes_at_every_scan(tmp_path, kind):
    source = pickle.loads(pickle.dumps(open_scans(write_cloud_bag(tmp_path, kind, sweep()))))
    for start in (0, 1, 3, 4, 5):
        assert [scan.index for scan in source.scans(start)] == list(range(start, 4))


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("kind", ["i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8"])
def test_types_byte_orders_and_padding(tmp_path, kind, order):
    """Organised clouds with rows and points padded, fields at odd offsets, intensity of any type."""
    dtype = np.dtype(
        {
            "names": ["z", "intensity", "x", "y"],
            "formats": [order + "f8", order + kind, order + "f4", order + "f8"],
            "offsets": [1, 9, 17, 21],
            "itemsize": 31,
        }
    )
    written = points(3, (3, 5), dtype)
    written["intensity"] = np.arange(15).reshape(3, 5) * 8
    (scan,) = open_scans(write_cloud_bag(tmp_path, "ros1", [Cloud("/a", T0_NS, written, pad=7)]))
    np.testing.assert_array_equal(scan.points_m, np.stack([written[name].ravel() for name in "xyz"], axis=1))
    np.testing.assert_array_equal(scan.intensity, np.arange(15) * 8)
    assert scan.time_s is None


def test_only_the_chosen_topic(tmp_path):
    clouds = [item for i, cloud in enumerate(sweep()) for item in (cloud, Cloud("/map", cloud.stamp_ns + i, points(9)))]
    path = write_cloud_bag(tmp_path, "mcap", clouds)
    with pytest.raises(ScanError, match=r"several scan topics. Choose with `topic`.*\n  /map .*\n  /os/points"):
        open_scans(path)
    np.testing.assert_array_equal([len(scan) for scan in open_scans(path, topic="/os/points")], [40] * 4)
    with pytest.raises(ScanError, match="no topic '/lidar'"):
        open_scans(path, topic="/lidar")


def test_bags_without_scans(tmp_path):
    with pytest.raises(ScanError, match=r"no topic of scans.*\n  /tf"):
        open_scans(data_root() / "bags" / "tf_example.bag")
    image = RawImage("/a", T0_NS, np.zeros((4, 4, 3), np.uint8))
    with pytest.raises(ScanError, match=r"'/a' is of type sensor_msgs/msg/Image, expected sensor_msgs/msg/PointCloud2"):
        open_scans(write_bag(tmp_path, "ros1", [image]), topic="/a")


@pytest.mark.parametrize("step_ns", [0, -50_000_000])
def test_stamps_that_do_not_increase(tmp_path, step_ns):
    clouds = sweep()
    clouds[2].stamp_ns = clouds[1].stamp_ns + step_ns
    clouds[2].received_ns = clouds[1].stamp_ns + 50_000_000
    path = write_cloud_bag(tmp_path, "ros1", clouds)
    with pytest.raises(
        ScanError, match=r":2 \(/os/points\): stamp 1403636579\.8\d+ s after 1403636579\.86\d+ s of scan 1"
    ):
        list(open_scans(path))
    source = open_scans(path, on_bad="skip")
    with pytest.warns(InputWarning, match="The scan is left out"):
        assert [scan.index for scan in source] == [0, 1, 3]
    assert list(source.bad) == [2]


def test_empty_scans_are_unreadable(tmp_path):
    clouds = sweep()
    clouds[0].points = points(0, (0,))
    clouds[1].points = np.zeros(5, OUSTER)
    clouds[2].points["x"] = np.nan
    path = write_cloud_bag(tmp_path, "mcap", clouds)
    with pytest.raises(ScanError, match=r":0 .*the scan is empty: it has no points"):
        list(open_scans(path))
    source = open_scans(path, on_bad="skip")
    with pytest.warns(InputWarning) as caught:
        assert [scan.index for scan in source] == [3]
    assert "3 scans could not be read" in str(caught[-1].message)
    assert "none of its 40 points is a return" in source.bad[2]


def test_without_header_stamps_the_time_of_recording_counts(tmp_path):
    path = write_cloud_bag(
        tmp_path, "ros1", [Cloud("/a", 0, points(i), received_ns=T0_NS + i * 10**8) for i in range(2)]
    )
    with pytest.warns(InputWarning, match=r"no stamp.*Have the LiDAR's driver"):
        assert [scan.stamp_s for scan in open_scans(path)] == [T0_NS / 1e9, (T0_NS + 10**8) / 10**9]


def message(**changed):
    written = points(1)
    fields = [SimpleNamespace(name=n, offset=o, datatype=7, count=1) for n, o in (("x", 0), ("y", 4), ("z", 8))]
    known = {"height": 1, "width": 40, "point_step": 48, "row_step": 1920, "is_bigendian": False}
    return SimpleNamespace(**{**known, "fields": fields, "data": np.frombuffer(written.tobytes(), np.uint8), **changed})


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"width": 41}, "1920 bytes in rows of 1968, expected 1 rows of at least 1968"),
        ({"height": 2, "row_step": 0}, "1920 bytes in rows of 0, expected 2 rows"),
        ({"height": 2**31, "row_step": 1920}, "expected 2147483648 rows"),
        ({"point_step": 10, "row_step": 400}, "field 'z' lies at bytes 8 to 12 of a point of 10"),
    ],
)
def test_messages_that_contradict_themselves(changed, text):
    with pytest.raises(UnreadableScanError, match=text):
        columns_of_message(message(**changed), "bag:0")


def test_a_single_row_needs_no_row_step():
    columns = columns_of_message(message(row_step=0), "bag:0")
    np.testing.assert_array_equal(columns["z"], points(1)["z"])
