"""Features of an image and their partners in another image: one interface, SIFT behind it by default."""

import dataclasses
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from jaxgeo.errors import InputError

METHODS = ("sift", "disk", "auto")


@dataclasses.dataclass(frozen=True)
class Features:
    """Points of one image that can be found again.

    Attributes:
        points_px: (n, 2) column, row; the centre of the first pixel is (0, 0).
        descriptors: (n, d) of unit length: their inner product is the likeness of two points.
        resolution_px: (width, height) of the image.
    """

    points_px: Float[np.ndarray, "n 2"]
    descriptors: Float[np.ndarray, "n d"]
    resolution_px: tuple[int, int]

    def __len__(self) -> int:
        return len(self.points_px)


class FeatureMethod(Protocol):
    """How features are found and paired; features of one method mean nothing to another."""

    name: str

    def extract(self, image: UInt8[np.ndarray, "h w 3"]) -> Features:
        """The features of a BGR image, the strongest first."""
        ...

    def match(self, first: Features, second: Features) -> Int[np.ndarray, "m 2"]:
        """Rows of the first and of the second that are likely one point of the scene."""
        ...


class SiftFeatures:
    """SIFT (Lowe, IJCV 2004) with the square-root descriptors of Arandjelovic and Zisserman (CVPR 2012).

    The inner product of the square roots of two L1-normalised histograms is the Hellinger kernel, which the few largest
    bins do not rule.

    Args:
        max_features: at most so many an image, the strongest.
        ratio: a pair is kept where its distance is below this share of the distance to the second best.
    """

    name = "sift"

    def __init__(self, max_features: int = 1500, ratio: float = 0.8):
        self.ratio = ratio
        self._sift = cv2.SIFT.create(max_features)

    def extract(self, image: UInt8[np.ndarray, "h w 3"]) -> Features:
        height, width = image.shape[:2]
        found, raw = self._sift.detectAndCompute(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), None)
        points = np.array([one.pt for one in found], dtype=np.float64).reshape(-1, 2)
        raw = np.zeros((0, 128), dtype=np.float32) if raw is None else raw
        descriptors = np.sqrt(raw / np.maximum(raw.sum(axis=1, keepdims=True), 1e-12))
        strongest = np.argsort([-one.response for one in found], kind="stable")
        return Features(points[strongest], descriptors[strongest], (width, height))

    def match(self, first: Features, second: Features) -> Int[np.ndarray, "m 2"]:
        return match_mutual(first, second, self.ratio)


def match_mutual(first: Features, second: Features, ratio: float) -> Int[np.ndarray, "m 2"]:
    """Pairs that choose each other and are clearly better than the second choice (Lowe's ratio test, from both sides).

    A point with several orientations is several features at one place: of the pairs between two places the most alike
    is kept, so that none counts twice.
    """
    if len(first) < 2 or len(second) < 2:
        return np.zeros((0, 2), dtype=np.int64)
    likeness = first.descriptors @ second.descriptors.T
    forward, clear = _clear_choice(likeness, second.points_px, ratio)
    backward, clear_back = _clear_choice(likeness.T, first.points_px, ratio)
    rows = np.flatnonzero(backward[forward] == np.arange(len(first)))
    rows = rows[clear[rows] & clear_back[forward[rows]]]
    pairs = np.column_stack([rows, forward[rows]])
    pairs = pairs[np.argsort(-likeness[pairs[:, 0], pairs[:, 1]], kind="stable")]
    places = np.hstack([np.round(first.points_px[pairs[:, 0]]), np.round(second.points_px[pairs[:, 1]])])
    _, kept = np.unique(places, axis=0, return_index=True)
    return pairs[np.sort(kept)]


def feature_method(name: str = "auto", weights: Path | None = None) -> tuple[FeatureMethod, str]:
    """The features asked for, and a sentence that says which they are and why.

    Args:
        name: `sift`; `disk` (learned, needs the weights in a local folder); `auto`: `disk` where its weights are
            there, else `sift`.
        weights: folder of the weights; default: the cache of torch.hub. Nothing is ever downloaded.

    Raises:
        InputError: no such method; `disk` without torch, kornia or its weights, or with a weight file of other content.
    """
    from jaxgeo.mapping.kornia_features import DiskFeatures, find_weights  # it imports torch only when used

    if name not in METHODS:
        raise InputError(f"features: '{name}' is not known; expected one of {', '.join(METHODS)}.")
    if name == "sift":
        return SiftFeatures(), "features: SIFT."
    found = find_weights(weights)
    if found is not None:
        method = DiskFeatures(found)
        matcher = "LightGlue" if found.lightglue is not None else "mutual nearest neighbours"
        return method, f"features: DISK with the weights {found.disk}, paired by {matcher}."
    why = f"no weights of DISK ({DISK_FILE}) in {weights or 'the cache of torch.hub'}, and none are downloaded"
    if name == "disk":
        raise InputError(f"features: {why}. Put the file there, or use features sift.")
    return SiftFeatures(), f"features: SIFT, since there are {why}."


DISK_FILE = "depth-save.pth"


def _clear_choice(
    likeness: Float[np.ndarray, "n m"], points_px: Float[np.ndarray, "m 2"], ratio: float
) -> tuple[Int[np.ndarray, "n"], np.ndarray]:
    """Each row's best column, and whether its distance is below `ratio` times that of the best at another place."""
    n = np.arange(len(likeness))
    few = min(4, likeness.shape[1])  # a place rarely has more than three orientations
    top = np.argpartition(-likeness, few - 1, axis=1)[:, :few]
    top = np.take_along_axis(top, np.argsort(-likeness[n[:, None], top], axis=1), axis=1)
    best = top[:, 0]
    elsewhere = np.any(np.abs(points_px[top] - points_px[best][:, None]) > 1.0, axis=2)
    second = np.where(elsewhere, likeness[n[:, None], top], -1.0).max(axis=1)
    distance = np.sqrt(np.maximum(1.0 - likeness[n, best], 0.0))  # of unit vectors, up to the root of two
    return best, distance < ratio * np.sqrt(np.maximum(1.0 - second, 0.0))
