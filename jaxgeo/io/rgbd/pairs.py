"""Pairing two streams by their stamps."""

import math
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Protocol, TypeVar

from jaxgeo.errors import ScanError
from jaxgeo.io.input_warning import InputWarning


class Stamped(Protocol):
    @property
    def stamp_s(self) -> float: ...


One = TypeVar("One", bound=Stamped)
Other = TypeVar("Other", bound=Stamped)


def nearest_pairs(
    ones: Iterable[One], others: Iterable[Other], max_gap_s: float
) -> Iterator[tuple[One | None, Other | None]]:
    """Members of two streams that are each other's nearest, no farther apart than `max_gap_s`.

    Both streams are ordered by stamp. Gives (one, other) of each pair, (one, None) and (None, other) of what has no
    partner: everything once, two members of each stream held at a time. Of two as near, the earlier counts.
    """
    ones, others = iter(ones), iter(others)
    one, next_one = next(ones, None), next(ones, None)
    other, next_other = next(others, None), next(others, None)
    while one is not None or other is not None:
        pair = _first(one, next_one, other, next_other, max_gap_s)
        yield pair
        if pair[0] is not None:
            one, next_one = next_one, next(ones, None)
        if pair[1] is not None:
            other, next_other = next_other, next(others, None)


def _first(
    one: One | None, next_one: One | None, other: Other | None, next_other: Other | None, max_gap_s: float
) -> tuple[One | None, Other | None]:
    """What comes first: a pair, or the head of one stream alone."""
    if one is None or other is None:
        return one, other
    gap_s = _gap_s(one, other)
    if next_other is not None and _gap_s(one, next_other) < gap_s:
        return None, other
    if next_one is not None and _gap_s(next_one, other) < gap_s:
        return one, None
    if gap_s <= max_gap_s:
        return one, other
    return (one, None) if one.stamp_s < other.stamp_s else (None, other)


def _gap_s(one: Stamped, other: Stamped) -> float:
    return abs(one.stamp_s - other.stamp_s)


def check_gap(path: str | Path, max_gap_s: float) -> None:
    """Refuse a gap that is no time.

    Raises:
        ScanError: it is negative or not finite.
    """
    if not (math.isfinite(max_gap_s) and max_gap_s >= 0):
        raise ScanError(f"{path}: max_gap_s is {max_gap_s}, expected seconds between colour and depth, 0 or more.")


def check_paired(path: str | Path, n_colour: int, n_depth: int, n_pairs: int, how: str) -> None:
    """Refuse images of which none has a partner, and count those that have none.

    Raises:
        ScanError: there is no pair.

    Warns:
        InputWarning: images without a partner.
    """
    if not n_pairs:
        raise ScanError(
            f"{path}: none of {n_colour} colour and {n_depth} depth images has a partner{how}. Are their stamps of "
            "different clocks, or is `max_gap_s` too short?"
        )
    if n_colour > n_pairs or n_depth > n_pairs:
        warnings.warn(
            f"{path}: {n_colour - n_pairs} of {n_colour} colour and {n_depth - n_pairs} of {n_depth} depth images have "
            f"no partner{how} and are left out.",
            InputWarning,
            stacklevel=4,
        )
