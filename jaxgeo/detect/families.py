"""Families of markers (dictionaries): their codes, how far these lie apart, and which way up they are printed.

Bits come from OpenCV's dictionaries. OpenCV keeps the AprilTag families turned by half a turn against the prints that
AprilTag itself gives out (seen on photographs of such prints), so that is undone here: corners then start at the lower
left of the print, as AprilTag's own detector and TagSLAM count them.
"""

import difflib
import functools
import math

import cv2
import equinox as eqx
import numpy as np
from jaxtyping import Int, UInt64

from jaxgeo.errors import DetectError

# Chance that a quadrilateral of random cells reads as some id; decides how many wrong bits a family can bear.
RANDOM_READING = 3e-4


class Family(eqx.Module):
    """Codes of one dictionary.

    Attributes:
        name: as in `FAMILIES`.
        cells: inner cells along a side; the black border adds one on each.
        codes: (m, 4) bits of every id, row by row from the upper left, lowest bit first, seen after 0 .. 3 quarter
            turns of the print, counter-clockwise.
        max_hamming: most bits that may be corrected: distances between codes allow it, and random cells
            read as an id less often than `RANDOM_READING` (or none may be corrected).
        plain: ids that other things read as: codes so plain that windows, screens and shelves show them, and every id
            of a family that has too many for its bits (4x4_1000: one in 16 of all random codes is an id).
    """

    name: str
    cells: int
    codes: UInt64[np.ndarray, "m 4"]
    max_hamming: int
    plain: frozenset[int]


def _dictionary_names() -> dict[str, int]:
    names = {}
    for constant in dir(cv2.aruco):
        if constant.startswith("DICT_"):
            names[constant.removeprefix("DICT_").lower()] = getattr(cv2.aruco, constant)
    return names


_DICTIONARIES = _dictionary_names()
FAMILIES: tuple[str, ...] = tuple(sorted(_DICTIONARIES))
"""OpenCV's dictionary names in lower case: `apriltag_36h11`, `aruco_mip_36h12`, `aruco_original`, `4x4_50` .."""

_WRITTEN_OTHERWISE = {"tag36h11": "apriltag_36h11", "tag36h10": "apriltag_36h10", "tag25h9": "apriltag_25h9"} | {
    "tag16h5": "apriltag_16h5",
    "36h11": "apriltag_36h11",
}


def family_name(written: str) -> str:
    """The name in `FAMILIES` that a user means: `DICT_4X4_50`, `tag36h11`, `AprilTag_36h11` are understood.

    Raises:
        DetectError: no such family; the nearest names are given.
    """
    name = written.strip().lower().removeprefix("dict_")
    name = _WRITTEN_OTHERWISE.get(name, name)
    if name in _DICTIONARIES:
        return name
    near = difflib.get_close_matches(name, FAMILIES, n=3, cutoff=0.5)
    hint = f"did you mean {' or '.join(near)}?" if near else f"expected one of {', '.join(FAMILIES)}."
    raise DetectError(f"marker family {written!r} is not known; {hint}")


def dictionary(name: str) -> cv2.aruco.Dictionary:
    """OpenCV's dictionary of a family."""
    return cv2.aruco.getPredefinedDictionary(_DICTIONARIES[family_name(name)])


@functools.cache
def family(name: str) -> Family:
    """The codes of a family by its name in `FAMILIES`."""
    name = family_name(name)
    opencv = dictionary(name)
    n = int(opencv.markerSize)
    upright = np.stack([_bits(opencv, marker, n) for marker in range(opencv.bytesList.shape[0])])
    if name.startswith("apriltag"):
        upright = upright[:, ::-1, ::-1]
    turned = np.stack([np.rot90(upright, quarter, axes=(1, 2)) for quarter in range(4)], axis=1)
    return Family(
        name=name,
        cells=n,
        codes=pack(turned.reshape(len(upright), 4, n * n)),
        max_hamming=_max_hamming(len(upright), n * n, int(opencv.maxCorrectionBits)),
        plain=frozenset(np.flatnonzero((_changes(upright) < _PLAIN_CHANGES) | _too_many(len(upright), n * n)).tolist()),
    )


def pack(bits: Int[np.ndarray, "... k"]) -> UInt64[np.ndarray, "..."]:
    """Bits (white 1) as one number, lowest first; k <= 64."""
    weights = np.uint64(1) << np.arange(bits.shape[-1], dtype=np.uint64)
    return (bits.astype(np.uint64) * weights).sum(axis=-1, dtype=np.uint64)


def _bits(opencv: cv2.aruco.Dictionary, marker: int, n: int) -> Int[np.ndarray, "n n"]:
    picture = cv2.aruco.generateImageMarker(opencv, marker, n + 2)
    return (picture[1:-1, 1:-1] > 127).astype(np.int64)


def _too_many(ids: int, bits: int) -> bool:
    return 4 * ids / 2**bits > RANDOM_READING


def _max_hamming(ids: int, bits: int, correctable: int) -> int:
    best, readings = 0, 0
    for wrong in range(correctable + 1):
        readings += math.comb(bits, wrong)
        if 4 * ids * readings / 2**bits <= RANDOM_READING:
            best = wrong
    return best


# Of all pairs of neighbouring inner cells, the share that differ: a code of random bits has one half. Among the false
# readings of cluttered photographs those below this share were the common ones.
_PLAIN_CHANGES = 0.2


def _changes(upright: Int[np.ndarray, "m n n"]) -> np.ndarray:
    along = np.mean(upright[:, :, 1:] != upright[:, :, :-1], axis=(1, 2))
    down = np.mean(upright[:, 1:] != upright[:, :-1], axis=(1, 2))
    return (along + down) / 2
