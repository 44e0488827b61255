"""Loop closures between RGB-D keyframes: candidates, each verified."""

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from jaxgeo.mapping.closure import Closure
from jaxgeo.mapping.depth_gates import DepthGates
from jaxgeo.mapping.image_features import FeatureMethod
from jaxgeo.mapping.rgbd_alignment import AlignmentSettings, align_keyframes
from jaxgeo.mapping.rgbd_camera import RgbdCamera
from jaxgeo.mapping.rgbd_candidates import CandidateSettings, rgbd_candidates
from jaxgeo.mapping.rgbd_keyframe import RgbdKeyframe


def rgbd_closures(
    keyframes: Sequence[RgbdKeyframe],
    camera: RgbdCamera,
    method: FeatureMethod,
    *,
    T_map_body: Float[np.ndarray, "k 4 4"] | None = None,
    candidates: CandidateSettings | None = None,
    alignment: AlignmentSettings | None = None,
    gates: DepthGates | None = None,
    on_progress: Callable[[int, int], None] | None = None,
) -> tuple[list[Closure], Counter[str]]:
    """Pairs of keyframes that show one place, with the motion between them.

    Args:
        method: the one that made the keyframes' features.
        T_map_body: poses by the odometry: pairs that it brings together are looked at besides those that look alike.
        on_progress: called with the pairs looked at and their number.

    Returns:
        the closures, by (first, second); and how many candidates were refused, by reason.
    """
    T_map_cam = None if T_map_body is None else T_map_body @ camera.T_body_cam
    pairs = rgbd_candidates(keyframes, T_map_cam, candidates)
    closures, refused = [], Counter()
    for done, (first, second) in enumerate(pairs, start=1):
        a, b = keyframes[first], keyframes[second]
        matches = method.match(a.features, b.features)
        found, why = align_keyframes(a, b, matches, camera, alignment, gates)
        if found is None:
            refused[why] += 1
        else:
            closures.append(Closure(first, second, found.T_first_second, found.information, found.share, "rgbd"))
        if on_progress is not None:
            on_progress(done, len(pairs))
    return closures, refused
