"""Orthophotos: every pixel where it belongs, also from another coordinate system; what is unknown is transparent."""

import math
import sys

import numpy as np
import pyproj
import pytest
import rasterio
from rasterio.transform import Affine

from jaxgeo.errors import InputError
from jaxgeo.io.orthophoto import read_orthophoto

WEST, NORTH = 79300.0, 76860.0


def write_tiff(path, bands, pixel_m=1.0, crs="EPSG:2169", place=None, **profile):
    """Bands (c, h, w) as a GeoTIFF with its upper left corner at (WEST, NORTH)."""
    place = Affine(pixel_m, 0.0, WEST, 0.0, -pixel_m, NORTH) if place is None else place
    count, height, width = bands.shape
    palette, colours = profile.pop("palette", None), profile.pop("colours", None)
    with rasterio.open(
        path, "w", driver="GTiff", width=width, height=height, count=count, dtype=bands.dtype, crs=crs, transform=place,
        **profile,
    ) as file:  # fmt: skip
        file.write(bands)
        if palette:
            file.write_colormap(1, palette)
        if colours:
            file.colorinterp = colours
    return path


@pytest.fixture
def random_bands():
    return np.random.default_rng(0).integers(0, 256, (3, 8, 10), dtype=np.uint8)


def test_the_pixels_of_the_box_come_back_as_they_are(tmp_path, random_bands):
    path = write_tiff(tmp_path / "a.tif", random_bands)
    photo = read_orthophoto(path, "EPSG:2169", (WEST + 2, NORTH - 7, WEST + 8, NORTH - 3))
    assert photo.bounds_en_m == (WEST + 2, NORTH - 7, WEST + 8, NORTH - 3)
    np.testing.assert_array_equal(photo.rgba[..., :3], np.moveaxis(random_bands[:, 3:7, 2:8], 0, -1))
    assert (photo.rgba[..., 3] == 255).all()


def test_a_box_larger_than_the_file_gives_the_whole_file(tmp_path, random_bands):
    path = write_tiff(tmp_path / "a.tif", random_bands)
    photo = read_orthophoto(path, "EPSG:2169", (WEST - 100, NORTH - 4, WEST + 100, NORTH + 50))
    assert photo.bounds_en_m == (WEST, NORTH - 4, WEST + 10, NORTH)
    np.testing.assert_array_equal(photo.rgba[..., 0], random_bands[0, :4])


def test_a_large_file_is_thinned_out_by_means(tmp_path):
    stripes = np.zeros((3, 400, 600), np.uint8)
    stripes[:, :, ::2] = 200
    path = write_tiff(tmp_path / "a.tif", stripes, pixel_m=0.1)
    photo = read_orthophoto(path, "EPSG:2169", (WEST, NORTH - 40, WEST + 60, NORTH), most_px=60)
    assert photo.rgba.shape == (40, 60, 4)
    np.testing.assert_allclose(photo.rgba[1:-1, 1:-1, 0], 100, atol=12)


@pytest.mark.parametrize("crs", ["EPSG:3857", "EPSG:4326", "EPSG:32632"])
def test_a_file_in_another_system_lies_where_pyproj_says(tmp_path, crs):
    site = (79300.0, 76780.0, 79380.0, 76860.0)
    there = pyproj.Transformer.from_crs("EPSG:2169", crs, always_xy=True)
    back = pyproj.Transformer.from_crs(crs, "EPSG:2169", always_xy=True)
    x0, y0, x1, y1 = there.transform_bounds(site[0] - 20, site[1] - 20, site[2] + 20, site[3] + 20)
    n = 120
    x, y = np.meshgrid(x0 + (np.arange(n) + 0.5) * (x1 - x0) / n, y1 - (np.arange(n) + 0.5) * (y1 - y0) / n)
    east, north = back.transform(x, y)
    # A change of one level of red is 0.4 m of easting, of green 0.4 m of northing: half a pixel would show
    bands = np.stack([2.5 * (east - site[0] + 10), 2.5 * (north - site[1] + 10), 0.0 * east]).clip(0, 255)
    place = Affine((x1 - x0) / n, 0.0, x0, 0.0, -(y1 - y0) / n, y1)
    path = write_tiff(tmp_path / "a.tif", bands.round().astype(np.uint8), crs=crs, place=place)

    photo = read_orthophoto(path, "EPSG:2169", site)
    assert photo.bounds_en_m == site
    height, width = photo.rgba.shape[:2]
    e = site[0] + (np.arange(width) + 0.5) * (site[2] - site[0]) / width
    n = site[3] - (np.arange(height) + 0.5) * (site[3] - site[1]) / height
    np.testing.assert_allclose(photo.rgba[..., 0], np.broadcast_to(2.5 * (e - site[0] + 10), (height, width)), atol=1.5)
    shown_north = np.broadcast_to(2.5 * (n - site[1] + 10)[:, None], (height, width))
    np.testing.assert_allclose(photo.rgba[..., 1], shown_north, atol=1.5)
    assert (photo.rgba[..., 3] == 255).all()


