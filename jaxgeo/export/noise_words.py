"""Noise components and models in a surveyor's words, with numbers that can be pictured: drift over 100 m."""

import dataclasses
import math
import re

from jaxgeo.export.number_words import MISSING, THIN, length_words

_DEGREES = 180.0 / math.pi


@dataclasses.dataclass(frozen=True)
class NoiseWords:
    """`factor` times sigma is what is shown, in `unit` (m, ° or %); `when` says of what."""

    name: str
    when: str
    factor: float
    unit: str


def _random(axis: str, *, turned: bool) -> NoiseWords:
    what = "direction" if turned else "position"
    return NoiseWords(
        f"random {what} drift{axis}", "after 100 m", 10.0 * (_DEGREES if turned else 1.0), "°" if turned else "m"
    )


COMPONENT: dict[str, NoiseWords] = {
    "trans_m_per_sqrt_m": _random("", turned=False),
    "rot_rad_per_sqrt_m": _random("", turned=True),
    "turn_rad_per_sqrt_rad": NoiseWords(
        "random direction drift of turning", "after a full turn", math.sqrt(2.0 * math.pi) * _DEGREES, "°"
    ),
    "log_scale": NoiseWords("wrong scale of the path", "all along", 100.0, "%"),
    "log_turn": NoiseWords("wrong scale of the turns", "all along", 100.0, "%"),
    "bias_trans_m_per_m": NoiseWords("steady position drift", "in every 100 m", 100.0, "m"),
    "bias_rot_rad_per_m": NoiseWords("steady direction drift", "in every 100 m", 100.0 * _DEGREES, "°"),
    "wander_log_scale": NoiseWords("scale that changes on the way", "at any place", 100.0, "%"),
    "wander_trans_m_per_m": NoiseWords("position drift that changes on the way", "if 100 m long", 100.0, "m"),
    "wander_rot_rad_per_m": NoiseWords(
        "direction drift that changes on the way", "if 100 m long", 100.0 * _DEGREES, "°"
    ),
    "bounded_m": NoiseWords("position error that does not grow", "at any place", 1.0, "m"),
    "anchor_factor": NoiseWords("noise of the anchors, beyond what they claim", "of their claim", 100.0, "%"),
    **{f"trans_{axis}_m_per_sqrt_m": _random(f", body {axis}", turned=False) for axis in "xyz"},
    **{f"rot_{axis}_rad_per_sqrt_m": _random(f" about body {axis}", turned=True) for axis in "xyz"},
}
MODEL: dict[str, str] = {
    "white": "random drift and one wrong scale",
    "white + scales": "random drift, wrong scales of path and turns, and a scale that changes",
    "white + bias": "random drift and a steady drift in every metre",
    "white + wander": "random drift, and a drift in every metre that changes on the way",
    "white + bounded": "random drift, and an error that does not grow",
    "bounded": "an error that does not grow, as after loop closure",
}
_NAMES = re.compile("|".join(sorted(map(re.escape, COMPONENT), key=len, reverse=True)))


def single_axis(component: str) -> bool:
    """Whether this is one axis of a group that is told as a whole too."""
    return component.split("_")[1:2] in (["x"], ["y"], ["z"])


def noise_number(component: str, sigma: float) -> str:
    """A sigma as what it makes of the path, with its unit; one that is not known as it is."""
    words = COMPONENT.get(component)
    if words is None:
        return f"{sigma:.2g}"
    value = words.factor * sigma
    if not math.isfinite(value):
        return MISSING
    if words.unit == "m":
        return length_words(value)
    return f"{_two_digits(value)}{'' if words.unit == '°' else THIN}{words.unit}"


def _two_digits(value: float) -> str:
    """Two significant digits, never an exponent."""
    if value <= 0.0:
        return "0"
    digits = max(0, 1 - math.floor(math.log10(value)))
    return f"{value:.{digits}f}"


def in_words(sentence: str) -> str:
    """A sentence with the components' names replaced by what they are called here, in quotes."""
    return _NAMES.sub(lambda found: f"'{COMPONENT[found.group()].name}'", sentence)
