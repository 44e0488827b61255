"""The corrected trajectory as text: TUM in the local frame, and a table in the grid with its covariance."""

import numpy as np
from jaxtyping import Float

from jaxgeo.export.csv_text import csv_text, heading, one_line
from jaxgeo.export.result import SessionResult

TUM_COLUMNS = "stamp_s x_m y_m z_m qx qy qz qw"
GRID_COLUMNS = (
    *("stamp_s", "E_m", "N_m", "h_m", "qw", "qx", "qy", "qz"),
    *("cov_EE_m2", "cov_EN_m2", "cov_Eh_m2", "cov_NN_m2", "cov_Nh_m2", "cov_hh_m2"),
    *("sigma_rE_rad", "sigma_rN_rad", "sigma_rh_rad"),
)


def tum_text(result: SessionResult, name: str) -> str:
    """`stamp x y z qx qy qz qw` a line, local frame, metres; every digit kept, so that it reads back the same."""
    trajectory = result.trajectories[name].corrected
    table = np.column_stack([trajectory.stamp_s, trajectory.position_m, trajectory.quat_wxyz[:, [1, 2, 3, 0]]])
    comments = [*heading(result, f"corrected trajectory '{name}': body poses in the local frame"), TUM_COLUMNS]
    lines = [f"# {one_line(c)}" for c in comments] + [" ".join(map(repr, row)) for row in table.tolist()]
    return "\n".join(lines) + "\n"


def grid_text(result: SessionResult, name: str) -> str:
    """The poses in the grid: E, N, h, body-to-grid quaternion, position covariance and rotation sigmas."""
    trajectory = result.trajectories[name].corrected
    table = np.column_stack(
        [
            trajectory.stamp_s,
            result.frame.to_grid(trajectory.position_m),
            trajectory.quat_wxyz,
            covariance_columns(result.trajectories[name].covariance),
        ]
    )
    comments = [
        *heading(result, f"corrected trajectory '{name}': body poses in the grid"),
        "E, N, h in metres; qw qx qy qz turns body axes into grid axes (E, N, h)",
        "cov_*: covariance of the position, m^2; sigma_r*: standard deviation of the rotation about a grid axis, rad",
    ]
    return csv_text(comments, GRID_COLUMNS, table.tolist())


def covariance_columns(covariance: Float[np.ndarray, "n 6 6"]) -> Float[np.ndarray, "n 9"]:
    """Upper triangle of the position block, row by row, then the three rotation sigmas."""
    row, column = np.triu_indices(3)
    sigma_rot_rad = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)[:, 3:])
    return np.column_stack([covariance[:, row, column], sigma_rot_rad])
