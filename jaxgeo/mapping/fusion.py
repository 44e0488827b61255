"""Many clouds along a trajectory fused into one: a mean a voxel, and who saw it when."""

import dataclasses
from collections.abc import Iterable

import numpy as np
from jaxtyping import Float, Int, UInt8
from scipy.spatial import KDTree

from jaxgeo.data import RgbdFrame
from jaxgeo.errors import CloudError
from jaxgeo.geometry import rigid
from jaxgeo.mapping.depth_gates import DepthGates, gated_depth
from jaxgeo.mapping.rgbd_camera import RgbdCamera
from jaxgeo.mapping.rgbd_keyframe import depth_points
from jaxgeo.mapping.voxel_table import VoxelTable


@dataclasses.dataclass(frozen=True)
class PosedCloud:
    """What was seen from one pose.

    Attributes:
        stamp_s: of the pose.
        pose_index: its row, in whatever list of poses the fused cloud is to refer to.
        T_map_body: (4, 4) the pose.
        points_m: (n, 3) in the body frame.
        colour: (n, 3) RGB, or None.
        intensity: (n,), or None.
    """

    stamp_s: float
    pose_index: int
    T_map_body: Float[np.ndarray, "4 4"]
    points_m: Float[np.ndarray, "n 3"]
    colour: UInt8[np.ndarray, "n 3"] | None = None
    intensity: Float[np.ndarray, "n"] | None = None


@dataclasses.dataclass(frozen=True)
class FusionSettings:
    """How clouds are fused.

    Attributes:
        voxel_m: edge of the voxels, on a grid through the map's origin.
        pass_gap_s: a voxel that nothing saw for longer is seen in another pass, and its points stay apart: each pass
            moves with its own poses when the trajectory is corrected later. None: all passes are one.
        min_hits: voxels seen from fewer poses, all passes together, are left out: what moved, and noise.
        max_range_m: points further from the body are left out; None: none.
    """

    voxel_m: float = 0.05
    pass_gap_s: float | None = 10.0
    min_hits: int = 1
    max_range_m: float | None = None

    def __post_init__(self) -> None:
        if not self.voxel_m > 0.0:
            raise CloudError(f"fusion: voxels of {self.voxel_m} m; expected an edge above 0 m.")


@dataclasses.dataclass(frozen=True)
class FusedCloud:
    """One point a voxel and pass.

    Attributes:
        points_m: (n, 3) in the map frame, mean of what fell into the voxel.
        colour: (n, 3) RGB, mean; None where there was none.
        intensity: (n,) mean; None where there was none.
        stamp_s: (n,) of the pose that saw the point from nearest by.
        pose_index: (n,) that pose.
        hits: (n,) poses that saw it in this pass.
        count: (n,) points behind the mean.
        voxel_m: edge of the voxels.
    """

    points_m: Float[np.ndarray, "n 3"]
    colour: UInt8[np.ndarray, "n 3"] | None
    intensity: Float[np.ndarray, "n"] | None
    stamp_s: Float[np.ndarray, "n"]
    pose_index: Int[np.ndarray, "n"]
    hits: Int[np.ndarray, "n"]
    count: Int[np.ndarray, "n"]
    voxel_m: float

    def __len__(self) -> int:
        return len(self.points_m)


def fuse_points(clouds: Iterable[PosedCloud], settings: FusionSettings | None = None) -> FusedCloud:
    """Fuse clouds, given in the order of their stamps, one at a time: memory grows with the voxels, not the points.

    Args:
        clouds: all with colours, or none; all with intensities, or none.

    Raises:
        CloudError: stamps that go back, colours or intensities that some clouds lack, points that are not finite or too
            far away to be counted in voxels of this size, no points at all.
    """
    settings = settings or FusionSettings()
    gap_s = np.inf if settings.pass_gap_s is None else settings.pass_gap_s
    table: VoxelTable | None = None
    last_s, kinds = -np.inf, None
    for cloud in clouds:
        if cloud.stamp_s < last_s:
            raise CloudError(
                f"cloud of pose {cloud.pose_index}: stamp {cloud.stamp_s:.6f} s comes after {last_s:.6f} s; "
                "expected clouds in the order of their stamps."
            )
        last_s = cloud.stamp_s
        values, here = _values(cloud)
        if kinds is not None and here != kinds:
            raise CloudError(
                f"cloud of pose {cloud.pose_index}: has {_words(here)}, but the clouds before it have {_words(kinds)}; "
                "expected the same of all. Fuse different sensors each for itself."
            )
        kinds = here
        range_m = np.linalg.norm(cloud.points_m, axis=1)
        near = slice(None) if settings.max_range_m is None else range_m <= settings.max_range_m
        points = rigid.apply(cloud.T_map_body, cloud.points_m[near].astype(np.float64))
        table = table or VoxelTable(settings.voxel_m, gap_s)
        table.add(points, values[near], range_m[near], cloud.stamp_s, cloud.pose_index)
    if table is None or kinds is None or len(table) == 0:
        raise CloudError("fusion: no cloud holds any point; expected at least one. Is `max_range_m` too small?")
    return _fused(table, kinds, settings)


def cloud_of_frame(
    frame: RgbdFrame,
    camera: RgbdCamera,
    T_map_body: Float[np.ndarray, "4 4"],
    pose_index: int,
    gates: DepthGates | None = None,
) -> PosedCloud:
    """Every pixel of an RGB-D frame whose depth passes the gates, in the body frame.

    Raises:
        ScanError: the images are not of the camera's size.
    """
    camera.check(frame.image.shape, frame.source)
    depth = gated_depth(frame.depth_m, camera, gates or DepthGates(), frame.source)
    points, colour = depth_points(depth, frame.image, camera)
    return PosedCloud(frame.stamp_s, pose_index, T_map_body, points, colour)


def model_distance(points_m: Float[np.ndarray, "n 3"], model_m: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "n"]:
    """Distance of every point to the nearest point of a model, both in the map frame.

    Between points of a surface thinned to a voxel it is not zero: half a voxel is the size of it.
    """
    return np.asarray(KDTree(model_m).query(points_m)[0])


def _values(cloud: PosedCloud) -> tuple[Float[np.ndarray, "n v"], tuple[bool, bool]]:
    """Colours and intensities side by side, and which of them are there."""
    intensity = None if cloud.intensity is None else cloud.intensity[:, None]
    parts = [part for part in (cloud.colour, intensity) if part is not None]
    values = np.hstack(parts, dtype=np.float64) if parts else np.zeros((len(cloud.points_m), 0))
    return values, (cloud.colour is not None, cloud.intensity is not None)


def _words(kinds: tuple[bool, bool]) -> str:
    return (
        " and ".join(name for name, there in zip(("colours", "intensities"), kinds, strict=True) if there) or "neither"
    )


def _fused(table: VoxelTable, kinds: tuple[bool, bool], settings: FusionSettings) -> FusedCloud:
    rows = table.rows(settings.min_hits)
    mean = rows.value_sum / rows.count[:, None]
    colour = np.clip(np.round(mean[:, :3]), 0, 255).astype(np.uint8) if kinds[0] else None
    return FusedCloud(
        rows.point_sum / rows.count[:, None],
        colour,
        mean[:, -1].copy() if kinds[1] else None,
        rows.nearest_s,
        rows.nearest_pose,
        rows.hits,
        rows.count,
        settings.voxel_m,
    )
