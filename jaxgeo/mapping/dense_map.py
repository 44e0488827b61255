"""Dense mapping: a trajectory of any odometry, and what its sensors saw, to a loop-closed trajectory."""

import dataclasses
import functools
import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from jaxtyping import Float

from jaxgeo.data import Camera, RgbdFrame, Scan, Trajectory
from jaxgeo.errors import ConvergenceError, ScanError
from jaxgeo.graph.noise_defaults import default_noise
from jaxgeo.mapping.closure import Closure
from jaxgeo.mapping.image_features import feature_method
from jaxgeo.mapping.keyframe_graph import edge_covariance
from jaxgeo.mapping.keyframes import Keyframes, choose_keyframes
from jaxgeo.mapping.lidar_closures import LidarPlace, VerificationSettings
from jaxgeo.mapping.lidar_loops import LidarLoops, prepared
from jaxgeo.mapping.loop_closed import LoopClosed, carried_to_all, close_loops
from jaxgeo.mapping.map_settings import MapSettings
from jaxgeo.mapping.refined_odometry import RefinedOdometry, refine_odometry
from jaxgeo.mapping.rgbd_camera import rgbd_camera
from jaxgeo.mapping.rgbd_loops import rgbd_keyframes, rgbd_loops
from jaxgeo.mapping.rigid import inverse, trajectory_matrices, turn_rad
from jaxgeo.mapping.scene_scale import SceneScale, scene_scale
from jaxgeo.mapping.submaps import KeyframeClouds, keyframe_clouds, path_length_m
from jaxgeo.solve.closure_graph import ClosureSettings

_SCALE_FROM = 20  # scans or frames at the start that the scene's size is taken from
# Rotations err with the turn too: a degree in a full circle, in quadrature.
_SIGMA_TURN_RAD_PER_SQRT_RAD = 0.007
# Neighbours' clouds bend alike: their registration is held to less than a loop's.
_NEIGHBOUR_FLOOR_M, _NEIGHBOUR_FLOOR_RAD = 0.005, 0.001

Progress = Callable[[str, int, int | None], None]


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
    begun = _Begun(keyframes.T_map_body, _edge_covariance(trajectory, keyframes, settings))
    if scans is not None:
        T_lidar = np.eye(4) if T_body_lidar is None else T_body_lidar
        clouds = _clouds(scans, trajectory, keyframes, T_lidar, scale, say)
        begun = _with_lidar(begun, clouds, scale, settings, say)
    if rgbd is not None:
        begun = _with_rgbd(begun, rgbd, trajectory, keyframes, camera, settings, say)
    begun, loops = _solved(begun, settings, say)
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


@dataclasses.dataclass(frozen=True)
class _Begun:
    """What is known before the graph is solved: odometry between keyframes, and closures."""

    T_map_body: Float[np.ndarray, "k 4 4"]  # of the given odometry
    covariance: Float[np.ndarray, "e 6 6"]
    closures: Sequence[Closure] = ()
    refused: Counter[str] = dataclasses.field(default_factory=Counter)
    refined: RefinedOdometry | None = None
    lidar: LidarLoops | None = None
    known: frozenset[tuple[int, int]] = frozenset()
    n_scans: int = 0
    n_frames: int = 0
    cloud_bytes: int = 0
    warnings: tuple[str, ...] = ()


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


def _edge_covariance(
    trajectory: Trajectory, keyframes: Keyframes, settings: MapSettings
) -> Float[np.ndarray, "e 6 6"]:
    """Noise of the given odometry over the path and the turns between keyframes."""
    T = trajectory_matrices(trajectory)
    turned = np.concatenate([[0.0], np.cumsum(turn_rad(inverse(T[:-1]) @ T[1:]))])
    length_m, turn = np.diff(path_length_m(T)[keyframes.source]), np.diff(turned[keyframes.source])
    noise = default_noise(settings.odometry, sigma_turn_rad_per_sqrt_rad=_SIGMA_TURN_RAD_PER_SQRT_RAD)
    return edge_covariance(noise, length_m, turn)


def _clouds(
    scans: Iterable[Scan],
    trajectory: Trajectory,
    keyframes: Keyframes,
    T_body_lidar: Float[np.ndarray, "4 4"],
    scale: SceneScale,
    say: Progress,
) -> KeyframeClouds:
    done = itertools.count(1)
    total = getattr(scans, "n_scans", None)
    clouds = keyframe_clouds(
        scans, trajectory, keyframes, T_body_lidar, scale, lambda: say("scans", next(done), total)
    )
    if clouds.n_scans == 0:
        raise ScanError(_outside("scans", clouds.outside, clouds.outside, trajectory))
    return clouds


