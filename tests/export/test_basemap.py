"""Maps over an orthophoto: the photo in its place, grid coordinates on the frame, a bar that is as long as it says."""

import numpy as np
import pytest
import rasterio
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.patches import Rectangle
from rasterio.transform import Affine

from jaxgeo.errors import SurveyError
from jaxgeo.export.basemap import bar_length_m, draw_basemap, grid_ticks, north_arrow, read_basemap, scale_bar
from jaxgeo.export.figure_style import figure_style, svg_bytes
from jaxgeo.export.map_axes import map_figure, map_limits
from jaxgeo.georef import LocalFrame
from jaxgeo.io.orthophoto import Orthophoto

ORIGIN_ENH_M = np.array([79300.0, 76800.0, 300.0])
SITE_EN_M = np.array([[-10.0, -40.0], [30.0, 60.0]])


@pytest.fixture
def photo_path(tmp_path):
    """300 m by 300 m around the site, 2 m a pixel: red grows with easting, green with northing."""
    ramp = np.arange(150, dtype=np.uint8)
    bands = np.stack([np.broadcast_to(ramp, (150, 150)), np.broadcast_to(ramp[::-1, None], (150, 150))])
    bands = np.stack([*bands, np.zeros_like(bands[0])])
    place = Affine(2.0, 0.0, 79160.0, 0.0, -2.0, 76960.0)
    path = tmp_path / "photo.tif"
    options = {"width": 150, "height": 150, "count": 3, "dtype": "uint8", "crs": "EPSG:2169", "transform": place}
    with rasterio.open(path, "w", driver="GTiff", **options) as file:
        file.write(bands)
    return path


@pytest.mark.parametrize("crs", ["EPSG:2169", "EPSG:9897"])
def test_the_photo_fills_the_map_and_lies_where_its_coordinates_say(photo_path, crs):
    photo = read_basemap(photo_path, LocalFrame.create(crs, ORIGIN_ENH_M), SITE_EN_M)
    with figure_style():
        _, (axes,) = map_figure(*map_limits(SITE_EN_M), 1, ORIGIN_ENH_M)
        limits = (*axes.get_xlim(), *axes.get_ylim())
        draw_basemap(axes, photo, ORIGIN_ENH_M)
        assert (*axes.get_xlim(), *axes.get_ylim()) == limits
        (image,) = axes.images
        west, east, south, north = image.get_extent()
    assert west <= limits[0] < limits[1] <= east
    assert south <= limits[2] < limits[3] <= north
    rgba = photo.rgba
    e = west + (np.arange(rgba.shape[1]) + 0.5) * (east - west) / rgba.shape[1] + ORIGIN_ENH_M[0]
    n = north - (np.arange(rgba.shape[0]) + 0.5) * (north - south) / rgba.shape[0] + ORIGIN_ENH_M[1]
    np.testing.assert_allclose(rgba[5, :, 0], (e - 79161.0) / 2.0, atol=0.6)
    np.testing.assert_allclose(rgba[:, 5, 1], (n - 76661.0) / 2.0, atol=0.6)


def test_a_site_frame_has_no_place_on_a_photo(photo_path):
    with pytest.raises(SurveyError, match="crs `local` has no place on a map"):
        read_basemap(photo_path, LocalFrame.create("local", np.zeros(3)), SITE_EN_M)


@pytest.mark.parametrize("origin", [ORIGIN_ENH_M, np.array([79312.34, 5_512_345.67, 0.0])])
def test_ticks_are_round_grid_coordinates(origin):
    with figure_style():
        figure, (axes,) = map_figure(np.array([-10.0, -40.0]), np.array([30.0, 60.0]), 1, origin)
        grid_ticks(axes, origin, "EPSG:2169")
        figure.draw_without_rendering()
        for axis, o in ((axes.xaxis, origin[0]), (axes.yaxis, origin[1])):
            texts = [t.get_text() for t in axis.get_ticklabels()]
            value = np.array([float(t.replace("\u202f", "")) for t in texts])
            assert len(value) >= 3
            np.testing.assert_allclose(value, axis.get_ticklocs() + o, atol=1e-6)
            np.testing.assert_allclose(value % 5.0, 0.0, atol=1e-9)
        assert axes.get_xlabel() == "Easting [m], EPSG:2169"
        low, high = axes.get_xlim()
        assert ((axes.get_xticks() >= low) & (axes.get_xticks() <= high)).all()


@given(st.floats(0.5, 1e5))
def test_the_bar_is_round_and_fits(width_m):
    length_m = bar_length_m(width_m)
    assert 0.1 * width_m <= length_m <= 0.25 * width_m
    assert f"{length_m:.0e}"[0] in "125"


@pytest.mark.parametrize(("width_m", "words"), [(80.0, "20 m"), (9000.0, "2 km"), (3.0, "0.5 m")])
def test_the_bar_is_as_long_as_it_says(width_m, words):
    with figure_style():
        figure, (axes,) = map_figure(np.zeros(2), np.array([width_m, 0.8 * width_m]), 1, np.zeros(3))
        scale_bar(axes)
        north_arrow(axes)
        svg_bytes(figure)
        assert words in [t.get_text() for t in axes.texts]
        bar = [p for p in axes.patches if isinstance(p, Rectangle)][1:5]
        number, unit = words.split()
        length_m = float(number) * (1000.0 if unit == "km" else 1.0)
        drawn_m = sum(p.get_width() for p in bar) * float(np.diff(axes.get_xlim())[0])
        assert drawn_m == pytest.approx(length_m)
        assert [t.get_text() for t in axes.texts][-1] == "N"


def test_what_the_photo_does_not_cover_stays_white():
    photo = Orthophoto(np.zeros((2, 2, 4), np.uint8), (79300.0, 76800.0, 79310.0, 76810.0))
    with figure_style():
        figure, (axes,) = map_figure(np.zeros(2), np.array([10.0, 10.0]), 1, ORIGIN_ENH_M)
        draw_basemap(axes, photo, ORIGIN_ENH_M)
        np.testing.assert_array_equal(axes.images[0].get_extent(), [0.0, 10.0, 0.0, 10.0])
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        pixel = np.asarray(canvas.buffer_rgba())
        box = axes.get_window_extent()
        x, y = int(box.x0 + 0.33 * box.width), int(pixel.shape[0] - box.y0 - 0.37 * box.height)
        assert pixel[y, x].tolist() == [255, 255, 255, 255]
