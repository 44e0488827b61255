import json

import numpy as np
import pyproj
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from jaxgeo.errors import SurveyError
from jaxgeo.georef import LocalFrame, check_in_area, default_origin, read_crs

# The paper's survey as (E, N, h); it prints N first.
LUREF = np.array(
    [
        [79345.498, 76839.129, 340.570],
        [79357.502, 76829.898, 339.409],
        [79363.262, 76821.262, 338.276],
        [79320.063, 76789.028, 338.382],
        [79309.431, 76804.525, 340.234],
        [79296.809, 76815.709, 341.129],
    ]
)
NAMES = list("ABCDEF")
ORIGIN = default_origin(LUREF)


@pytest.mark.parametrize("crs", ["EPSG:2169", "EPSG:9897", "epsg:2169+5773"])
def test_wgs84_as_pyproj(crs):
    """The compound CRSs too: left alone, PROJ takes a ballpark operation for them that is 112 m off."""
    frame = LocalFrame.create(crs, ORIGIN)
    found = frame.to_wgs84(frame.to_local(LUREF))
    direct = pyproj.Transformer.from_crs("EPSG:2169", "EPSG:4326", always_xy=True)
    lon, lat = direct.transform(LUREF[:, 0], LUREF[:, 1])
    assert_allclose(found, np.column_stack([lon, lat, LUREF[:, 2]]), rtol=0, atol=1e-11)
    easting, northing = direct.transform(found[:, 0], found[:, 1], direction="INVERSE")
    # 0.3 mm: the way back does not know the ellipsoidal height that the datum shift left behind.
    assert_allclose(np.column_stack([easting, northing]), LUREF[:, :2], rtol=0, atol=5e-4)
    # Kirchberg, Luxembourg: an exchange of E and N would be 2.5 km off.
    assert_allclose(found.mean(axis=0)[:2], [6.159, 49.626], atol=1e-3)


def test_what_is_recorded():
    frame = LocalFrame.create("EPSG:9897", ORIGIN)
    assert frame.crs_name == "LUREF / Luxembourg TM + NG95 height"
    assert frame.axis_order == ("Northing", "Easting", "Gravity-related height")
    assert frame.height == "NG95 height"
    assert frame.operation is not None
    assert "LUREF to WGS 84" in frame.operation
    assert "allpark" not in frame.operation
    assert frame.operation_accuracy_m == 1.0
    assert frame.grid_scale is not None
    assert abs(frame.grid_scale - 1.0) < 1.1e-5
    assert json.loads(json.dumps(frame.as_dict()))["origin_enh_m"] == ORIGIN.tolist()
    assert "no vertical CRS" in LocalFrame.create("EPSG:2169", ORIGIN).height


def test_utm_scale_on_the_central_meridian():
    frame = LocalFrame.create("EPSG:32632", np.array([500000.0, 5500000.0, 0.0]))
    assert frame.grid_scale == pytest.approx(0.9996, abs=1e-9)


def test_network_is_off():
    LocalFrame.create("EPSG:31467", np.array([3.5e6, 5.5e6, 100.0]))
    assert not pyproj.network.is_network_enabled()


# mm-rounded coordinates not below half the origin: there subtraction is exact (Sterbenz), and so is the way back.
@given(
    st.sampled_from([79345.0, 500000.0, 5512345.0, 2.6e6, 340.0, -5512345.0]),
    st.lists(st.floats(-0.33, 3.0), min_size=1, max_size=20),
)
def test_there_and_back_bit_for_bit(size, shares):
    enh = np.round(size * (1.0 + np.array(shares))[:, None] * np.ones(3), 3)
    origin = np.full(3, 100.0 * np.trunc(size / 100.0))
    frame = LocalFrame.create("local", origin)
    assert_array_equal(frame.to_grid(frame.to_local(enh)), enh)


@given(st.lists(st.tuples(*[st.floats(-1e7, 1e7)] * 3), min_size=1, max_size=9))
def test_default_origin_is_whole_hundreds_near_the_median(points):
    origin = default_origin(np.array(points))
    assert_array_equal(origin % 100.0, 0.0)
    median = np.median(np.array(points), axis=0)
    assert (np.abs(origin - median) < 100.0 + 1e-6).all()
    assert (np.abs(origin) <= np.abs(median)).all()


