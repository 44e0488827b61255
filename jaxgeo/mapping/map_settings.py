"""How a map is made."""

import dataclasses
import math

from jaxgeo.errors import InputError
from jaxgeo.graph.noise_defaults import DEFAULTS


@dataclasses.dataclass(frozen=True)
class MapSettings:
    """One set of defaults for all recordings; lengths left None follow the scene (`jaxgeo.mapping.scene_scale`).

    Attributes:
        odometry: kind of the trajectory's odometry: `lidar`, `vio`, `wheel` or `mono`: its assumed noise.
        voxel_m: clouds are thinned to it, for registration.
        keyframe_m, keyframe_rad: a keyframe whenever the body moved or turned so far.
        refine: let the scans of neighbouring keyframes check and sharpen the odometry first.
        rounds: loops are looked for so often, each time with the trajectory that the loops before have closed.
        inlier_chi: a closure is rejected where its whitened residual stays longer (4.1: 99 % of six degrees).
        features: of RGB-D images, see `jaxgeo.mapping.image_features.feature_method`.
        threads: of registration.
    """

    odometry: str = "lidar"
    voxel_m: float | None = None
    keyframe_m: float | None = None
    keyframe_rad: float = math.radians(20.0)
    refine: bool = True
    rounds: int = 2
    inlier_chi: float = 4.1
    features: str = "auto"
    threads: int = 2

    def __post_init__(self) -> None:
        if self.odometry not in DEFAULTS:
            raise InputError(f"mapping: odometry {self.odometry!r}, expected one of {', '.join(DEFAULTS)}.")
        for name in ("voxel_m", "keyframe_m", "keyframe_rad", "inlier_chi"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise InputError(f"mapping: {name} is {value!r}, expected a positive number.")
        for name in ("rounds", "threads"):
            if getattr(self, name) < 1:
                raise InputError(f"mapping: {name} is {getattr(self, name)!r}, expected at least 1.")