def test_a_turned_file_is_turned_back(tmp_path):
    bands = np.arange(12, dtype=np.uint8).reshape(1, 3, 4) * 20
    east_down = Affine(0.0, 1.0, WEST, 1.0, 0.0, NORTH - 4)  # columns run north, rows run east
    path = write_tiff(tmp_path / "a.tif", bands, place=east_down)
    photo = read_orthophoto(path, "EPSG:2169", (WEST - 1, NORTH - 9, WEST + 9, NORTH + 9))
    assert photo.bounds_en_m == (WEST, NORTH - 4, WEST + 3, NORTH)
    # GDAL's bilinear kernel is a little wider than one pixel here: at the rim four levels of twenty
    np.testing.assert_allclose(photo.rgba[..., 0], bands[0].T[::-1], atol=5)


def test_the_corners_beside_a_turned_file_are_transparent(tmp_path):
    turned = Affine.translation(WEST, NORTH) * Affine.rotation(45.0) * Affine.scale(1.0, -1.0)
    path = write_tiff(tmp_path / "a.tif", np.full((3, 20, 20), 90, np.uint8), place=turned)
    rgba = read_orthophoto(path, "EPSG:2169", (WEST - 50, NORTH - 50, WEST + 50, NORTH + 50)).rgba
    middle = rgba.shape[0] // 2
    assert rgba[middle, middle].tolist() == [90, 90, 90, 255]
    assert rgba[[0, 0, -1, -1], [0, -1, 0, -1], 3].tolist() == [0, 0, 0, 0]


def test_nodata_is_transparent_where_all_colours_are(tmp_path):
    bands = np.full((3, 2, 3), 50, np.uint8)
    bands[:, 0, 0] = 0
    bands[0, 1, 1] = 0  # one dark red is no hole
    path = write_tiff(tmp_path / "a.tif", bands, nodata=0)
    opacity = read_orthophoto(path, "EPSG:2169", (WEST, NORTH - 2, WEST + 3, NORTH)).rgba[..., 3]
    np.testing.assert_array_equal(opacity, [[0, 255, 255], [255, 255, 255]])


def test_an_alpha_band_stays_and_is_no_colour(tmp_path):
    bands = np.stack(
        [np.full((2, 2), v, np.uint8) for v in (10, 20, 30)] + [np.array([[0, 255], [255, 128]], np.uint8)]
    )
    colour = rasterio.enums.ColorInterp
    path = write_tiff(tmp_path / "a.tif", bands, colours=[colour.red, colour.green, colour.blue, colour.alpha])
    rgba = read_orthophoto(path, "EPSG:2169", (WEST, NORTH - 2, WEST + 2, NORTH)).rgba
    np.testing.assert_array_equal(rgba[..., 3], bands[3])
    assert rgba[0, 1].tolist() == [10, 20, 30, 255]


def test_one_band_is_grey_and_a_palette_has_its_colours(tmp_path):
    bands = np.array([[[0, 1], [2, 1]]], np.uint8)
    box = (WEST, NORTH - 2, WEST + 2, NORTH)
    grey = read_orthophoto(write_tiff(tmp_path / "g.tif", bands), "EPSG:2169", box).rgba
    assert grey[1, 0].tolist() == [2, 2, 2, 255]
    palette = {0: (1, 2, 3, 255), 1: (200, 100, 50, 255), 2: (9, 8, 7, 255)}
    path = write_tiff(tmp_path / "p.tif", bands, palette=palette, photometric="palette")
    rgba = read_orthophoto(path, "EPSG:2169", box).rgba
    assert rgba[0, 1].tolist() == [200, 100, 50, 255]
    assert rgba[1, 0].tolist() == [9, 8, 7, 255]
    many = write_tiff(
        tmp_path / "m.tif", bands.astype(np.uint16) * 300, palette={600: (4, 5, 6, 255)}, photometric="palette"
    )
    assert read_orthophoto(many, "EPSG:2169", box).rgba[1, 0].tolist() == [4, 5, 6, 255]


