"""Loops from RGB-D frames, carried over to the keyframes of the map."""

from collections import Counter
from collections.abc import Callable, Iterable

import numpy as np
from jaxtyping import Float

from jaxgeo.data import RgbdFrame, Trajectory
from jaxgeo.geometry import poses_at
from jaxgeo.geometry.rigid import adjoint, inverse, matrices
from jaxgeo.mapping.closure import Closure
from jaxgeo.mapping.image_features import FeatureMethod
from jaxgeo.mapping.keyframes import Keyframes
from jaxgeo.mapping.rgbd_camera import RgbdCamera
from jaxgeo.mapping.rgbd_closures import rgbd_closures
from jaxgeo.mapping.rgbd_keyframe import RgbdKeyframe, make_keyframe


def rgbd_keyframes(
    frames: Iterable[RgbdFrame],
    trajectory: Trajectory,
    keyframes: Keyframes,
    camera: RgbdCamera,
    method: FeatureMethod,
    on_frame: Callable[[], None] | None = None,
) -> tuple[dict[int, RgbdKeyframe], int, int]:
    """The first frame after each keyframe and before the next, thinned; the number of frames, and of those outside."""
    kept: dict[int, RgbdKeyframe] = {}
    n_frames = outside = 0
    for frame in frames:
        n_frames += 1
        if on_frame is not None:
            on_frame()
        if not trajectory.stamp_s[0] <= frame.stamp_s <= trajectory.stamp_s[-1]:
            outside += 1
            continue
        k = max(int(np.searchsorted(keyframes.stamp_s, frame.stamp_s, side="right")) - 1, 0)
        if k not in kept:
            kept[k] = make_keyframe(frame, camera, method)
    return kept, n_frames, outside


def rgbd_loops(
    kept: dict[int, RgbdKeyframe],
    trajectory: Trajectory,
    keyframes: Keyframes,
    camera: RgbdCamera,
    method: FeatureMethod,
    on_progress: Callable[[int, int], None] | None = None,
) -> tuple[list[Closure], Counter[str]]:
    """Closures between the map's keyframes, and how many candidates were refused, by reason.

    A frame is taken a little after its keyframe; the odometry between the two (`T_key_frame`) moves the closure from
    frames to keyframes: `T_k1_k2 = T_k1_f1 T_f1_f2 T_f2_k2`, whose error is seen from k2, `x' = Ad(T_k2_f2) x`.
    """
    rows = sorted(kept)
    if len(rows) < 2:
        return [], Counter()
    poses = poses_at(trajectory, np.array([kept[k].stamp_s for k in rows]))
    T_map_frame = matrices(poses.position_m, poses.quat_wxyz)
    T_key_frame = inverse(keyframes.T_map_body[rows]) @ T_map_frame
    found, refused = rgbd_closures(
        [kept[k] for k in rows], camera, method, T_map_body=T_map_frame, on_progress=on_progress
    )
    return [_at_keyframes(c, rows, T_key_frame) for c in found], refused


def _at_keyframes(closure: Closure, rows: list[int], T_key_frame: Float[np.ndarray, "f 4 4"]) -> Closure:
    back = inverse(T_key_frame[closure.second])
    T = T_key_frame[closure.first] @ closure.T_first_second @ back
    to_frame = adjoint(back)  # an error seen from the keyframe, as the frame sees it
    information = to_frame.T @ closure.information @ to_frame
    return Closure(rows[closure.first], rows[closure.second], T, information, closure.score, closure.kind)
