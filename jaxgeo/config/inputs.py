"""The inputs of a session: trajectories, survey, rig and sightings, as a config names them."""

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from jaxgeo.config.fields import (
    Columns,
    FileName,
    InputFile,
    MarkerSizes,
    Name,
    NonNegative,
    NonNegativePerAxis,
    Positive,
    PositivePerAxis,
    Section,
    Vector,
)
from jaxgeo.config.images import ImagesSightingsInput

Delimiter = Literal[",", ";", "\t", " "]
Format = Literal[
    "tum",
    "kitti",
    "euroc",
    "g2o",
    "npy",
    "tum-index",
    "rtabmap",
    "rtabmap-raw",
    "rtabmap-rgbd-slam",
    "rtabmap-kitti",
    "rtabmap-toro",
    "rtabmap-g2o",
    "rtabmap-tum",
]
STAMPED = ("tum", "euroc", "rtabmap-rgbd-slam", "rtabmap-tum")
Row = Annotated[int, Field(ge=0)]
Odometry = Literal["lidar", "vio", "wheel", "mono"]


class NoiseValues(Section):
    """Single noise values that replace the defaults; None leaves the default. One number stands for three equal axes.

    Attributes:
        sigma_trans_m_per_sqrt_m, sigma_rot_rad_per_sqrt_m: white noise by distance, body axes.
        sigma_turn_rad_per_sqrt_rad: white rotation noise by turned angle.
        sigma_log_scale: prior of the odometry's log-scale, 0 for metric odometry.
        sigma_bias_trans_m_per_m, sigma_bias_rot_rad_per_m: prior of the constant bias, 0 for none.
    """

    sigma_trans_m_per_sqrt_m: PositivePerAxis | None = None
    sigma_rot_rad_per_sqrt_m: PositivePerAxis | None = None
    sigma_turn_rad_per_sqrt_rad: NonNegative | None = None
    sigma_log_scale: NonNegative | None = None
    sigma_bias_trans_m_per_m: NonNegativePerAxis | None = None
    sigma_bias_rot_rad_per_m: NonNegativePerAxis | None = None


class TrajectoryFile(Section):
    """Poses in a file. Formats without stamps need `times` (a file of seconds) or `rate_hz`.

    `optical_axes`: the map's axes are a camera's (x right, y down, z forward), as KITTI's are: E = x, N = z, h = -y.
    """

    file: InputFile = Field(description="the file of poses")
    format: Format = Field(description="tum, kitti, euroc, g2o, npy, tum-index, rtabmap or rtabmap-FLAVOUR")
    times: InputFile | None = None
    rate_hz: Positive | None = None
    optical_axes: bool = False

    @model_validator(mode="after")
    def _check_stamps(self):
        given = [key for key in ("times", "rate_hz") if getattr(self, key) is not None]
        if self.format not in (*STAMPED, "rtabmap") and len(given) != 1:
            both = "has both" if given else "has neither"
            raise ValueError(
                f"format {self.format!r} has no stamps: give exactly one of 'times' and 'rate_hz' ({both})"
            )
        if self.format in STAMPED and given:
            raise ValueError(f"format {self.format!r} has its own stamps: remove {given[0]!r}")
        return self


class Reference(TrajectoryFile):
    """A reference trajectory to measure against; where its body frame sits in the trajectory's body frame.

    Attributes:
        frame: `grid`: the survey's coordinates; `local`: these minus the session's origin; `own`: a frame of its own,
            to which the estimate is first fitted (rigidly, all poses).
    """

    frame: Literal["own", "grid", "local"] = "own"
    t_body_reference_m: Vector = (0.0, 0.0, 0.0)
    rotvec_body_reference_rad: Vector = (0.0, 0.0, 0.0)


class TrajectoryInput(TrajectoryFile):
    """A trajectory to be georeferenced, from a file."""

    odometry: Odometry = Field(description="lidar, vio, wheel or mono: it chooses the default noise")
    noise: NoiseValues = NoiseValues()
    reference: Reference | None = None


class ComputedTrajectoryInput(Section):
    """A trajectory to be georeferenced that this run makes itself.

    Attributes:
        computed: `odometry`: from the session's scans alone; `mapping`: loop-closed, along another trajectory.
        of: that other trajectory, where there are several; of mapping only.
    """

    computed: Literal["odometry", "mapping"]
    of: FileName | None = None
    odometry: Odometry = "lidar"
    noise: NoiseValues = NoiseValues()
    reference: Reference | None = None

    @model_validator(mode="after")
    def _check_of(self):
        if self.computed == "odometry" and self.of is not None:
            raise ValueError("'of' names the trajectory that mapping goes along; odometry has none: remove it")
        return self


def _trajectory_kind(value: Any) -> str:
    computed = "computed" in value if isinstance(value, dict) else isinstance(value, ComputedTrajectoryInput)
    return "computed" if computed else "file"


AnyTrajectoryInput = Annotated[
    Annotated[TrajectoryInput, Tag("file")] | Annotated[ComputedTrajectoryInput, Tag("computed")],
    Discriminator(_trajectory_kind),
]


class SurveyPoint(Section):
    """One surveyed point; `h` may be left out where the survey has a `height_m`."""

    N: float = Field(description="northing, metres")
    E: float = Field(description="easting, metres")
    h: float | None = None
    sigma_m: Positive | None = None
    sigma_N: Positive | None = None
    sigma_E: Positive | None = None
    sigma_h: Positive | None = None


