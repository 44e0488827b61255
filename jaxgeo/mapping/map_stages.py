"""The stages of dense mapping: what LiDAR scans add, what RGB-D frames add, and the solve."""

import dataclasses
import functools
import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from jaxtyping import Float

from jaxgeo.data import Camera, RgbdFrame, Scan, Trajectory
from jaxgeo.errors import ConvergenceError, ScanError
from jaxgeo.geometry.rigid import inverse, trajectory_matrices, turn_rad
from jaxgeo.graph.noise_defaults import default_noise
from jaxgeo.mapping.closure import Closure
from jaxgeo.mapping.image_features import feature_method
from jaxgeo.mapping.keyframe_graph import edge_covariance
from jaxgeo.mapping.keyframes import Keyframes
from jaxgeo.mapping.lidar_closures import LidarPlace, VerificationSettings
from jaxgeo.mapping.lidar_loops import LidarLoops, prepared
from jaxgeo.mapping.loop_closed import LoopClosed, close_loops
from jaxgeo.mapping.map_settings import MapSettings
from jaxgeo.mapping.refined_odometry import RefinedOdometry, refine_odometry
from jaxgeo.mapping.rgbd_camera import rgbd_camera
from jaxgeo.mapping.rgbd_loops import rgbd_keyframes, rgbd_loops
from jaxgeo.mapping.scene_scale import SceneScale
from jaxgeo.mapping.submaps import KeyframeClouds, keyframe_clouds, path_length_m
from jaxgeo.solve.closure_graph import ClosureSettings

# Rotations err with the turn too: a degree in a full circle, in quadrature.
_SIGMA_TURN_RAD_PER_SQRT_RAD = 0.007
# Neighbours' clouds bend alike: their registration is held to less than a loop's.
_NEIGHBOUR_FLOOR_M, _NEIGHBOUR_FLOOR_RAD = 0.005, 0.001

Progress = Callable[[str, int, int | None], None]


@dataclasses.dataclass(frozen=True)
class Begun:
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


def odometry_covariance(
    trajectory: Trajectory, keyframes: Keyframes, settings: MapSettings
) -> Float[np.ndarray, "e 6 6"]:
    """Noise of the given odometry over the path and the turns between keyframes."""
    T = trajectory_matrices(trajectory)
    turned = np.concatenate([[0.0], np.cumsum(turn_rad(inverse(T[:-1]) @ T[1:]))])
    length_m, turn = np.diff(path_length_m(T)[keyframes.source]), np.diff(turned[keyframes.source])
    noise = default_noise(settings.odometry, sigma_turn_rad_per_sqrt_rad=_SIGMA_TURN_RAD_PER_SQRT_RAD)
    return edge_covariance(noise, length_m, turn)


def clouds_of(
    scans: Iterable[Scan],
    trajectory: Trajectory,
    keyframes: Keyframes,
    T_body_lidar: Float[np.ndarray, "4 4"],
    scale: SceneScale,
    say: Progress,
) -> KeyframeClouds:
    """What the LiDAR saw, by keyframe.

    Raises:
        ScanError: no scan lies inside the trajectory.
    """
    done = itertools.count(1)
    total = getattr(scans, "n_scans", None)
    clouds = keyframe_clouds(scans, trajectory, keyframes, T_body_lidar, scale, lambda: say("scans", next(done), total))
    if clouds.n_scans == 0:
        raise ScanError(_outside("scans", clouds.outside, clouds.outside, trajectory))
    return clouds


def with_lidar(begun: Begun, clouds: KeyframeClouds, scale: SceneScale, settings: MapSettings, say: Progress) -> Begun:
    """The odometry checked by neighbouring scans, and the loops that submaps show."""
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


def with_rgbd(
    begun: Begun,
    frames: Iterable[RgbdFrame],
    trajectory: Trajectory,
    keyframes: Keyframes,
    camera: Camera | None,
    settings: MapSettings,
    say: Progress,
) -> Begun:
    """The loops that images show.

    Raises:
        ScanError: no camera, no frame, or none inside the trajectory.
    """
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


def solve_map(begun: Begun, settings: MapSettings, say: Progress) -> tuple[Begun, LoopClosed]:
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


def _closed(begun: Begun, graph: ClosureSettings) -> LoopClosed:
    neighbours, start = ((), None) if begun.refined is None else (begun.refined.neighbours, begun.refined.T_map_body)
    return close_loops(begun.T_map_body, begun.covariance, begun.closures, graph, neighbours=neighbours, start=start)


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
