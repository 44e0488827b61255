"""What every source of RGB-D frames offers."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float, UInt8

from jaxgeo.data import RgbdFrame
from jaxgeo.io.item_source import ItemSource, OnBad, UnreadableItemError


class RgbdSource(ItemSource[RgbdFrame]):
    """Pairs of colour and depth in a fixed order, by stamp, each read when it is its turn. Holds no open file.

    Attributes:
        n_frames: how many pairs there are, unreadable ones included; None where nothing tells (bags).
        on_bad: what an unreadable pair does: `raise` a ScanError, or be left out, counted and warned of (`skip`).
        bad: index -> message of the unreadable pairs met so far.
    """

    n_frames: int | None

    def __init__(self, n_frames: int | None, on_bad: OnBad) -> None:
        super().__init__("frame", on_bad)
        self.n_frames = n_frames

    def frames(self, start: int = 0) -> Iterator[RgbdFrame]:
        """The frames from the one with index `start` on; earlier ones are passed over without decoding their pixels.

        Warns:
            InputWarning: of the first unreadable frame, and of their number at the end, if `on_bad` is `skip`; of
                images without a partner.

        Raises:
            ScanError: `start` is negative; a frame is unreadable and `on_bad` is `raise`.
        """
        return self._items(start)


class UnreadableFrameError(UnreadableItemError):
    """One pair of colour and depth cannot be read; the others may well be."""


def frame_of_images(
    stamp_s: float, image: UInt8[np.ndarray, "h w 3"], depth_m: Float[np.ndarray, "h w"], source: str, index: int
) -> RgbdFrame:
    """The frame of two images that belong together.

    Raises:
        UnreadableFrameError: they are not of one size.
    """
    if image.shape[:2] != depth_m.shape:
        (height, width), (rows, columns) = image.shape[:2], depth_m.shape
        raise UnreadableFrameError(
            f"{source}: colour of {width}×{height} pixels, depth of {columns}×{rows}; expected one size. Register the "
            "depth to the colour camera first (depth_image_proc/register, aligned_depth_to_color)."
        )
    return RgbdFrame(stamp_s, image, depth_m, source, index)
