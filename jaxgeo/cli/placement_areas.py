"""The areas in which anchors may stand: from a GeoJSON file to outlines in the local frame."""

from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from pyproj.enums import TransformDirection

from jaxgeo.errors import InputError
from jaxgeo.georef import LOCAL, LocalFrame, read_crs
from jaxgeo.georef.crs import wgs84_operation
from jaxgeo.io.areas_geojson import Areas, read_areas

Ring = Float[np.ndarray, "_ 2"]


def local_areas(path: Path, frame: LocalFrame, said_crs: str | None) -> tuple[Ring, ...]:
    """All rings (E, N) of the areas, holes too: a place is allowed that lies inside of an odd number of them.

    Args:
        said_crs: `grid` or `wgs84`, where the config says it.

    Raises:
        InputError: as `read_areas`; another coordinate system than the frame's; areas that overlap.
    """
    areas = read_areas(path)
    in_grid = _in_grid(path, areas, frame, said_crs)
    polygons = []
    for rings, place in zip(areas.polygon, areas.place, strict=True):
        every = np.concatenate(rings)
        enh_m = np.column_stack([every if in_grid else _grid(place, every, frame), np.zeros(len(every))])
        frame.check(enh_m, [place] * len(enh_m))
        local = frame.to_local(enh_m)[:, :2]
        polygons.append(np.split(local, np.cumsum([len(ring) for ring in rings])[:-1]))
    _refuse_overlaps(polygons, areas.place)
    return tuple(ring for rings in polygons for ring in rings)


def inside(point_m: Float[np.ndarray, "p 2"], rings: tuple[Ring, ...]) -> Bool[np.ndarray, "p"]:
    """Even-odd rule."""
    crossed = np.zeros(len(point_m), dtype=int)
    for a, b in (ends for ring in rings for ends in zip(ring, np.roll(ring, -1, axis=0), strict=True)):
        if a[1] == b[1]:
            continue
        spans = (a[1] > point_m[:, 1]) != (b[1] > point_m[:, 1])
        east = a[0] + (point_m[:, 1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
        crossed += spans & (east > point_m[:, 0])
    return crossed % 2 == 1


def distance_to(point_m: Float[np.ndarray, "p 2"], rings: tuple[Ring, ...]) -> Float[np.ndarray, "p"]:
    """From every point to the nearest allowed place; 0 inside."""
    nearest = np.full(len(point_m), np.inf)
    for a, b in (ends for ring in rings for ends in zip(ring, np.roll(ring, -1, axis=0), strict=True)):
        along = b - a
        share = np.clip((point_m - a) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
        nearest = np.minimum(nearest, np.linalg.norm(a + share[:, None] * along - point_m, axis=1))
    return np.where(inside(point_m, rings), 0.0, nearest)


def _in_grid(path: Path, areas: Areas, frame: LocalFrame, said_crs: str | None) -> bool:
    """Whether the file's numbers are grid coordinates."""
    if areas.crs is not None and said_crs != "grid" and frame.crs == LOCAL:
        raise InputError(f"{path}: is in {areas.crs}, but crs is local, a site frame. Give crs: {areas.crs}?")
    if areas.crs is None:
        if said_crs == "grid":
            return True
        if frame.crs == LOCAL:
            raise InputError(
                f"{path}: is in WGS84 (GeoJSON that names no other system), but crs is local, a site frame. Where the "
                "file holds site coordinates, say anchors.areas_crs: grid."
            )
        return False
    if said_crs == "wgs84":
        raise InputError(f"{path}: says it is in {areas.crs}, but anchors.areas_crs says wgs84: remove one of the two.")
    if frame.crs != LOCAL and read_crs(areas.crs).horizontal != read_crs(frame.crs).horizontal:
        raise InputError(
            f"{path}: is in {areas.crs}, the config in {frame.crs}; save the areas in WGS84 or {frame.crs}."
        )
    return True


def _grid(place: str, lonlat_deg: Ring, frame: LocalFrame) -> Ring:
    if (np.abs(lonlat_deg) > (180.0, 90.0)).any():
        row = lonlat_deg[int(np.argmax((np.abs(lonlat_deg) > (180.0, 90.0)).any(axis=1)))]
        raise InputError(
            f"{place}: {row.tolist()} is no longitude and latitude. Are these easting and northing? Then say "
            "anchors.areas_crs: grid."
        )
    near = frame.to_wgs84(np.zeros((1, 3)))[0]
    operation = wgs84_operation(read_crs(frame.crs), (float(near[0]), float(near[1])))
    return np.column_stack(operation.transform(*lonlat_deg.T, direction=TransformDirection.INVERSE))


def _refuse_overlaps(polygons: list[list[Ring]], places: tuple[str, ...]) -> None:
    """By the even-odd rule, what two areas share would be allowed in neither."""
    for j, second in enumerate(polygons):
        for i, first in enumerate(polygons[:j]):
            within = inside(second[0][:1], tuple(first))[0] or inside(first[0][:1], tuple(second))[0]
            if within or any(_cross(a, b) for a in first for b in second):
                raise InputError(f"{places[j]}: overlaps with {places[i]}; expected areas apart. Merge the two.")


def _cross(first: Ring, second: Ring) -> bool:
    """Whether the outlines cross, not only touch."""

    def side(a: np.ndarray, b: np.ndarray, p: np.ndarray) -> np.ndarray:
        return np.sign(
            (b[..., 0] - a[..., 0]) * (p[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (p[..., 0] - a[..., 0])
        )

    a, b = first[:, None], np.roll(first, -1, axis=0)[:, None]
    c, d = second[None], np.roll(second, -1, axis=0)[None]
    return bool(((side(a, b, c) * side(a, b, d) < 0) & (side(c, d, a) * side(c, d, b) < 0)).any())
