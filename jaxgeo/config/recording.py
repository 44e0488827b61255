"""The raw sensors of a session, LiDAR scans and RGB-D frames, and what this run makes of them."""

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from jaxgeo.config.fields import InputFile, Name, NonNegative, Positive, Section, Vector


def _quaternion(value: Any) -> Any:
    if not isinstance(value, list | tuple) or len(value) != 4:
        raise ValueError("expected four numbers [w, x, y, z]")
    if all(isinstance(x, int | float) for x in value) and abs(sum(x * x for x in value) - 1.0) > 1e-3:
        raise ValueError("expected a quaternion [w, x, y, z] of length 1")
    return tuple(value)


Quaternion = Annotated[tuple[float, float, float, float], BeforeValidator(_quaternion)]


class SensorPose(Section):
    """Where a sensor sits: `t_m` its origin in the body frame, `quat_wxyz` its axes to the body's."""

    t_m: Vector = (0.0, 0.0, 0.0)
    quat_wxyz: Quaternion = (1.0, 0.0, 0.0, 0.0)


class ScansInput(Section):
    """LiDAR scans: a folder of files, a packed file of many scans, or a ROS bag.

    Attributes:
        kind: seen from the path where it is not said.
        stamps: a file of stamps, where the scans have none.
        rate_hz, start_s: scans a second and the first one's stamp, where nothing has stamps.
        topic: of a bag: the topic of PointCloud2; by default its only one.
        T_body_lidar: where the LiDAR sits on the body.
        method: of the odometry: gicp or kiss.
        deskew: straighten scans whose points carry times.
        min_range_m, max_range_m: points nearer (the rig itself) and farther are left out.
    """

    path: InputFile = Field(description="the folder of scans, the packed file, or the bag")
    kind: Literal["folder", "packed", "bag"] | None = None
    stamps: InputFile | None = None
    rate_hz: Positive | None = None
    start_s: float | None = None
    topic: Name | None = None
    T_body_lidar: SensorPose = SensorPose()
    method: Literal["gicp", "kiss"] = "gicp"
    deskew: bool = True
    min_range_m: NonNegative | None = None
    max_range_m: Positive | None = None

    @model_validator(mode="after")
    def _check_stamps(self):
        if self.stamps is not None and self.rate_hz is not None:
            raise ValueError("'stamps' and 'rate_hz' both say when scans were taken: remove one")
        return self


class RgbdInput(Section):
    """RGB-D frames of one camera of the rig, depth registered to colour.

    Attributes:
        kind: seen from the path where it is not said.
        camera: the rig's camera; by default its only one.
        stamps, rate_hz, start_s: where the files' names hold no stamps.
        topics: of a bag: {color: .., depth: ..}.
        depth_unit_m: metres of one step of a 16-bit depth image.
    """

    path: InputFile = Field(description="the folder of colour and depth images, or the bag")
    kind: Literal["folder", "bag"] | None = None
    camera: Name | None = None
    stamps: InputFile | None = None
    rate_hz: Positive | None = None
    start_s: float | None = None
    topics: dict[Literal["color", "depth"], Name] | None = Field(default=None, min_length=2)
    depth_unit_m: Positive = 0.001


class MappingInput(Section):
    """The dense map and its loop-closed trajectory.

    Attributes:
        voxel_m: one point of the cloud in each.
        clouds: file type of the georeferenced clouds; none: make no cloud.
    """

    voxel_m: Positive = 0.1
    clouds: Literal["laz", "las", "ply", "none"] = "laz"
