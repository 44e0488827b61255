"""Padding to size buckets, so that sessions of similar length share one compiled program."""

import numpy as np


def bucket_size(count: int, smallest: int = 16) -> int:
    """The next power of two that holds `count` rows, at least `smallest`."""
    return max(smallest, 1 << max(count - 1, 0).bit_length())


def pad_rows(rows: np.ndarray, size: int) -> np.ndarray:
    """Append copies of the last row up to `size`: valid values, to be masked or cut off by the caller."""
    return np.concatenate([rows, np.repeat(rows[-1:], size - rows.shape[0], axis=0)])
