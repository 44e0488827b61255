"""EuRoC trajectories: comma-separated, stamps in nanoseconds, quaternions with w first."""

from decimal import Decimal
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jaxgeo.data import Trajectory
from jaxgeo.errors import TrajectoryError
from jaxgeo.io.atomic import write_lines
from jaxgeo.io.checks import validated_trajectory
from jaxgeo.io.frames.stamps import number_of, seconds
from jaxgeo.io.text_table import float_columns, read_table, text_column

HEADER = "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []"
SHORTEST_STEP_NS = 1000.0  # successive poses nearer in time than this: the stamps are not nanoseconds


def read_euroc(path: str | Path) -> Trajectory:
    """Read a EuRoC ground-truth table; columns after the eighth (velocity, biases) are not read.

    Stamps become the float64 seconds nearest to the decimal digits in the file.

    Raises:
        TrajectoryError: with file and line, as in `validated_trajectory`, or for a wrong number of columns.
    """
    table = read_table(path, error=TrajectoryError)
    if table.n_columns not in (8, 17):
        raise TrajectoryError(
            f"{table.place(0)}: {table.n_columns} columns, expected the 8 (or 17) of a EuRoC table: stamp in ns, x, "
            "y, z, qw, qx, qy, qz, separated by commas."
        )
    values = float_columns(table, range(8))
    # Parsed as decimals: at 1.4e18 a float64 nanosecond count is already off by up to 128 ns.
    numbers = [number_of(text) for text in text_column(table, 0)]
    if None in numbers:
        row = numbers.index(None)
        raise TrajectoryError(
            f"{table.place(row)}: stamp {text_column(table, 0)[row][:40]!r}, expected nanoseconds. Mend the row."
        )
    stamp_s = np.array([seconds(number, "ns") for number in numbers if number is not None])
    step_ns = np.diff(values[:, 0])
    if len(step_ns) and 0 < np.median(step_ns) < SHORTEST_STEP_NS:
        raise TrajectoryError(
            f"{table.place(0)}: successive stamps differ by {np.median(step_ns):g}, expected nanoseconds. Are they "
            "seconds? Multiply them by 1e9, or use format tum."
        )
    return validated_trajectory(path, table.line, stamp_s, values[:, 1:4], values[:, 4:8])


def write_euroc(path: str | Path, trajectory: Trajectory) -> None:
    """Write the 8-column EuRoC table, all digits; stamps are whole nanoseconds unless float64 holds more."""
    rows: Float[np.ndarray, "n 7"] = np.column_stack([trajectory.position_m, trajectory.quat_wxyz])
    stamps = (format(Decimal(repr(stamp)).scaleb(9).normalize(), "f") for stamp in trajectory.stamp_s.tolist())
    body = (f"{stamp},{','.join(map(repr, row))}" for stamp, row in zip(stamps, rows.tolist(), strict=True))
    write_lines(path, [HEADER, *body])
