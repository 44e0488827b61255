"""Sightings: tables of marker corners in images, or of marker poses."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jaxgeo.data import CornerSightings, Rig, Sightings
from jaxgeo.errors import SightingError
from jaxgeo.io.atomic import write_lines
from jaxgeo.io.checks import check_seconds, check_size, unit_quaternions
from jaxgeo.io.column_roles import Columns, column_roles
from jaxgeo.io.sighting_covariance import COVARIANCE, camera_to_body, optional_column, row_covariances
from jaxgeo.io.text_table import TextTable, float_columns, read_table, text_column

CORNERS = ("u0", "v0", "u1", "v1", "u2", "v2", "u3", "v3")
POSITION = ("x", "y", "z")
QUATERNION = ("qw", "qx", "qy", "qz")
LARGEST_PIXEL = 1e5
SMALLEST_EDGE_PX = 1e-3

CORNER_ROLES = {role: (role,) for role in ("stamp_s", "camera", "marker", *CORNERS, "sigma_px")}
POSE_ROLES = {
    role: (role,)
    for role in (
        *("stamp_s", "marker", *POSITION, *QUATERNION),
        *("sigma_m", "sigma_rot_rad", *COVARIANCE, "ambiguous", "reprojection_px"),
    )
}


def read_corner_sightings(
    path: str | Path,
    *,
    columns: Columns | None = None,
    delimiter: str | None = None,
    camera: str | None = None,
    camera_names: Mapping[str | int, str] | None = None,
) -> CornerSightings:
    """Read marker corners, sorted by stamp; rows of equal stamp keep their order.

    Args:
        path: the table: `stamp_s, camera, marker, u0, v0 .. u3, v3`, pixels, corners in the order of `CornerSightings`;
            without a column `marker` the ids are unknown. A column `sigma_px` is the standard deviation of each of the
            row's eight coordinates, and becomes `covariance_px2` = sigma_px^2 I; NaN in rows where its cell is empty,
            None where all are.
        columns: role -> header name or 0-based index; default: by header.
        delimiter: one character; default: guessed.
        camera: the camera of all rows, for a table without that column.
        camera_names: the file's names of cameras -> the rig's.

    Raises:
        SightingError: with file and line.
    """
    table = read_table(path, delimiter=delimiter, error=SightingError)
    roles = column_roles(table, columns, CORNER_ROLES, ("stamp_s", *CORNERS))
    values = float_columns(table, [roles[role] for role in ("stamp_s", *CORNERS)])
    check_seconds(path, table.line, values[:, 0], SightingError)
    corners_px = values[:, 1:].reshape(-1, 4, 2)
    _check_corners(table, corners_px)
    covariance_px2 = _corner_covariances(table, roles)
    order = np.argsort(values[:, 0], kind="stable")
    return CornerSightings(
        stamp_s=values[order, 0],
        camera=_cameras(table, roles, camera, camera_names)[order],
        marker=_markers(table, roles)[order],
        corners_px=corners_px[order],
        source=row_sources(table)[order],
        covariance_px2=None if covariance_px2 is None else covariance_px2[order],
    )


def read_pose_sightings(
    path: str | Path,
    *,
    columns: Columns | None = None,
    delimiter: str | None = None,
    sigma_m: float | None = None,
    sigma_rot_rad: float | None = None,
    camera: str | None = None,
    rig: Rig | None = None,
) -> Sightings:
    """Read marker poses, sorted by stamp: `stamp_s, marker, x, y, z` and, where known, `qx, qy, qz, qw`.

    The poses are T_body_marker, or T_cam_marker of the named camera. A covariance comes from the file (the upper
    triangle `cov_00 .. cov_55`, in the axes of the poses' frame, or `sigma_m`, `sigma_rot_rad`), else from the
    arguments.

    Args:
        path: the table.
        columns: role -> header name or 0-based index; default: by header.
        delimiter: one character; default: guessed.
        sigma_m: standard deviation of each coordinate, metres.
        sigma_rot_rad: standard deviation about each axis, radians.
        camera: the poses are in this camera of `rig`; default: in the body.
        rig: the rig that holds `camera`.

    Raises:
        SightingError: with file and line.
    """
    table = read_table(path, delimiter=delimiter, error=SightingError)
    roles = column_roles(table, columns, POSE_ROLES, ("stamp_s", *POSITION))
    values = float_columns(table, [roles["stamp_s"], *(roles[axis] for axis in POSITION)])
    check_seconds(path, table.line, values[:, 0], SightingError)
    check_size(path, table.line, values[:, 1:], SightingError)
    quat_wxyz = _quaternions(table, roles)
    covariance = row_covariances(table, roles, ~np.isnan(quat_wxyz[:, 0]), sigma_m, sigma_rot_rad)
    pose = values[:, 1:], quat_wxyz, covariance
    t_m, quat_wxyz, covariance = pose if camera is None else camera_to_body(path, *pose, camera, rig)
    order = np.argsort(values[:, 0], kind="stable")
    return Sightings(
        stamp_s=values[:, 0],
        marker=_markers(table, roles),
        t_body_marker_m=t_m,
        quat_body_marker_wxyz=quat_wxyz,
        covariance=covariance,
        ambiguous=optional_column(table, roles, "ambiguous", 0.0) > 0,
        reprojection_px=optional_column(table, roles, "reprojection_px", np.nan),
        source=row_sources(table),
    ).take(order)


def write_corner_sightings(path: str | Path, sightings: CornerSightings) -> None:
    """Write marker corners as `read_corner_sightings` reads them, all digits.

    Of a covariance the table keeps `sigma_px` alone, the root of the mean of its eight variances.
    """
    numbers, header = sightings.corners_px.reshape(-1, 8), ("stamp_s", "camera", "marker", *CORNERS)
    if sightings.covariance_px2 is not None:
        sigma_px = np.sqrt(np.trace(sightings.covariance_px2, axis1=1, axis2=2) / 8.0)
        numbers, header = np.column_stack([numbers, sigma_px]), (*header, "sigma_px")
    cells = zip(sightings.stamp_s.tolist(), sightings.camera, sightings.marker, numbers.tolist(), strict=True)
    rows = ([repr(stamp), _name(camera), _name(marker), *map(_number, row)] for stamp, camera, marker, row in cells)
    write_lines(path, _comma_lines(header, rows))


def write_pose_sightings(path: str | Path, sightings: Sightings) -> None:
    """Write marker poses T_body_marker with their covariance as `read_pose_sightings` reads them, all digits."""
    i, j = np.triu_indices(6)
    numbers = np.column_stack(
        [
            sightings.t_body_marker_m,
            sightings.quat_body_marker_wxyz,
            sightings.covariance[:, i, j],
            sightings.ambiguous,
            sightings.reprojection_px,
        ]
    ).tolist()
    cells = zip(sightings.stamp_s.tolist(), sightings.marker, numbers, strict=True)
    rows = ([repr(stamp), _name(marker), *map(_number, row)] for stamp, marker, row in cells)
    header = ("stamp_s", "marker", *POSITION, *QUATERNION, *COVARIANCE, "ambiguous", "reprojection_px")
    write_lines(path, _comma_lines(header, rows))


def row_sources(table: TextTable) -> np.ndarray:
    """(n,) "file:line", the file without its folder."""
    name = Path(table.path).name
    return np.array([f"{name}:{line}" for line in table.line.tolist()])


def _check_corners(table: TextTable, corners_px: Float[np.ndarray, "n 4 2"]) -> None:
    far = (np.abs(corners_px) > LARGEST_PIXEL).any(axis=(1, 2))
    if far.any():
        raise SightingError(
            f"{table.place(int(np.argmax(far)))}: a corner lies beyond {LARGEST_PIXEL:g} px; expected pixels. Are the "
            "columns in order?"
        )
    first, second = np.triu_indices(4, k=1)
    repeated = (np.linalg.norm(corners_px[:, first] - corners_px[:, second], axis=2) < SMALLEST_EDGE_PX).any(axis=1)
    if repeated.any():
        raise SightingError(
            f"{table.place(int(np.argmax(repeated)))}: two of the four corners coincide; expected four different "
            "corners. Remove the row, or check the columns."
        )
    edge = np.roll(corners_px, -1, axis=1) - corners_px
    after = np.roll(edge, -1, axis=1)
    left_turns = (edge[..., 0] * after[..., 1] - edge[..., 1] * after[..., 0] > 0).sum(axis=1)
    crossed = left_turns == 2  # a quadrilateral that crosses itself turns twice each way
    if crossed.any():
        raise SightingError(
            f"{table.place(int(np.argmax(crossed)))}: the outline of the four corners crosses itself; expected the "
            "corners in order round the marker. Check the columns."
        )


def _corner_covariances(table: TextTable, roles: Mapping[str, int]) -> Float[np.ndarray, "n 8 8"] | None:
    sigma_px = optional_column(table, roles, "sigma_px", np.nan)
    bad = ~np.isnan(sigma_px) & ~((sigma_px > 0.0) & (sigma_px <= LARGEST_PIXEL))
    if bad.any():
        row = int(np.argmax(bad))
        raise SightingError(
            f"{table.place(row)}: sigma_px is {sigma_px[row]:g}; expected the standard deviation of the corners, above "
            f"zero and at most {LARGEST_PIXEL:g}, in pixels, or an empty cell where it is not known."
        )
    return None if np.isnan(sigma_px).all() else sigma_px[:, None, None] ** 2 * np.eye(8)


def _cameras(
    table: TextTable, roles: Mapping[str, int], camera: str | None, names: Mapping[str | int, str] | None
) -> np.ndarray:
    if ("camera" in roles) == (camera is not None):
        problem = "names no camera column, and `camera` is not given" if camera is None else "has a camera column"
        raise SightingError(f"{table.path}: the table {problem}; expected either the column or `camera`, not both.")
    if camera is not None:
        return np.full(len(table), camera)
    found = text_column(table, roles["camera"])
    if names is None:
        return np.array(found)
    rig_name = {str(name): name_in_rig for name, name_in_rig in names.items()}
    for row, name in enumerate(found):
        if name not in rig_name:
            raise SightingError(
                f"{table.place(row)}: camera {name!r} is not in `camera_names`, which has {', '.join(rig_name)}."
            )
    return np.array([rig_name[name] for name in found])


def _markers(table: TextTable, roles: Mapping[str, int]) -> np.ndarray:
    return np.array(text_column(table, roles["marker"])) if "marker" in roles else np.full(len(table), "")


def _quaternions(table: TextTable, roles: Mapping[str, int]) -> Float[np.ndarray, "n 4"]:
    given = [role for role in QUATERNION if role in roles]
    if not given:
        return np.full((len(table), 4), np.nan)
    if len(given) < 4:
        raise SightingError(
            f"{table.path}: of the quaternion only {', '.join(given)}; expected qx, qy, qz, qw or none."
        )
    quat_wxyz = float_columns(table, [roles[role] for role in QUATERNION], blank_is_nan=True)
    known = ~np.isnan(quat_wxyz)
    half = known.any(axis=1) & ~known.all(axis=1)
    if half.any():
        raise SightingError(
            f"{table.place(int(np.argmax(half)))}: the quaternion is given in part; expected all or none."
        )
    return unit_quaternions(table.path, table.line, quat_wxyz, SightingError)


def _comma_lines(header: Iterable[str], rows: Iterable[list[str]]) -> Iterable[str]:
    yield ",".join(header)
    for row in rows:
        yield ",".join(row)


def _number(value: float) -> str:
    return "" if np.isnan(value) else repr(value)


def _name(name: str) -> str:
    name = str(name)  # NumPy's own str prints its type
    if any(mark in name for mark in ',;\t\n\r"') or name != name.strip():
        raise SightingError(
            f"name {name!r} cannot be written to a comma-separated file; remove its separators and blanks."
        )
    return name
