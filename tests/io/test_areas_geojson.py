"""Areas from GeoJSON: what polygons they are, in which coordinates, and what is refused."""

import json

import numpy as np
import pytest

from jaxgeo.errors import InputError
from jaxgeo.io.areas_geojson import read_areas

SQUARE = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0], [0.0, 0.0]]
HOLE = [[1.0, 1.0], [1.0, 2.0], [2.0, 2.0], [1.0, 1.0]]


def polygon(*rings):
    return {"type": "Polygon", "coordinates": list(rings)}


def feature(geometry):
    return {"type": "Feature", "properties": {}, "geometry": geometry}


def written(folder, value):
    path = folder / "areas.geojson"
    path.write_text(value if isinstance(value, str) else json.dumps(value))
    return path


def test_polygons_of_every_wrapping(tmp_path):
    multi = {"type": "MultiPolygon", "coordinates": [[SQUARE, HOLE], [SQUARE]]}
    both = {"type": "GeometryCollection", "geometries": [polygon(SQUARE)]}
    value = {"type": "FeatureCollection", "features": [feature(polygon(SQUARE)), feature(multi), feature(both)]}
    found = read_areas(written(tmp_path, value))
    assert [len(rings) for rings in found.polygon] == [1, 2, 1, 1]
    assert found.crs is None
    assert found.place[2].endswith("feature 2, polygon 2")
    np.testing.assert_array_equal(found.polygon[1][1], HOLE[:-1])
    assert len(read_areas(written(tmp_path, polygon(SQUARE))).polygon) == 1


def test_heights_are_not_read(tmp_path):
    ring = [[*xy, 5.0] for xy in SQUARE]
    assert read_areas(written(tmp_path, feature(polygon(ring)))).polygon[0][0].shape == (4, 2)


@pytest.mark.parametrize(
    ("name", "crs"),
    [
        ("urn:ogc:def:crs:EPSG::2169", "EPSG:2169"),
        ("EPSG:2169", "EPSG:2169"),
        ("urn:ogc:def:crs:EPSG:9.8.4:2169", "EPSG:2169"),
        ("urn:ogc:def:crs:OGC:1.3:CRS84", None),
        ("EPSG:4326", None),
    ],
)
def test_the_coordinate_system_that_the_file_names(tmp_path, name, crs):
    value = polygon(SQUARE) | {"crs": {"type": "name", "properties": {"name": name}}}
    assert read_areas(written(tmp_path, value)).crs == crs


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("{", "areas.geojson:1"),
        ("[]", "is not GeoJSON"),
        ({"type": "FeatureCollection", "features": []}, "has no polygon"),
        (feature({"type": "Point", "coordinates": [0, 0]}), "the feature is a Point"),
        (feature(None), "no geometry"),
        (polygon(SQUARE[:-1]), "not closed"),
        (polygon(SQUARE[:3]), "too few"),
        (polygon([[0, 0], [1, 1], [2, 2], [0, 0]]), "without area"),
        (polygon([[0, 0], [1, "a"], [2, 2], [0, 0]]), "positions [x, y]"),
        (polygon([[0, 0], [1, 10**400], [2, 2], [0, 0]]), "positions [x, y]"),
        (polygon(5), "expected a list"),
        (polygon(SQUARE) | {"crs": {"type": "link"}}, "crs member"),
    ],
)
def test_what_is_refused(tmp_path, value, said):
    with pytest.raises(InputError) as error:
        read_areas(written(tmp_path, value))
    assert said in str(error.value)
