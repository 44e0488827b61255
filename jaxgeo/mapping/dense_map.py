"""Dense mapping: a trajectory of any odometry, and what its sensors saw, to a loop-closed trajectory."""

import dataclasses
import itertools
from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Float

from jaxgeo.data import Camera, RgbdFrame, Scan, Trajectory
from jaxgeo.errors import ScanError
from jaxgeo.mapping.closure import Closure
from jaxgeo.mapping.keyframes import Keyframes, choose_keyframes
from jaxgeo.mapping.loop_closed import LoopClosed, carried_to_all
from jaxgeo.mapping.map_settings import MapSettings
from jaxgeo.mapping.map_stages import Begun, Progress, clouds_of, odometry_covariance, solve_map, with_lidar, with_rgbd
from jaxgeo.mapping.refined_odometry import RefinedOdometry
from jaxgeo.mapping.scene_scale import SceneScale, scene_scale

_SCALE_FROM = 20  # scans or frames at the start that the scene's size is taken from


@dataclasses.dataclass(frozen=True)
class DenseMap:
    """A map's trajectory and how its loops were closed.

    Attributes:
        trajectory: loop-closed, every pose and stamp of the input; the input itself where nothing asked for a change.
        keyframes: of the input, with the poses of the input.
        T_map_keyframe: (k, 4, 4) solved.
        closures: verified ones; the graph decides which count.
        loops: the solved graph, in the order of `closures`.
        refined: the odometry between keyframes after the scans' check; None without LiDAR.
        refused: candidates that became no closure, by reason.
        scale: lengths that were used.
        n_scans, n_frames: used.
        cloud_bytes: of the keyframes' clouds, together.
        warnings: in words.
    """

    trajectory: Trajectory
    keyframes: Keyframes
    T_map_keyframe: Float[np.ndarray, "k 4 4"]
    closures: Sequence[Closure]
    loops: LoopClosed
    refined: RefinedOdometry | None
    refused: Counter[str]
    scale: SceneScale
    n_scans: int
    n_frames: int
    cloud_bytes: int
    warnings: tuple[str, ...]

    @property
    def accepted(self) -> np.ndarray:
        """(c,) closures that count."""
        return self.loops.weight > 0.5


def build_map(
    trajectory: Trajectory,
    *,
    scans: Iterable[Scan] | None = None,
    rgbd: Iterable[RgbdFrame] | None = None,
    T_body_lidar: Float[np.ndarray, "4 4"] | None = None,
    camera: Camera | None = None,
    settings: MapSettings | None = None,
    on_progress: Progress | None = None,
) -> DenseMap:
    """Close the loops of a trajectory, whatever odometry made it.

    The map frame's z is taken to point up, roughly: places are compared from above.

    Args:
        scans, rgbd: sources that can be read more than once (`jaxgeo.io.scans`, `jaxgeo.io.rgbd`), streamed; their
            stamps are on the trajectory's clock.
        T_body_lidar: (4, 4); None: the sensor's frame is the body's.
        camera: of the RGB-D frames.
        on_progress: called with the phase, how much is done, and of how much (None: unknown).

    Raises:
        ScanError: neither scans nor frames, frames without a camera, or none inside the trajectory.
        InputError: small_gicp is not installed.
        ConvergenceError: the pose graph could not be solved.
    """
    settings = settings or MapSettings()
    say = on_progress or (lambda phase, done, total: None)
    if scans is None and rgbd is None:
        raise ScanError("mapping: neither LiDAR scans nor RGB-D frames are given, expected at least one of them.")
    scale = scene_scale(_median_range_m(scans, rgbd), settings.voxel_m, settings.keyframe_m)
    keyframes = choose_keyframes(trajectory, trajectory.stamp_s, scale.keyframe_m, settings.keyframe_rad)
    begun = Begun(keyframes.T_map_body, odometry_covariance(trajectory, keyframes, settings))
    if scans is not None:
        T_lidar = np.eye(4) if T_body_lidar is None else T_body_lidar
        clouds = clouds_of(scans, trajectory, keyframes, T_lidar, scale, say)
        begun = with_lidar(begun, clouds, scale, settings, say)
    if rgbd is not None:
        begun = with_rgbd(begun, rgbd, trajectory, keyframes, camera, settings, say)
    begun, loops = solve_map(begun, settings, say)
    changed = bool((loops.weight > 0.5).any()) or bool(begun.refined is not None and len(begun.refined.disproved))
    T_map_keyframe = loops.T_map_body if changed else keyframes.T_map_body
    return DenseMap(
        carried_to_all(trajectory, keyframes, T_map_keyframe) if changed else trajectory,
        keyframes,
        T_map_keyframe,
        begun.closures,
        loops,
        begun.refined,
        begun.refused,
        scale,
        begun.n_scans,
        begun.n_frames,
        begun.cloud_bytes,
        (*begun.warnings, *_warnings(loops, begun.refined, keyframes)),
    )


def _median_range_m(scans: Iterable[Scan] | None, rgbd: Iterable[RgbdFrame] | None) -> float:
    """Of the first scans, or else the first frames."""
    if scans is not None:
        ranges = [np.linalg.norm(scan.points_m, axis=1) for scan in itertools.islice(scans, _SCALE_FROM)]
    else:
        assert rgbd is not None
        ranges = [frame.depth_m[frame.depth_m > 0.0] for frame in itertools.islice(rgbd, _SCALE_FROM)]
    if not ranges or not sum(map(len, ranges)):
        raise ScanError(f"mapping: the first {_SCALE_FROM} scans or frames hold no points. Is the source complete?")
    return float(np.median(np.concatenate(ranges)))


def _warnings(loops: LoopClosed, refined: RefinedOdometry | None, keyframes: Keyframes) -> tuple[str, ...]:
    said = []
    if refined is not None and len(refined.disproved):
        stamps = ", ".join(f"{keyframes.stamp_s[k]:.3f}" for k in refined.disproved[:5])
        said.append(
            f"the scans contradict the odometry after {len(refined.disproved)} keyframe(s), at {stamps}"
            f"{' ...' * (len(refined.disproved) > 5)} s; it is trusted less there."
        )
    if loops.noise_factor > 1.0:
        said.append(f"the odometry drifts {loops.noise_factor:.1f} times as much as its kind is assumed to.")
    rejected = int(np.count_nonzero(loops.weight <= 0.5))
    if rejected:
        said.append(f"{rejected} of {len(loops.weight)} verified closures contradict the others and are rejected.")
    return tuple(said)
