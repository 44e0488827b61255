"""From columns to a scan: which points count, and when each was measured."""

import numpy as np
import pytest

from jaxgeo.io.scans.columns import scan_of_columns
from jaxgeo.io.scans.point_times import point_time_s
from jaxgeo.io.scans.scan_source import UnreadableScanError

EPOCH_S = 1_577_836_980.0991046
EPOCH_NS = 1_577_836_980_099_104_600
SWEEP_S = np.linspace(0.0, 0.0999, 50)


def columns(n: int = 4, **more) -> dict[str, np.ndarray]:
    return {name: np.arange(1.0, n + 1) for name in "xyz"} | more


def test_what_is_no_return_is_left_out():
    given = columns(6, intensity=np.arange(6, dtype=np.uint8), t=np.arange(6, dtype=np.uint32) * 10**7)
    given["x"][1], given["z"][2] = np.nan, np.inf
    for name in "xyz":
        given[name][4] = 0.0
    given["y"][5] = 0.0  # one zero is a coordinate like any other
    scan = scan_of_columns(given, 5.0, "here", 7)
    assert len(scan) == 3
    np.testing.assert_array_equal(scan.intensity, [0, 3, 5])
    np.testing.assert_allclose(scan.time_s, [0, 0.03, 0.05])
    assert (scan.stamp_s, scan.source, scan.index) == (5.0, "here", 7)


def test_times_of_points_left_out_do_not_count():
    """Livox and Ouster leave rubbish in the times of points without return."""
    given = columns(3, time=np.array([0.0, np.nan, 0.05], np.float32))
    given["x"][1] = np.nan
    np.testing.assert_allclose(scan_of_columns(given, 5.0, "here", 0).time_s, [0, 0.05], rtol=1e-6)


@pytest.mark.parametrize(
    "names", [("X", "Y", "Z", "Intensity"), ("x", "y", "z", "scalar_intensity"), ("x", "y", "z", "i")]
)
def test_names_of_fields(names):
    scan = scan_of_columns({name: np.full(2, 3.0 + i) for i, name in enumerate(names)}, 0.0, "here", 0)
    np.testing.assert_array_equal(scan.points_m, [[3, 4, 5]] * 2)
    np.testing.assert_array_equal(scan.intensity, [6, 6])


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"x": np.ones(3), "y": np.ones(3)}, "here: no field 'z'.*fields are x, y"),
        (columns(3, x=np.array([1.0, 2.0, 1.1e5])), r"size 110000, expected metres.*millimetres"),
        (columns(0), "it has no points"),
        ({name: np.zeros(4) for name in "xyz"}, "none of its 4 points"),
    ],
)
def test_scans_that_are_none(given, text):
    with pytest.raises(UnreadableScanError, match=text):
        scan_of_columns(given, 0.0, "here", 0)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("t", (SWEEP_S * 1e9).astype(np.uint32)),  # Ouster
        ("offset_time", (SWEEP_S * 1e9).astype(np.uint64)),  # Livox
        ("time", SWEEP_S.astype(np.float32)),  # Velodyne
        ("time", SWEEP_S),
        ("timestamp", EPOCH_S + SWEEP_S),  # Hesai, RoboSense
        ("time_stamp", EPOCH_NS + (SWEEP_S * 1e9).astype(np.uint64)),
        ("Timestamp", (EPOCH_NS + SWEEP_S * 1e9).astype(np.float64)),  # Livox, driver 2
        ("t", (SWEEP_S * 1e9).astype(">u4")),
        ("timestamp", (EPOCH_S + SWEEP_S).astype(">f8")),
    ],
)
def test_drivers(name, values):
    tolerance_s = 5e-7  # float64 seconds of today are 0.24 µs apart
    np.testing.assert_allclose(point_time_s({"x": values, name: values}, EPOCH_S, "here"), SWEEP_S, atol=tolerance_s)


def test_times_before_the_stamp():
    """Velodyne's driver may stamp the end of the sweep."""
    values = (SWEEP_S - SWEEP_S[-1]).astype(np.float32)
    np.testing.assert_array_equal(point_time_s({"time": values}, EPOCH_S, "here"), values.astype(np.float64))


@pytest.mark.parametrize("stamp_s", [0.0, 0.05, 0.5, 1.9, 2.5, 60.0])
@pytest.mark.parametrize("first_s", [0.0, 0.003])
def test_clocks_that_begin_at_zero(stamp_s, first_s):
    """Offsets and readings of the clock are told apart where both are small numbers."""
    after_s = SWEEP_S + first_s
    for values in (after_s, stamp_s + after_s, np.rint(after_s * 1e9).astype(np.int64)):
        np.testing.assert_allclose(point_time_s({"t": values}, stamp_s, "here"), after_s, atol=1e-9)


def test_without_times():
    assert point_time_s({"x": SWEEP_S, "ring": SWEEP_S}, EPOCH_S, "here") is None
    for constant in (np.zeros(9, np.float32), np.full(9, EPOCH_S)):  # not filled in; all of one moment
        assert point_time_s({"time": constant}, EPOCH_S, "here") is None


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ((SWEEP_S * 1e6).astype(np.uint32), r"'t' \(uint32\) run from 0 to 99900.*nanoseconds.*a sweep of 9.99e-05 s"),
        ((SWEEP_S * 1e6).astype(np.float32), r"taken as seconds after the stamp, a sweep of 9.99e\+04 s"),
        (EPOCH_S - 37.0 + SWEEP_S, r"seconds of the stamp's clock, they lie -37 to -36\.9001 s.*different clocks"),
        (5000.0 + SWEEP_S, r"seconds after the stamp, they lie 5000 to"),
        (np.array([0.0, np.nan]), "hold|run from nan"),
        (np.array([0, 2**64 - 1], np.uint64), "expected seconds or nanoseconds"),
        (np.array([0.0, 1e300]), "expected seconds or nanoseconds"),
        (np.array([-1e300, 2e17]), "expected seconds or nanoseconds"),
    ],
)
def test_times_that_cannot_be(values, text):
    with pytest.raises(UnreadableScanError, match=text):
        point_time_s({"t": values}, EPOCH_S, "here")


def test_wrong_times_can_be_left_out():
    given = columns(3, t=np.array([0, 1, 2], np.uint32))
    with pytest.raises(UnreadableScanError, match="point_times=False"):
        scan_of_columns(given, 0.0, "here", 0)
    assert scan_of_columns(given, 0.0, "here", 0, point_times=False).time_s is None
