"""`jaxgeo marker-map`: marker corners of photographs to a map of the markers."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from jaxgeo.cli.progress import Progress
from jaxgeo.data import CornerSightings
from jaxgeo.errors import SightingError
from jaxgeo.export.marker_map_files import write_marker_map
from jaxgeo.io.atomic import check_output_folder
from jaxgeo.io.rig_yaml import read_rig
from jaxgeo.io.sightings_csv import read_corner_sightings
from jaxgeo.solve.marker_map import MapSettings, MarkerMap, build_marker_map


def map_markers(
    table: Path,
    rig_file: Path,
    side_m: float,
    out: Path,
    settings: MapSettings,
    *,
    pixel_sigma_px: float,
    only: Sequence[str] = (),
    quiet: bool = False,
) -> None:
    """Read corners and rig, map the markers, write the map and say how well it fits.

    Raises:
        JaxgeoError: as `read_corner_sightings`, `read_rig` and `build_marker_map`.
    """
    check_output_folder(out)
    rig = read_rig(rig_file)
    corners = _chosen(read_corner_sightings(table), only, table)
    with Progress(quiet) as progress:
        progress.phase("map")
        found = build_marker_map(corners, rig, side_m, pixel_sigma_px, settings)
        progress.phase("files")
        write_marker_map(out, found, rig, side_m)
    if not quiet:
        print(summary(found))
        print(out)


def _chosen(corners: CornerSightings, only: Sequence[str], path: Path) -> CornerSightings:
    """The rows of the markers named; all where none is."""
    if not only:
        return corners
    unknown = [name for name in only if name not in corners.marker]
    if unknown:
        raise SightingError(
            f"{path}: no marker {', '.join(map(repr, unknown))} (--only); the table has "
            f"{', '.join(map(str, np.unique(corners.marker)[:20]))}."
        )
    rows = np.flatnonzero(np.isin(corners.marker, list(only)))
    covariance = corners.covariance_px2
    return CornerSightings(
        corners.stamp_s[rows],
        corners.camera[rows],
        corners.marker[rows],
        corners.corners_px[rows],
        corners.source[rows],
        None if covariance is None else covariance[rows],
    )


def summary(found: MarkerMap) -> str:
    """What was mapped and how well it fits, in a few lines."""
    error_px = found.corner_error_px
    sigma_m = np.sqrt(np.trace(found.covariance[:, :3, :3], axis1=1, axis2=2))
    lines = [
        f"{len(found.marker)} markers, {len(found.stamp_s)} images, {len(found.weight)} sightings; "
        f"frame: marker {found.origin}",
        f"reprojection: median {np.median(error_px):.3f} px, RMS {np.sqrt(np.mean(error_px**2)):.3f} px, "
        f"worst {error_px.max():.2f} px",
        f"corner sigmas times {found.sigma_factor:.2f}; chi2 {found.chi2:.0f} of {found.dof} degrees of freedom; "
        f"marker positions to {1e3 * np.median(sigma_m):.1f} mm (median), {1e3 * sigma_m.max():.1f} mm (worst)",
    ]
    if np.any(found.camera_sigma):
        scale, cx, cy, k1, k2 = found.camera.tolist()
        lines.append(
            f"camera: focal lengths times {np.exp(scale):.4f}, principal point {cx:+.2f}, {cy:+.2f} px, "
            f"k1 {k1:+.4f}, k2 {k2:+.4f}"
        )
    outliers = found.outliers.tolist()
    if outliers:
        named = ", ".join(f"{found.source[s]} (marker {found.marker[found.sighting_marker[s]]})" for s in outliers[:5])
        lines.append(f"{len(outliers)} sightings count less than half: {named}{' ...' * (len(outliers) > 5)}")
    return "\n".join(lines)
