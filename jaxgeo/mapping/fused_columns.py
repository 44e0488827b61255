"""A fused cloud's columns, as clouds in files have them."""

import numpy as np

from jaxgeo.io.clouds.chunk import COLOUR
from jaxgeo.mapping.fusion import FusedCloud


def fused_columns(cloud: FusedCloud) -> dict[str, np.ndarray]:
    """When and from which pose every point was seen, from how many; colour (16 bits) and intensity where known."""
    columns: dict[str, np.ndarray] = {
        "stamp_s": cloud.stamp_s,
        "pose_index": cloud.pose_index.astype(np.int32),
        "hits": cloud.hits.astype(np.int32),
    }
    if cloud.colour is not None:
        full = cloud.colour.astype(np.uint16) * 257  # 8 bits to the full range of 16
        columns |= {name: full[:, axis] for axis, name in enumerate(COLOUR)}
    if cloud.intensity is not None:
        columns["intensity"] = cloud.intensity.astype(np.float32)
    return columns
