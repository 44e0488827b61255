"""Stamps written as text: seconds or nanoseconds, in tables or in file names, to float64 seconds."""

import math
import re
from collections.abc import Sequence
from decimal import Decimal, InvalidOperation
from pathlib import Path

from jaxgeo.errors import DetectError

POWERS = {"s": 0, "ms": -3, "us": -6, "ns": -9}
LARGEST_SECONDS = Decimal("1e11")  # the year 5138
SMALLEST_EPOCH_NS = Decimal("1e17")  # the year 1973
_LARGEST_EXPONENT = 25  # of any unit: LARGEST_SECONDS in nanoseconds, and some; of what is smaller than one, the least

# A number that ends the name, alone or behind a separator: seconds have a decimal point, nanoseconds 18 or 19 digits
_IN_NAME = re.compile(r"(?:^|.*[^0-9.])(\d+\.\d+|\d{18,19})$")


def number_of(text: str) -> Decimal | None:
    """A decimal number with all of its digits; None where the text is none, or of a size that no stamp has."""
    try:
        number = Decimal(text)
    except InvalidOperation:
        return None
    if "_" in text or not text.isascii() or not number.is_finite():
        return None
    return number if number.is_zero() or abs(number.adjusted()) <= _LARGEST_EXPONENT else None


def seconds(number: Decimal, unit: str) -> float:
    """The float64 seconds nearest to a number of `s`, `ms`, `us` or `ns`.

    At 1.4e18 ns a float64 is off by up to 128 ns before it is divided: hence decimals.
    """
    return float(number.scaleb(POWERS[unit]))


def unit_of(numbers: Sequence[Decimal], place: str) -> str:
    """`s` or `ns`, by the size of stamps that do not say their unit.

    Raises:
        DetectError: they are of neither size.
    """
    if all(abs(number) < LARGEST_SECONDS for number in numbers):
        return "s"
    if all(number >= SMALLEST_EPOCH_NS for number in numbers):
        return "ns"
    odd = next(number for number in numbers if abs(number) >= LARGEST_SECONDS)
    raise DetectError(
        f"{place}: stamp {str(odd)[:40]} is neither of the size of seconds nor of nanoseconds since 1970. Say the unit "
        "in the header: stamp_s, stamp_ms, stamp_us or stamp_ns."
    )


def stamp_in_name(path: Path) -> float | None:
    """The stamp that a file's name ends with, seconds; None where there is none.

    `1305031102.175304.png` and `left_12.500.jpg` hold seconds, `1403636579763555584.png` nanoseconds. Other whole
    numbers count frames: `000123.png` has no stamp.
    """
    found = _IN_NAME.match(path.stem)
    if not found:
        return None
    text = found.group(1)
    return seconds(Decimal(text), "s" if "." in text else "ns")


def check_rate(path: str | Path, rate_hz: float | None, start_s: float | None) -> None:
    """Refuse a rate or a start that is no usable number.

    Raises:
        DetectError: `rate_hz` is not positive, or one of them is not finite.
    """
    if rate_hz is not None and not (math.isfinite(rate_hz) and rate_hz > 0):
        raise DetectError(f"{path}: rate_hz is {rate_hz}, expected a positive number of images a second.")
    if start_s is not None and not math.isfinite(start_s):
        raise DetectError(f"{path}: start_s is {start_s}, expected seconds.")
