"""The images of one node: as stored, and as the frame of one camera."""

import dataclasses

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from jaxgeo.errors import ScanError
from jaxgeo.io.rtabmap.calibration_blob import StoredCamera
from jaxgeo.io.rtabmap.image_blob import colour_image, depth_image_m


@dataclasses.dataclass(frozen=True)
class StoredImages:
    """What one node holds of images, as stored.

    Attributes:
        stamp_s: of the node.
        image: JPEG or PNG; of several cameras side by side. None where there is none.
        depth: see `image_blob.depth_image_m`. None where there is none.
        calibration: see `calibration_blob`. None where there is none.
        source: file and node, for messages.
        index: the node's place in the order of time, counted from 0.
    """

    stamp_s: float
    image: bytes | None
    depth: bytes | None
    calibration: bytes | None
    source: str
    index: int


def colour_of(stored: StoredImages, camera: int, cameras: list[StoredCamera]) -> UInt8[np.ndarray, "h w 3"]:
    """The colour image of one camera, BGR.

    Args:
        stored: with an image.
        camera: which one of `cameras`.
        cameras: of the images in `stored.image`, side by side; empty: one, unknown.

    Raises:
        ScanError: the image cannot be decoded, or is not of the size that the calibration says.
    """
    assert stored.image is not None
    place = f"{stored.source}: image"
    image = _slice(colour_image(stored.image, place), camera, max(len(cameras), 1), place)
    size = cameras[camera].size if cameras else (0, 0)
    if all(size) and image.shape[1::-1] != size:
        raise ScanError(
            f"{place}: {image.shape[1]} x {image.shape[0]} pixels, but the calibration is of {size[0]} x {size[1]}. "
            "Was the database reprocessed with decimated images?"
        )
    return image


def depth_of(
    stored: StoredImages, image: UInt8[np.ndarray, "h w 3"], camera: int, cameras: list[StoredCamera]
) -> Float[np.ndarray, "h w"]:
    """The depth of one camera in metres, on the pixels of its colour image: a smaller depth image is enlarged.

    Args:
        stored: with depth.
        image: of that camera.
        camera, cameras: as in `colour_of`.

    Raises:
        ScanError: depth that cannot be decoded, is none, or is of another shape than the image.
    """
    assert stored.depth is not None
    place = f"{stored.source}: depth"
    depth_m = depth_image_m(stored.depth, place)
    if depth_m is None:
        raise ScanError(f"{place}: holds the right image of a stereo camera, not depth.")
    return _enlarged(_slice(depth_m, camera, max(len(cameras), 1), place), image, place)


def _slice(image: np.ndarray, camera: int, n_cameras: int, place: str) -> np.ndarray:
    width = image.shape[1] // n_cameras
    if width * n_cameras != image.shape[1]:
        raise ScanError(f"{place}: {image.shape[1]} columns are not the images of {n_cameras} cameras side by side.")
    return np.ascontiguousarray(image[:, camera * width : (camera + 1) * width])


def _enlarged(depth_m: np.ndarray, image: np.ndarray, place: str) -> np.ndarray:
    """Depth on the pixels of the image; RTAB-Map stores depth at a whole fraction of the image's size too."""
    (h, w), (high, wide) = depth_m.shape, image.shape[:2]
    if (h, w) == (high, wide):
        return depth_m
    if high * w != wide * h or high < h:
        raise ScanError(
            f"{place}: {w} x {h} pixels for an image of {wide} x {high}; expected the same shape, and not more pixels."
        )
    return cv2.resize(depth_m, (wide, high), interpolation=cv2.INTER_NEAREST_EXACT)
