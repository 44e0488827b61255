"""The picture of a marker map: plan and side view along the map's principal axes, and the residuals."""

from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from jaxgeo.export.figure_style import COLOUR, WIDTH_IN, figure_style
from jaxgeo.solve.marker_map import MarkerMap

_AXES = "xyz"


def marker_map_figure(found: MarkerMap, side_m: float) -> Figure:
    """Plan over the two wide axes of the map frame, elevation over the widest and the narrow one, residuals."""
    with figure_style():
        points = np.concatenate([found.position_m, found.image_position_m])
        narrow = int(np.argmin(np.ptp(points, axis=0)))
        right, up = (
            (narrow + 1) % 3,
            (narrow + 2) % 3,
        )  # seen from the narrow axis' positive side: above, where it is up
        widest = right if np.ptp(points[:, right]) >= np.ptp(points[:, up]) else up
        figure = Figure(figsize=(WIDTH_IN, WIDTH_IN), layout="constrained")
        grid = figure.add_gridspec(2, 2, height_ratios=(2.0, 1.0))
        plan = figure.add_subplot(grid[0, :])
        _view(plan, found, side_m, right, up)
        plan.set_title(
            f"{len(found.marker)} markers, {len(found.stamp_s)} images; frame: marker {found.origin}; "
            f"median residual {np.median(found.corner_error_px):.2f} px"
        )
        _view(figure.add_subplot(grid[1, 0]), found, side_m, widest, narrow, named=False)
        _residuals(figure.add_subplot(grid[1, 1]), found)
    return figure


def save_png(figure: Figure, path: Path) -> None:
    """Write the figure as PNG, 150 dots an inch."""
    with figure_style():
        figure.set_dpi(150)
        FigureCanvasAgg(figure).print_png(str(path), metadata={"Software": None})


def _view(axes: Axes, found: MarkerMap, side_m: float, right: int, up: int, named: bool = True) -> None:
    camera = found.image_position_m
    axes.plot(camera[:, right], camera[:, up], color=COLOUR["unused"], linewidth=0.6, alpha=0.5)
    axes.plot(
        camera[:, right], camera[:, up], "o", markersize=3, color=COLOUR["fixed"], label="body at the images, in order"
    )
    R = Rotation.from_quat(found.quat_wxyz, scalar_first=True).as_matrix()
    reach = max(1.5 * side_m, 0.05 * float(np.ptp(found.position_m, axis=0).max()))
    outline = side_m * np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0], [-0.5, -0.5, 0]])
    for m, name in enumerate(found.marker):
        centre, normal = found.position_m[m], R[m, :, 2]
        square = outline @ R[m].T + centre
        axes.plot(square[:, right], square[:, up], color=COLOUR["anchor"], linewidth=2.0)
        tip = centre + reach * normal
        axes.plot([centre[right], tip[right]], [centre[up], tip[up]], color=COLOUR["learned"], linewidth=1.2)
        if named:
            place = centre - 0.6 * reach * _in_view(normal, right, up)
            axes.text(place[right], place[up], str(name), ha="center", va="center", fontsize=9)
    axes.plot([], [], color=COLOUR["anchor"], linewidth=2.0, label="marker")
    axes.plot([], [], color=COLOUR["learned"], linewidth=1.2, label="its normal")
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.08)
    axes.set_xlabel(f"{_AXES[right]} [m]")
    axes.set_ylabel(f"{_AXES[up]} [m]")
    if named:
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncol=3)


def _in_view(normal: Float[np.ndarray, "3"], right: int, up: int) -> Float[np.ndarray, "3"]:
    """The normal as the view shows it, made one long; straight up where it points at the reader."""
    flat = np.zeros(3)
    flat[[right, up]] = normal[[right, up]]
    length = float(np.linalg.norm(flat))
    if length < 0.2:
        flat[[right, up]] = [0.0, -1.0]
        return flat
    return flat / length


def _residuals(axes: Axes, found: MarkerMap) -> None:
    """Observed minus predicted of every corner: a round cloud is noise, a pattern is the lens."""
    off = -found.residual_px.reshape(-1, 2)
    axes.plot(off[:, 0], off[:, 1], ".", markersize=2.5, color=COLOUR["fixed"])
    limit = 1.1 * float(np.quantile(np.abs(off), 0.995))
    outside = int(np.count_nonzero(np.any(np.abs(off) > limit, axis=1)))
    axes.set_xlim(-limit, limit)
    axes.set_ylim(limit, -limit)
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel("residual u [px]")
    axes.set_ylabel("residual v [px]")
    axes.set_title("corners, observed minus predicted" + (f"; {outside} outside" if outside else ""))
