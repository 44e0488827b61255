"""A made-up plan on the layout of the reference study: right in shape and size, searched by nobody."""

import dataclasses
import math

import numpy as np

from eval.placement.answer import PlacementAnswer, PlannedLayout, PlannedVisit, Sensitivity, WhatIf
from eval.placement.planned import PlacementInput
from eval.placement_report.report import PlacementReport
from jaxgeo.georef import LocalFrame
from jaxgeo.graph.components import COMPONENTS
from jaxgeo.io.waypoints_csv import followed

ORIGIN_ENH_M = np.array([79300.0, 76800.0, 300.0])
CORNER_M = np.array([[0.0, 0.0, 40.0], [60.0, 10.0, 40.5], [55.0, 45.0, 41.0], [5.0, 40.0, 40.2], [0.0, 2.0, 40.0]])
PATH = followed(CORNER_M, 1.2)
WAY_M = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(PATH.position_m, axis=0), axis=1))])
WATCHED = 64


def layout(method: str, share: np.ndarray, size_m: float, standing: int = 0) -> PlannedLayout:
    """Anchors at these shares of the way, two metres aside; errors grow with the distance to the nearest."""
    rows = np.searchsorted(WAY_M, share * WAY_M[-1]).clip(0, len(PATH) - 1)
    point_m = PATH.position_m[rows] + [1.5, -1.3, 0.0]
    at_m = np.linspace(0.0, WAY_M[-1], WATCHED)
    away = np.abs(at_m[:, None] - WAY_M[rows][None]).min(axis=1) / WAY_M[-1]
    sigma_m = size_m * (0.6 + 4.0 * away)
    shape = np.array([[1.0, 0.3, 0.0], [0.3, 0.6, 0.0], [0.0, 0.0, 0.25]]) / 1.85
    covariance = sigma_m[:, None, None] ** 2 * shape
    path_m = float(np.sqrt(np.mean(sigma_m**2)))
    accuracy = {"path": path_m, "worst": float(sigma_m.max()), "D": 0.4 * path_m, "E": 0.8 * float(sigma_m.max())}
    name = tuple(f"P{i + 1}" for i in range(len(share) - standing)) + tuple(f"S{i + 1}" for i in range(standing))
    visits = [PlannedVisit(n, float(WAY_M[r]), 1.0) for n, r in zip(name, rows, strict=True)]
    visits.append(PlannedVisit(name[0], float(WAY_M[-1]), 0.8))
    stands = (False,) * (len(share) - standing) + (True,) * standing
    return PlannedLayout(method, name, stands, point_m, accuracy, covariance, tuple(visits), 1.5)


def answer(count: int = 4, standing: int = 1, methods: tuple[str, ...] | None = None) -> PlacementAnswer:
    """Layouts of `count` anchors and some that stand; `methods` best first."""
    k = count + standing
    share = np.concatenate([(np.arange(count) + 0.3) / count, np.full(standing, 0.02)])
    methods = methods or ("gradient", "exhaustive", "greedy", "equal spacing")
    layouts = tuple(
        layout(method, (share + 0.01 * i) % 1.0, 0.03 * (1.0 + 0.04 * i), standing) for i, method in enumerate(methods)
    )
    base = layouts[0].accuracy_m["path"]
    rows = np.searchsorted(WAY_M, np.linspace(0.0, WAY_M[-1], WATCHED)).clip(0, len(PATH) - 1)
    what_if = (
        WhatIf("one more", "", np.array([20.0, 41.0, 40.5]), 0.0, 0.93 * base),
        WhatIf("one lost", "P1", None, 0.0, 1.4 * base),
        WhatIf("one lost", "P2", None, 0.0, math.inf),
        WhatIf("revisit", "P3", None, 34.0, 0.8 * base),
        WhatIf("better survey", "", None, 0.0, 0.9 * base),
        WhatIf("longer dwell", "", None, 0.0, 0.998 * base),
    )
    noise = {"trans_x_m_per_sqrt_m": 0.2, "rot_z_rad_per_sqrt_m": 0.35, "log_scale": 0.05}
    sensitivity = Sensitivity(0.25, 0.15, noise, np.linspace(-0.02, 0.02, 2 * k).reshape(k, 2))
    return PlacementAnswer(
        criterion="path",
        distance_m=np.linspace(0.0, WAY_M[-1], WATCHED),
        position_m=PATH.position_m[rows],
        layouts=layouts,
        what_if=what_if,
        sensitivity=sensitivity,
        starts=64 if "gradient" in methods else 0,
        starts_near_best=12 if "gradient" in methods else 0,
    )


def report(*answers: PlacementAnswer, crs: str = "EPSG:2169", **changes) -> PlacementReport:
    """A plan, `predicted` where its layout is given."""
    answers = answers or (answer(),)
    frame = LocalFrame.create(crs, ORIGIN_ENH_M)
    area = np.array([[-5.0, -5.0], [70.0, -5.0], [70.0, 52.0], [-5.0, 52.0]])
    given = PlacementInput((4,), 8.0, 0.02, (0.01, 0.01, 0.015), 16.0, 4.0, areas_en_m=(area,))
    sigma = dict.fromkeys(COMPONENTS, 0.0) | {"trans_x_m_per_sqrt_m": 0.02, "rot_z_rad_per_sqrt_m": 0.001}
    noise = {"odometry": "lidar", "file": None, "session": None, "trajectory": None, "sets": 1}
    made = PlacementReport(
        name="site_plan",
        simulated=False,
        frame=frame,
        path=PATH,
        path_said="waypoints path.csv",
        noise=noise | {"sigma_median": sigma, "correlation_m": 1.0},
        given=given,
        answers=answers,
        predicted=answers[0].chosen.method == "given",
        config={"name": "site_plan", "crs": crs},
        run={"seed": 0, "versions": {"jaxgeo": "0.1.0"}, "timing_s": {"total": 3.2}},
    )
    return dataclasses.replace(made, **changes)
