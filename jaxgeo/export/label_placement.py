"""Where to put the labels of points in a map, so that they hide as little as possible."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

FONT_PT = 9.5
# Directions tried, best first: a cartographer's habit, upper right before all others.
DIRECTIONS = np.array([(1, 1), (1, -1), (-1, 1), (-1, -1), (1, 0), (-1, 0), (0, 1), (0, -1)], dtype=float)


def label_points(
    axes: Axes,
    text: list[str],
    point: Float[np.ndarray, "k 2"],
    obstacle: Float[np.ndarray, "m 2"],
) -> None:
    """Write a label beside every point, away from the obstacles and from each other; axes limits must be final."""
    point_pt = points_from_data(axes, point)
    obstacle_pt = np.concatenate([points_from_data(axes, obstacle), point_pt])
    box = (np.zeros((0, 2)), np.zeros((0, 2)))
    low_pt, high_pt = axes_box_pt(axes)
    for j, label in enumerate(text):
        label = short(label)
        size = np.array([0.64 * FONT_PT * len(label) + 3.0, 1.3 * FONT_PT])
        best_cost, best_centre, best_ring = np.inf, point_pt[j], 0
        for ring, reach in enumerate((5.0, 14.0, 26.0)):
            centre = point_pt[j] + DIRECTIONS * (reach + size / 2.0)
            cost = crowding(centre, size, obstacle_pt, box) + 0.4 * ring + 1e-3 * np.arange(len(DIRECTIONS))
            outside = ((centre - size / 2 < low_pt) | (centre + size / 2 > high_pt)).any(axis=1)
            cost = cost + 1e3 * outside
            i = int(np.argmin(cost))
            if cost[i] < best_cost:
                best_cost, best_centre, best_ring = float(cost[i]), centre[i], ring
        box = (np.vstack([box[0], best_centre - size / 2]), np.vstack([box[1], best_centre + size / 2]))
        offset = best_centre - point_pt[j]
        leader = {"arrowstyle": "-", "color": "#888888", "linewidth": 0.6, "shrinkA": 0, "shrinkB": 3}
        axes.annotate(
            label,
            point[j],
            xytext=tuple(offset),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=FONT_PT,
            fontweight="bold",
            zorder=9,
            bbox={"boxstyle": "round,pad=0.12", "facecolor": "white", "edgecolor": "none", "alpha": 0.75},
            arrowprops=leader if best_ring > 0 else None,
        )


def short(label: str, most: int = 18) -> str:
    """The label, cut where it would be too long for a figure."""
    return label if len(label) <= most else f"{label[: most - 1]}…"


def crowding(centre: np.ndarray, size: np.ndarray, obstacle: np.ndarray, box: tuple[np.ndarray, np.ndarray]):
    """How much a label of this size hides at each centre: obstacle points under it, and labels it would overlap."""
    low, high = centre - size / 2.0, centre + size / 2.0
    points = ((obstacle > low[:, None]) & (obstacle < high[:, None])).all(axis=2).sum(axis=1)
    labels = ((box[0] < high[:, None]) & (box[1] > low[:, None])).all(axis=2).sum(axis=1)
    return points + 30.0 * labels


def points_from_data(axes: Axes, xy: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, "m 2"]:
    """Data coordinates to printer's points in the figure."""
    return axes.transData.transform(xy) * 72.0 / axes.figure.dpi


def axes_box_pt(axes: Axes) -> tuple[np.ndarray, np.ndarray]:
    corners = axes.transAxes.transform([(0.0, 0.0), (1.0, 1.0)]) * 72.0 / axes.figure.dpi
    return corners[0], corners[1]
