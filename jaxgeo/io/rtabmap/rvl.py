"""RVL, the run-length code of 16-bit depth images (Wilson, "Fast lossless depth image compression", ISS 2017).

The stream is of nibbles, eight to a little-endian 32-bit word, the highest first. A number takes three bits of each
nibble, the lowest three first; the fourth bit says that more follow. Numbers come as: count of zeros, count n of
non-zeros, then n differences to the non-zero pixel before, folded to be positive (0, -1, 1, -2, ...); and so on until
all pixels are there.
"""

import numpy as np
from jaxtyping import Int, UInt16

_SHIFTS = np.arange(28, -4, -4, dtype=np.uint32)
_MOST_NIBBLES = 10  # of one number: 30 bits


def decode_rvl(data: bytes, n_pixels: int) -> UInt16[np.ndarray, "n_pixels"]:
    """The pixels of an RVL stream.

    Raises:
        ValueError: the stream ends before all pixels are there, or holds more; says which.
    """
    values = _numbers(data)
    starts, runs = [], []
    at, filled = 0, 0
    while filled < n_pixels:
        if at + 2 > len(values):
            raise ValueError(f"the stream ends after {filled} of {n_pixels} pixels")
        zeros, count = int(values[at]), int(values[at + 1])
        at += 2
        if filled + zeros + count > n_pixels or at + count > len(values):
            raise ValueError(f"a run of {zeros} + {count} pixels after {filled} of {n_pixels}")
        if zeros + count == 0:
            raise ValueError(f"an empty run after {filled} of {n_pixels} pixels")
        starts.append(filled + zeros)
        runs.append(values[at : at + count])
        at += count
        filled += zeros + count
    pixels = np.zeros(n_pixels, dtype=np.uint16)
    folded = np.concatenate(runs) if runs else np.empty(0, dtype=np.int64)
    depth = np.cumsum((folded >> 1) ^ -(folded & 1))
    lengths = [len(run) for run in runs]
    offset = np.repeat(np.array(starts, dtype=np.int64) - np.cumsum([0, *lengths[:-1]])[: len(lengths)], lengths)
    pixels[np.arange(len(depth)) + offset] = depth.astype(np.uint16)
    return pixels


def _numbers(data: bytes) -> Int[np.ndarray, "m"]:
    words = np.frombuffer(data[: len(data) // 4 * 4], dtype="<u4")
    nibbles = ((words[:, None] >> _SHIFTS) & 15).ravel().astype(np.int64)
    ends = np.flatnonzero(nibbles < 8)
    if not len(ends):
        return np.empty(0, dtype=np.int64)
    starts = np.concatenate([[0], ends[:-1] + 1])
    lengths = ends - starts + 1
    if (lengths > _MOST_NIBBLES).any():
        raise ValueError("a number of more than 30 bits")
    nibbles = nibbles[: ends[-1] + 1]
    place = np.arange(len(nibbles)) - np.repeat(starts, lengths)
    return np.add.reduceat((nibbles & 7) << (3 * place), starts)
