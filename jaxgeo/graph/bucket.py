"""Array sizes rounded up to a few buckets, so that a session of another length reuses compiled programs."""

import numpy as np

SMALLEST_POSES = 128


def pose_bucket(n: int) -> int:
    """Smallest of 128, 160, 192, 224, 256, 320, ... that holds n poses: at most 25 % padding, all divisible by 32."""
    return _bucket(n, SMALLEST_POSES)


def anchor_bucket(k: int) -> int:
    """Smallest of 8, 10, 12, 14, 16, 20, 24, ... that holds k anchors."""
    return _bucket(k, 8)


def _bucket(n: int, smallest: int) -> int:
    if n <= smallest:
        return smallest
    octave = smallest * 2 ** int(np.floor(np.log2((n - 1) / smallest)))
    quarter = octave // 4
    return octave + quarter * int(np.ceil((n - octave) / quarter))
