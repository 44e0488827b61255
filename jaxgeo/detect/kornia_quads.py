"""Quadrilaterals by the AprilTag detector of kornia_rs (extra `vision`): the only file that imports it.

It finds quads at half scale, in about a third of the time of OpenCV's detector, and fewer of the small ones. Its
corners start where the quad lies in the image, not at the print's own corner, and count pixel edges, not centres: the
code is read again in `reading`, and half a pixel is taken off.
"""

from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from jaxgeo.errors import DetectError

_KINDS = {
    "apriltag_16h5": "tag16_h5",
    "apriltag_25h9": "tag25_h9",
    "apriltag_36h10": "tag36_h10",
    "apriltag_36h11": "tag36_h11",
}


class KorniaQuads:
    """The quads that kornia_rs decodes as AprilTags.

    Raises:
        DetectError: kornia_rs is not installed, or a family is not one of its own.
    """

    def __init__(self, families: tuple[str, ...]):
        foreign = [name for name in families if name not in _KINDS]
        if foreign:
            raise DetectError(
                f"decoder kornia knows {', '.join(_KINDS)}, not {', '.join(foreign)}; use decoder opencv for these."
            )
        try:
            import kornia_rs
        except ImportError:
            raise DetectError(
                "decoder kornia needs kornia_rs, which is not installed: pip install 'jaxgeo[vision]'."
            ) from None
        self._kornia: Any = kornia_rs
        kinds = {kind.name: kind for kind in kornia_rs.apriltag.family.TagFamilyKind.all()}
        self._config = kornia_rs.apriltag.DecodeTagsConfig([kinds[_KINDS[name]] for name in families])
        self._decoders: dict[tuple[int, int], Any] = {}

    def __call__(self, gray: UInt8[np.ndarray, "h w"]) -> Float[np.ndarray, "q 4 2"]:
        """Corners clockwise as seen in the image."""
        if gray.shape not in self._decoders:
            size = self._kornia.image.ImageSize(width=gray.shape[1], height=gray.shape[0])
            self._decoders[gray.shape] = self._kornia.apriltag.AprilTagDecoder(self._config, size)
        decoder = self._decoders[gray.shape]
        found = decoder.decode(np.ascontiguousarray(gray)[..., None])
        corners = np.array([one.quad.corners for one in found], dtype=np.float64).reshape(-1, 4, 2)
        decoder.clear()
        return corners - 0.5
