"""Covariances of marker poses as tables give them, and their change from camera to body axes."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from jaxgeo.data import Rig
from jaxgeo.errors import SightingError
from jaxgeo.io.checks import LARGEST_POSITION_M
from jaxgeo.io.text_table import TextTable, float_columns

COVARIANCE = tuple(f"cov_{i}{j}" for i in range(6) for j in range(i, 6))


def optional_column(table: TextTable, roles: Mapping[str, int], role: str, default: float) -> Float[np.ndarray, "n"]:
    """A column of numbers with empty cells as NaN; `default` where the table has no such column."""
    if role not in roles:
        return np.full(len(table), default)
    return float_columns(table, [roles[role]], blank_is_nan=True)[:, 0]


def row_covariances(
    table: TextTable,
    roles: Mapping[str, int],
    rotated: Bool[np.ndarray, "n"],
    sigma_m: float | None,
    sigma_rot_rad: float | None,
) -> Float[np.ndarray, "n 6 6"]:
    """(n, 6, 6) covariances of the rows: from `cov_*` columns, else from sigma columns, else from the arguments.

    Args:
        table: the table.
        roles: index of the column in each role.
        rotated: (n,) whether a rotation is known; where not, its rows and columns are zero.
        sigma_m, sigma_rot_rad: where the table has none.

    Raises:
        SightingError: a sigma is missing or not positive, or a covariance is not one.
    """
    given = [role for role in COVARIANCE if role in roles]
    if given and len(given) < len(COVARIANCE):
        raise SightingError(f"{table.path}: {len(given)} of the 21 columns cov_00 .. cov_55; expected all or none.")
    if given:
        return _file_covariance(table, roles, rotated)
    blocks = [("sigma_m", sigma_m, np.ones(len(table), bool)), ("sigma_rot_rad", sigma_rot_rad, rotated)]
    covariance = np.zeros((len(table), 6, 6))
    for block, (role, default, needed) in enumerate(blocks):
        sigma = optional_column(table, roles, role, np.nan)
        sigma = np.where(np.isnan(sigma) & (default is not None), np.nan if default is None else default, sigma)
        bad = needed & ~((sigma > 0) & (sigma <= LARGEST_POSITION_M))
        if bad.any():
            row = int(np.argmax(bad))
            value = "is missing" if np.isnan(sigma[row]) else f"is {sigma[row]:g}"
            mend = "" if role == "sigma_m" else ", or leave the quaternion columns out"
            raise SightingError(
                f"{table.place(row)}: {role} {value}; expected a positive number, at most {LARGEST_POSITION_M:g}, as "
                f"an argument or a column{mend}."
            )
        diagonal = np.arange(3 * block, 3 * block + 3)
        covariance[:, diagonal, diagonal] = np.where(needed, sigma, 0.0)[:, None] ** 2
    return covariance


def _file_covariance(
    table: TextTable, roles: Mapping[str, int], rotated: Bool[np.ndarray, "n"]
) -> Float[np.ndarray, "n 6 6"]:
    upper = float_columns(table, [roles[role] for role in COVARIANCE])
    covariance = np.zeros((len(table), 6, 6))
    i, j = np.triu_indices(6)
    covariance[:, i, j] = upper
    covariance[:, j, i] = upper
    covariance[~rotated, 3:] = 0.0
    covariance[~rotated, :, 3:] = 0.0
    used = np.ones((len(table), 6), bool)
    used[~rotated, 3:] = False
    eigenvalues = np.linalg.eigvalsh(covariance)
    positive = (np.diagonal(covariance, axis1=1, axis2=2) > 0) == used
    positive = positive.all(axis=1) & (eigenvalues[:, 0] > -1e-12 * eigenvalues[:, -1])
    if not positive.all():
        row = int(np.argmin(positive))
        raise SightingError(
            f"{table.place(row)}: the covariance is not positive definite; expected variances above 0 and correlations "
            "within -1 and 1."
        )
    return covariance


def camera_to_body(
    path: str | Path,
    t_m: Float[np.ndarray, "n 3"],
    quat_wxyz: Float[np.ndarray, "n 4"],
    covariance: Float[np.ndarray, "n 6 6"],
    camera: str,
    rig: Rig | None,
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 4"], Float[np.ndarray, "n 6 6"]]:
    """T_body_marker = T_body_cam T_cam_marker; the covariance turns with the axes."""
    if rig is None or camera not in rig.cameras:
        held = "no rig is given" if rig is None else f"the rig has {', '.join(rig.cameras)}"
        raise SightingError(f"{path}: the poses are in camera {camera!r}, but {held}. Name a camera of the rig.")
    rotation = Rotation.from_quat(rig.cameras[camera].quat_body_cam_wxyz, scalar_first=True)
    turned = np.full_like(quat_wxyz, np.nan)
    known = ~np.isnan(quat_wxyz[:, 0])
    if known.any():
        turned[known] = (rotation * Rotation.from_quat(quat_wxyz[known], scalar_first=True)).as_quat(scalar_first=True)
    both = np.kron(np.eye(2), rotation.as_matrix())
    return rotation.apply(t_m) + rig.cameras[camera].t_body_cam_m, turned, both @ covariance @ both.T
