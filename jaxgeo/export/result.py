"""What one run found, as plain data: the only thing that the writers, the tables and the report read."""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxgeo.data import Anchors, Trajectory
from jaxgeo.io.orthophoto import Orthophoto


@dataclasses.dataclass(frozen=True)
class CoarseFit:
    """The one-time similarity map -> local grid frame: `x_grid = scale R x_map + t`."""

    scale: float
    rotation: Float[np.ndarray, "3 3"]
    translation_m: Float[np.ndarray, "3"]
    rms_m: float


@dataclasses.dataclass(frozen=True)
class HeldOut:
    """Leave-one-location-out errors of one stage (`coarse`, `fixed` or `learned`).

    Attributes:
        error_enh_m: (k, 3) predicted minus surveyed marker position of every visit in the fold that held its location
            out; NaN where the fold failed or does not exist.
        covariance_m2: (k, 3, 3) predicted covariance of that error, survey and sighting included; NaN for `coarse`.
        result: (k) the solver's result code of that fold, in words.
    """

    error_enh_m: Float[np.ndarray, "k 3"]
    covariance_m2: Float[np.ndarray, "k 3 3"]
    result: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class ReferenceError:
    """Absolute trajectory error of one stage against a reference trajectory.

    `aligned`: after one fit of the whole estimate to a reference that has a frame of its own; else in the grid itself.
    """

    ate_rmse_m: float
    ate_median_m: float
    n_poses: int
    error_m: Float[np.ndarray, "m"]
    stamp_s: Float[np.ndarray, "m"]
    aligned: bool = True


@dataclasses.dataclass(frozen=True)
class DriftGrowth:
    """How far odometry alone, started without error at the first anchor, drifts in position (length in space).

    Attributes:
        distance_m: (p,) from the first anchor, along the odometry's path.
        fixed_m: (p,) one sigma that the fixed noise predicts.
        learned_m: (p,) that the learned noise predicts; `learned_band_m` (2, p) ends of its 95 % range over the noise
            values that the data leave possible. None where nothing was learned.
        observed_distance_m, observed_m: (k,) of every anchor: its misclosure after the one-time similarity, less the
            first anchor's.
    """

    distance_m: Float[np.ndarray, "p"]
    fixed_m: Float[np.ndarray, "p"]
    learned_m: Float[np.ndarray, "p"] | None
    learned_band_m: Float[np.ndarray, "2 p"] | None
    observed_distance_m: Float[np.ndarray, "k"]
    observed_m: Float[np.ndarray, "k"]


@dataclasses.dataclass(frozen=True)
class TrajectoryResult:
    """One trajectory, corrected.

    Attributes:
        name: its name in the config.
        measured: as read, in its own map frame.
        coarse: the one-time similarity, and `coarse_trajectory` the poses after it, local grid frame.
        corrected: poses after the pose graph, local grid frame (E, N, h minus the origin).
        covariance: (n, 6, 6) of `corrected`, grid axes: position error added, rotation error multiplied on the left.
        anchors: the visits used.
        residual_coarse_m, residual_refined_m: (k, 3) predicted minus surveyed, all anchors in.
        held_out: by stage.
        revisit: by location with two or more visits, the largest distance between two visits' predicted positions:
            {"coarse_m": .., "refined_m": .., "held_out_m": ..}. `coarse_m` and `refined_m` are with all anchors in, so
            that the graph itself pulls the visits together (the figure that studies report); `held_out_m` is of
            the fold that held the location out: the honest one. It is missing where nothing was held out, NaN where
            the fold failed.
        reference: by stage, empty where no reference was given.
        noise: noise values used, by stage, as written to noise.json: `fixed`, and `learned` where the written
            trajectory was corrected with it.
        log_scale: estimated log-scale of the odometry and its standard deviation (0, 0 where it is not estimated).
        solver: {"result": str, "steps": int, "cost": float}.
        timing_s: seconds by phase.
        warnings: sentences for the user.
        drift_growth: predicted and observed drift of the odometry alone.
        corrections: of clock, lever arm and camera rotation, where they were asked for: whether they were `applied`
            (then `anchors` have them), `rows`, and `sentences` that say so.
        check: of wrong anchors, where it was made: whether there is a `fault`, `sentences`, and what would `mend` it.
    """

    name: str
    measured: Trajectory
    coarse: CoarseFit
    coarse_trajectory: Trajectory
    corrected: Trajectory
    covariance: Float[np.ndarray, "n 6 6"]
    anchors: Anchors
    residual_coarse_m: Float[np.ndarray, "k 3"]
    residual_refined_m: Float[np.ndarray, "k 3"]
    held_out: dict[str, HeldOut]
    revisit: dict[str, dict[str, float]]
    reference: dict[str, ReferenceError]
    noise: dict[str, Any]
    log_scale: tuple[float, float]
    solver: dict[str, Any]
    timing_s: dict[str, float]
    warnings: tuple[str, ...] = ()
    drift_growth: DriftGrowth | None = None
    corrections: dict[str, Any] | None = None
    check: dict[str, Any] | None = None


@dataclasses.dataclass(frozen=True)
class SessionResult:
    """One session: every trajectory of one config.

    Attributes:
        name: the session's name.
        frame: the `jaxgeo.georef.LocalFrame` of all coordinates.
        survey_enh_m: {location: (3,)} local frame, of every surveyed point that the session used or could use.
        trajectories: by name.
        config: the resolved config, JSON-ready.
        run: versions, input hashes, seeds, timings, JSON-ready.
        simulated: True where the data were simulated: every output says so.
        basemap: the orthophoto of the site, drawn under the maps; None: there is none.
    """

    name: str
    frame: Any
    survey_enh_m: dict[str, Float[np.ndarray, "3"]]
    trajectories: dict[str, TrajectoryResult]
    config: dict[str, Any]
    run: dict[str, Any]
    simulated: bool = False
    basemap: Orthophoto | None = None