@pytest.mark.parametrize("dtype", ["uint16", "float32"])
def test_values_that_are_not_bytes_are_stretched(tmp_path, dtype):
    ramp = np.linspace(1000, 3000, 101).astype(dtype)
    bands = np.broadcast_to(ramp, (3, 4, 101)).copy()
    if dtype == "float32":
        bands[:, 0, 0] = np.nan
    path = write_tiff(tmp_path / "a.tif", bands)
    rgba = read_orthophoto(path, "EPSG:2169", (WEST, NORTH - 4, WEST + 101, NORTH)).rgba
    assert rgba[2, [1, 50, 99], 0].tolist() == [0, pytest.approx(127.5, abs=1), 255]
    assert (np.diff(rgba[2, :, 1].astype(int)) >= 0).all()
    assert rgba[0, 0, 3] == (0 if dtype == "float32" else 255)
    assert (rgba[1:, :, 3] == 255).all()


@pytest.mark.parametrize(
    ("box", "words"),
    [
        ((WEST + 500, NORTH - 8, WEST + 600, NORTH), "E 79300 … 79310, N 76852 … 76860; the map needs E 79800 … 79900"),
        ((NORTH - 8, WEST, NORTH, WEST + 10), "order of E and N"),
    ],
)
def test_a_photo_of_another_place_is_refused_with_both_boxes(tmp_path, random_bands, box, words):
    path = write_tiff(tmp_path / "a.tif", random_bands)
    with pytest.raises(InputError, match=words):
        read_orthophoto(path, "EPSG:2169", box)


BOX = (WEST, NORTH - 8, WEST + 10, NORTH)


def test_files_that_are_no_orthophotos_are_refused(tmp_path, random_bands):
    with pytest.raises(InputError, match=r"none\.tif: no such file"):
        read_orthophoto(tmp_path / "none.tif", "EPSG:2169", BOX)
    (tmp_path / "text.tif").write_text("not a picture")
    with pytest.raises(InputError, match=r"text\.tif: is not a raster"):
        read_orthophoto(tmp_path / "text.tif", "EPSG:2169", BOX)
    with pytest.raises(InputError, match=r"nowhere\.tif: names no coordinate system"):
        read_orthophoto(write_tiff(tmp_path / "nowhere.tif", random_bands, crs=None), "EPSG:2169", BOX)
    whole = write_tiff(tmp_path / "cut.tif", np.zeros((3, 300, 300), np.uint8)).read_bytes()
    (tmp_path / "cut.tif").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"cut\.tif: its pixels cannot be read"):
        read_orthophoto(tmp_path / "cut.tif", "EPSG:2169", (WEST, NORTH - 300, WEST + 300, NORTH))
    complex_bands = np.zeros((1, 4, 4), np.complex64)
    with pytest.raises(InputError, match="complex64; expected colours"):
        read_orthophoto(write_tiff(tmp_path / "c.tif", complex_bands), "EPSG:2169", BOX)
    nowhere = Affine(math.nan, 0.0, WEST, 0.0, -1.0, NORTH)
    with pytest.raises(InputError, match=r"nan\.tif"):
        read_orthophoto(write_tiff(tmp_path / "nan.tif", random_bands, place=nowhere), "EPSG:2169", BOX)


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")  # of writing one
def test_a_picture_without_a_place_is_refused(tmp_path, random_bands):
    path = write_tiff(tmp_path / "a.tif", random_bands, place=Affine.identity())
    with pytest.raises(InputError, match="no place"):
        read_orthophoto(path, "EPSG:2169", BOX)


def test_without_rasterio_the_extra_is_named(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "rasterio", None)
    with pytest.raises(InputError, match=r"jaxgeo\[maps\]"):
        read_orthophoto(tmp_path / "a.tif", "EPSG:2169", BOX)