def test_default_origin_of_the_survey():
    assert_array_equal(ORIGIN, [79300.0, 76800.0, 300.0])


def test_local_frame_has_no_longitude():
    frame = LocalFrame.create("local", np.zeros(3))
    assert not frame.has_datum
    assert_array_equal(frame.to_grid(np.ones((2, 3))), 1.0)
    with pytest.raises(SurveyError, match="no datum"):
        frame.to_wgs84(np.zeros((1, 3)))


@pytest.mark.parametrize(
    ("crs", "words"),
    [
        ("EPSG:999999", "not in the EPSG register"),
        ("EPSG:2169+999999", "not in the EPSG register"),
        ("LUREF", "not `EPSG:<code>`"),
        ("", "not `EPSG:<code>`"),
        ("2169", "not `EPSG:<code>`"),
        (None, "not `EPSG:<code>`"),
        ("EPSG:4326", "degrees"),
        ("EPSG:4979", "degrees"),
        ("EPSG:4978", "projected CRS in metres"),
        ("EPSG:5773", "a Vertical CRS"),
        ("EPSG:2263", "US survey foot; expected metres"),
        ("EPSG:2169+6360", "US survey foot; expected metres"),
        ("EPSG:2169+5715", "points down"),
        ("EPSG:2048", "points west"),
        ("EPSG:3031", "one east and one north"),
    ],
)
def test_unsuitable_crs(crs, words):
    with pytest.raises(SurveyError, match=words):
        LocalFrame.create(crs, ORIGIN)


def test_no_operation_but_a_ballpark():
    """NAD27(CGQ77): without its grid file PROJ would leave the datum shift out."""
    with pytest.raises(SurveyError, match="no operation to WGS84"):
        LocalFrame.create("EPSG:2013", np.array([3.0e5, 5.0e6, 100.0]))


def test_web_mercator_metres_are_not_metres():
    with pytest.raises(SurveyError, match=r"1\.\d+ grid metres stand for one metre"):
        LocalFrame.create("EPSG:3857", np.array([685000.0, 6380000.0, 300.0]))


def test_swapped_utm_is_named():
    with pytest.raises(SurveyError, match="columns are probably swapped"):
        check_in_area(read_crs("EPSG:32632"), np.array([[5.5e6, 3.0e5, 0.0]]), ["P1"])


def test_far_outside_is_named():
    with pytest.raises(
        SurveyError, match=r"^C: E 2600000\.000, N 1200000\.000 lies \d+ km outside the area of EPSG:2169"
    ):
        check_in_area(read_crs("EPSG:2169"), np.vstack([LUREF[:2], [[2.6e6, 1.2e6, 500.0]]]), NAMES)


def test_off_the_map_is_named():
    with pytest.raises(SurveyError, match="off the map"):
        check_in_area(read_crs("EPSG:32632"), np.array([[5e7, 5e7, 0.0]]), ["P1"])


def test_a_little_outside_is_allowed():
    check_in_area(read_crs("EPSG:2169"), np.array([[160000.0, 76000.0, 0.0]]), ["P1"])


def test_area_across_the_date_line():
    crs = read_crs("EPSG:3460")  # Fiji: 176.81 east to -178.15
    check_in_area(crs, np.array([[2.0e6, 4.0e6, 1.0], [2.2e6, 4.0e6, 1.0]]), ["P1", "P2"])
    with pytest.raises(SurveyError, match="km outside"):
        check_in_area(crs, np.array([[2.0e6, 6.0e6, 1.0]]), ["P1"])


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e12])
@pytest.mark.parametrize("crs", ["EPSG:2169", "local"])
def test_no_number_or_absurd(crs, bad):
    frame = LocalFrame.create(crs, ORIGIN)
    points = LUREF.copy()
    points[3, 2] = bad
    with pytest.raises(SurveyError, match=r"^D: coordinates"):
        frame.check(points, NAMES)


def test_origin_of_two_numbers():
    with pytest.raises(SurveyError, match="three numbers"):
        LocalFrame.create("EPSG:2169", np.array([1.0, 2.0]))
