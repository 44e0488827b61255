"""What a LiDAR and an RGB-D camera deliver, one at a time."""

import dataclasses

import numpy as np
from jaxtyping import Float, UInt8


@dataclasses.dataclass(frozen=True)
class Scan:
    """One LiDAR scan, in the sensor's own frame.

    Attributes:
        stamp_s: the time of the pose that the scan gets, seconds.
        points_m: (n, 3) finite, without the returns of nothing (zeros).
        time_s: (n,) each point's time minus `stamp_s`; None where points carry no times.
        intensity: (n,); None where there is none.
        source: file and scan, for messages.
        index: its place in its source, counted from 0, unreadable scans included.
    """

    stamp_s: float
    points_m: Float[np.ndarray, "n 3"]
    time_s: Float[np.ndarray, "n"] | None
    intensity: Float[np.ndarray, "n"] | None
    source: str
    index: int

    def __len__(self) -> int:
        return len(self.points_m)


@dataclasses.dataclass(frozen=True)
class RgbdFrame:
    """One colour image and the depth image registered to it.

    Attributes:
        stamp_s: of the colour image, seconds.
        image: (h, w, 3) BGR.
        depth_m: (h, w) float32 along the optical axis, on the pixels of `image`; 0 where there is none.
        source: file and frame, for messages.
        index: its place in its source, counted from 0.
    """

    stamp_s: float
    image: UInt8[np.ndarray, "h w 3"]
    depth_m: Float[np.ndarray, "h w"]
    source: str
    index: int