class SurveyFromTrajectory(TrajectoryFile):
    """Survey points taken from a true trajectory: location name to row of the file, counted from 0."""

    rows: dict[str, Row] = Field(min_length=1, description="location name: row of the file")
    sigma_m: PositivePerAxis = (0.05, 0.05, 0.05)


class SurveyInput(Section):
    """Surveyed points: exactly one of `file`, `points` and `from_trajectory`.

    Attributes:
        sigma_m: E, N, h; used where the source has no sigma, and as a floor where it has.
        height_m: height of every point of a survey without heights.
        ignore: names of locations not to be used.
    """

    file: InputFile | None = None
    delimiter: Delimiter | None = None
    columns: Columns | None = None
    points: dict[str, SurveyPoint] | None = Field(default=None, min_length=1)
    from_trajectory: SurveyFromTrajectory | None = None
    sigma_m: PositivePerAxis = (0.01, 0.01, 0.01)
    height_m: float | None = None
    ignore: list[Name] = Field(default=[])

    @model_validator(mode="after")
    def _check_source(self):
        sources = ("file", "points", "from_trajectory")
        given = [key for key in sources if getattr(self, key) is not None]
        if len(given) != 1:
            raise ValueError(f"give exactly one of {', '.join(sources)}; found {' and '.join(given) or 'none'}")
        for key in ("delimiter", "columns"):
            if self.file is None and getattr(self, key) is not None:
                raise ValueError(f"{key!r} describes a file, but the survey comes from {given[0]!r}: remove it")
        for name, point in (self.points or {}).items():
            if point.h is None and self.height_m is None:
                raise ValueError(
                    f"point {name!r} has no h: give it one, or give 'height_m' for a survey without heights"
                )
        return self


class RigInput(Section):
    """Cameras on the body: a rig file, or its content in place (`read_rig` checks it)."""

    file: InputFile | None = None
    cameras: dict[str, dict[str, Any]] | None = Field(default=None, min_length=1)
    T_rig_body: dict[str, Any] | None = None

    @model_validator(mode="after")
    def _check_source(self):
        if (self.file is None) == (self.cameras is None):
            raise ValueError("give exactly one of 'file' and 'cameras'")
        if self.file is not None and self.T_rig_body is not None:
            raise ValueError("'T_rig_body' belongs into the rig's file: remove it")
        return self


class CornerSightingsInput(Section):
    """Marker corners in pixels; needs a rig.

    Attributes:
        camera_names: what the file's camera column holds -> camera of the rig.
        camera: the camera of all rows, where the file has no camera column.
        marker_size_m: side by marker id, `default` for all others; one number for all.
    """

    kind: Literal["corners"]
    file: InputFile = Field(description="the file of corner detections")
    delimiter: Delimiter | None = None
    columns: Columns | None = None
    camera_names: dict[str, Name] = Field(default={})
    camera: Name | None = None
    marker_size_m: MarkerSizes = Field(description="the side of the markers, one number or {default: .., id: ..}")
    pixel_sigma_px: Positive = 1.0

    @model_validator(mode="after")
    def _check_camera(self):
        if self.camera is not None and self.columns is not None and "camera" in self.columns:
            raise ValueError("'camera' names the camera of all rows, but 'columns' has a camera column too: remove one")
        return self


class PoseSightingsInput(Section):
    """Marker poses `T_frame_marker`; `frame` is `body` or a camera of the rig. Sigmas where the file has none."""

    kind: Literal["poses"]
    file: InputFile = Field(description="the file of marker poses")
    delimiter: Delimiter | None = None
    columns: Columns | None = None
    frame: Name = "body"
    sigma_m: Positive = 0.01
    sigma_rot_rad: Positive = 0.02


class ControlPointSightingsInput(Section):
    """One row = the rig stands on a surveyed point: stamp, E, N, h and name, names in the file or here, in file order.

    The rows are the survey too: no `survey` beside them.

    Attributes:
        sigma_m: of the mark in the body frame; `survey_sigma_m`: of the surveyed coordinates, E, N, h.
        lever_arm_m: the point of the rig that stood on the marker, in the body frame.
    """

    kind: Literal["control_points"]
    file: InputFile = Field(description="the file of stamps")
    delimiter: Delimiter | None = None
    columns: Columns | None = None
    names: list[Name] | None = Field(default=None, min_length=1)
    lever_arm_m: Vector = Field(description="the marker in the body frame [x, y, z], metres")
    sigma_m: Positive = 0.01
    survey_sigma_m: PositivePerAxis = (0.01, 0.01, 0.01)

    @model_validator(mode="after")
    def _check_names(self):
        if self.names is not None and self.columns is not None and "name" in self.columns:
            raise ValueError("'names' lists the points, but 'columns' has a name column too: remove one")
        return self


class VisitedRow(Section):
    """A visit to a location at one row, counted from 0, of the true trajectory."""

    location: Name = Field(description="the location's name")
    row: Row = Field(description="the row of the true trajectory, counted from 0")


class FromTrajectorySightingsInput(TrajectoryFile):
    """The marker at the surveyed position, seen from the true pose."""

    kind: Literal["from_trajectory"]
    visits: list[VisitedRow] = Field(min_length=1, description="the visits: [{location: A, row: 0}, ..]")
    sigma_m: Positive = 0.01


SightingsInput = (
    CornerSightingsInput
    | PoseSightingsInput
    | ImagesSightingsInput
    | ControlPointSightingsInput
    | FromTrajectorySightingsInput
)
