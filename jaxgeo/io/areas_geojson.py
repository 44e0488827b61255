"""Areas in a map: the polygons of a GeoJSON file, as outlines."""

import dataclasses
import re
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxgeo.errors import InputError
from jaxgeo.io.json_file import read_json

_EPSG = re.compile(r"(?:urn:ogc:def:crs:)?EPSG:(?:[0-9.]*:)?(\d+)", re.IGNORECASE)
_CRS84 = re.compile(r"urn:ogc:def:crs:OGC:[0-9.]*:CRS84", re.IGNORECASE)


@dataclasses.dataclass(frozen=True)
class Areas:
    """Polygons as a GeoJSON file has them, in its own coordinates.

    Attributes:
        polygon: rings (n, 2) of each: its outline, then its holes; the first point not repeated. (longitude, latitude)
            or (easting, northing).
        place: (p,) where each polygon stands, for messages.
        crs: `EPSG:<code>` where the file's `crs` member says so; None: WGS84, as RFC 7946 has it.
    """

    polygon: tuple[tuple[Float[np.ndarray, "_ 2"], ...], ...]
    place: tuple[str, ...]
    crs: str | None


def read_areas(path: str | Path) -> Areas:
    """All Polygons and MultiPolygons of a GeoJSON file, whatever they are wrapped in.

    Raises:
        InputError: not GeoJSON, another geometry, no polygon, rings that are not closed or have no area; with the
            feature's number.
    """
    content = _parsed(path)
    polygons, places = [], []
    for place, geometry in _geometries(path, content, "", 0):
        kind, coordinates = geometry.get("type"), geometry.get("coordinates")
        if kind not in ("Polygon", "MultiPolygon"):
            raise InputError(
                f"{path}: {place or 'the geometry'} is a {str(kind)[:40]}; expected areas: Polygon or MultiPolygon. "
                "Remove it, or draw the area around it."
            )
        for number, rings in enumerate([coordinates] if kind == "Polygon" else _list(path, place, coordinates), 1):
            here = f"{place or 'the geometry'}{f', polygon {number}' if kind == 'MultiPolygon' else ''}"
            polygons.append(tuple(_ring(path, here, ring) for ring in _list(path, here, rings)))
            if not polygons[-1]:
                raise InputError(f"{path}: {here}: a polygon without an outline. Remove it, or draw it anew.")
            places.append(f"{path}: {here}")
    if not polygons:
        raise InputError(f"{path}: has no polygon; expected the areas in which anchors may stand.")
    return Areas(tuple(polygons), tuple(places), _crs(path, content.get("crs")))


def _parsed(path: str | Path) -> dict[str, Any]:
    content = read_json(path, "a GeoJSON file of polygons")
    if not isinstance(content, dict) or "type" not in content:
        raise InputError(f"{path}: is not GeoJSON (no 'type'); expected a FeatureCollection of polygons.")
    return content


def _geometries(path: str | Path, value: Any, place: str, depth: int) -> list[tuple[str, dict[str, Any]]]:
    """(where, geometry) of all geometries, from collections and features."""
    if not isinstance(value, dict):
        found = "no geometry" if value is None else f"a {type(value).__name__}"
        raise InputError(f"{path}: {place or 'the file'} holds {found}; expected a Polygon or MultiPolygon.")
    if depth > 4:
        raise InputError(f"{path}: {place}: collections in collections; expected a FeatureCollection of polygons.")
    match value.get("type"):
        case "FeatureCollection":
            features = _list(path, place, value.get("features"))
            return [g for i, f in enumerate(features, 1) for g in _geometries(path, f, f"feature {i}", depth + 1)]
        case "Feature":
            return _geometries(path, value.get("geometry"), place or "the feature", depth + 1)
        case "GeometryCollection":
            parts = _list(path, place, value.get("geometries"))
            return [
                g
                for i, part in enumerate(parts, 1)
                for g in _geometries(path, part, f"{place + ', ' if place else ''}geometry {i}", depth + 1)
            ]
    return [(place, value)]


def _list(path: str | Path, place: str, value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise InputError(f"{path}: {place or 'the file'}: its coordinates or parts are {value!r:.40}; expected a list.")
    return value


def _ring(path: str | Path, place: str, value: Any) -> Float[np.ndarray, "n 2"]:
    rows = [row[:2] if isinstance(row, list) else row for row in _list(path, place, value)]
    try:
        ring = np.array(rows, dtype=float)
    except (TypeError, ValueError, OverflowError):
        ring = np.zeros((0, 0))
    if ring.ndim != 2 or ring.shape[1] != 2 or not np.isfinite(ring).all():
        raise InputError(f"{path}: {place}: a ring holds something else than positions [x, y]; mend or remove it.")
    if len(ring) < 4 or (ring[0] != ring[-1]).any():
        raise InputError(
            f"{path}: {place}: a ring of {len(ring)} positions, {'not closed' if len(ring) > 3 else 'too few'}; "
            "expected four or more, the last the same as the first."
        )
    ring = ring[:-1]
    x, y = (ring - ring[0]).T
    if abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) == 0.0:
        raise InputError(f"{path}: {place}: a ring without area: all its corners lie on one line. Draw it anew.")
    return ring


def _crs(path: str | Path, member: Any) -> str | None:
    """The `crs` member of GeoJSON as it was before RFC 7946, which GIS programs still write."""
    if member is None:
        return None
    properties = member.get("properties") if isinstance(member, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if isinstance(name, str) and _CRS84.fullmatch(name):
        return None
    code = _EPSG.fullmatch(name) if isinstance(name, str) else None
    if code is None:
        raise InputError(
            f"{path}: its crs member is {str(member)[:80]}; expected a name such as urn:ogc:def:crs:EPSG::2169. Remove "
            "the member where the file is in WGS84."
        )
    return None if code.group(1) == "4326" else f"EPSG:{code.group(1)}"