def _with_lidar(begun: _Begun, clouds: KeyframeClouds, scale: SceneScale, settings: MapSettings, say: Progress) -> _Begun:
    T, covariance, refined = begun.T_map_body, begun.covariance, None
    if settings.refine and len(clouds) > 1:
        verification = VerificationSettings(floor_m=_NEIGHBOUR_FLOOR_M, floor_rad=_NEIGHBOUR_FLOOR_RAD)

        @functools.lru_cache(8)
        def place(k: int) -> LidarPlace | None:
            return prepared(clouds.points_m[k], scale, verification, settings.threads)

        refined = refine_odometry(
            T,
            covariance,
            place,
            verification,
            _graph_settings(settings),
            threads=settings.threads,
            on_progress=lambda done, total: say("neighbours", done, total),
        )
        T, covariance = refined.T_map_body, refined.covariance
    say("places", 0, None)
    lidar = LidarLoops(clouds, T, scale, settings.threads)
    closures, refused, known = lidar.find(begun.known, on_progress=lambda done, total: say("loops", done, total))
    return dataclasses.replace(
        begun,
        covariance=covariance,
        closures=closures,
        refused=refused,
        refined=refined,
        lidar=lidar,
        known=known,
        n_scans=clouds.n_scans,
        cloud_bytes=clouds.nbytes,
        warnings=_left_out("scans", clouds.outside, clouds.n_scans + clouds.outside),
    )


def _with_rgbd(
    begun: _Begun,
    frames: Iterable[RgbdFrame],
    trajectory: Trajectory,
    keyframes: Keyframes,
    camera: Camera | None,
    settings: MapSettings,
    say: Progress,
) -> _Begun:
    if camera is None:
        raise ScanError("mapping: RGB-D frames without a camera; name the rig and the camera that took them.")
    first = next(iter(frames), None)
    if first is None:
        raise ScanError("mapping: no RGB-D frame in the source. Is it complete?")
    prepared_camera = rgbd_camera(camera, (first.image.shape[1], first.image.shape[0]))
    method, _ = feature_method(settings.features)
    done = itertools.count(1)
    total = getattr(frames, "n_frames", None)
    kept, n_frames, outside = rgbd_keyframes(
        frames, trajectory, keyframes, prepared_camera, method, lambda: say("frames", next(done), total)
    )
    if not kept:
        raise ScanError(_outside("frames", outside, n_frames, trajectory))
    closures, refused = rgbd_loops(
        kept, trajectory, keyframes, prepared_camera, method, lambda done, total: say("loops seen", done, total)
    )
    return dataclasses.replace(
        begun,
        closures=[*begun.closures, *closures],
        refused=begun.refused + refused,
        n_frames=n_frames - outside,
        warnings=(*begun.warnings, *_left_out("frames", outside, n_frames)),
    )


def _solved(begun: _Begun, settings: MapSettings, say: Progress) -> tuple[_Begun, LoopClosed]:
    """The solved graph; loops are looked for again where the solved keyframes come near one another."""
    graph = _graph_settings(settings)
    loops = _closed(begun, graph)
    for _ in range(settings.rounds - 1):
        if begun.lidar is None or not (loops.weight > 0.5).any():
            break
        more, refused, known = begun.lidar.find(
            begun.known, loops.T_map_body, lambda done, total: say("more loops", done, total)
        )
        closures = [*begun.closures, *more]
        begun = dataclasses.replace(begun, closures=closures, refused=begun.refused + refused, known=known)
        if not more:
            break
        loops = _closed(begun, graph)
    if loops.result != "converged":
        raise ConvergenceError(
            f"mapping: the pose graph of {len(begun.T_map_body)} keyframes and {len(begun.closures)} closures did not "
            f"converge: {loops.result}. Is the trajectory made of the same recording as the scans?"
        )
    return begun, loops


def _closed(begun: _Begun, graph: ClosureSettings) -> LoopClosed:
    neighbours, start = ((), None) if begun.refined is None else (begun.refined.neighbours, begun.refined.T_map_body)
    return close_loops(
        begun.T_map_body, begun.covariance, begun.closures, graph, neighbours=neighbours, start=start
    )


def _graph_settings(settings: MapSettings) -> ClosureSettings:
    return ClosureSettings(loss="gnc", loss_width=settings.inlier_chi, start="given")


def _left_out(what: str, outside: int, total: int) -> tuple[str, ...]:
    if not outside:
        return ()
    return (f"{outside} of {total} {what} lie outside the trajectory's stamps and are left out.",)


def _outside(what: str, outside: int, total: int, trajectory: Trajectory) -> str:
    return (
        f"mapping: {outside} of {total} {what} have stamps outside the trajectory, {trajectory.stamp_s[0]:.3f} to "
        f"{trajectory.stamp_s[-1]:.3f} s; expected them inside. Do both use one clock?"
    )


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
