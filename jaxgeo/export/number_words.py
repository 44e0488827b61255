"""Numbers as a reader wants them: sensible digits, the unit beside them, a dash for what is not there."""

import math

import numpy as np

MISSING = "–"
THIN = "\u202f"


def length_words(length_m: float) -> str:
    """A length with its unit, three digits or so: `1.23 m`, `4.5 cm`, `0.8 mm`."""
    if not math.isfinite(length_m):
        return MISSING
    size = abs(length_m)
    if size >= 100.0:
        return f"{length_m:,.0f}{THIN}m".replace(",", THIN)
    if size >= 10.0:
        return f"{length_m:.1f}{THIN}m"
    if size >= 1.0:
        return f"{length_m:.2f}{THIN}m"
    if size >= 0.01:
        return f"{length_m * 100.0:.1f}{THIN}cm"
    return f"{length_m * 1000.0:.1f}{THIN}mm"


class LengthColumn:
    """One unit for all lengths of a table, so that its columns can be compared at a glance.

    Metres to the millimetre where something is 10 m or longer, centimetres to the millimetre from 1 cm on, else
    millimetres to the tenth.
    """

    def __init__(self, *lengths_m: np.ndarray):
        known = np.concatenate([np.abs(np.ravel(x)) for x in lengths_m] or [np.zeros(0)])
        largest = float(known[np.isfinite(known)].max(initial=0.0))
        self.scale, self.unit, self.digits = (1.0, "m", 3) if largest >= 10.0 else (100.0, "cm", 1)
        if largest < 0.01:
            self.scale, self.unit, self.digits = 1000.0, "mm", 1

    def __call__(self, length_m: float) -> str:
        if not math.isfinite(length_m):
            return MISSING
        return decimal(self.scale * length_m, self.digits)


def decimal(value: float, digits: int) -> str:
    """Fixed digits, a true minus sign, never `-0.0`; a dash for NaN."""
    if not math.isfinite(value):
        return MISSING
    text = f"{value:.{digits}f}"
    if float(text) == 0.0:
        text = text.lstrip("-")
    return text.replace("-", "−")


def grouped(value: float, digits: int) -> str:
    """As `decimal`, with thin spaces between thousands: for grid coordinates."""
    if not math.isfinite(value):
        return MISSING
    text = f"{value:,.{digits}f}".replace(",", THIN)
    return text.replace("-", "−")


def percent(share: float) -> str:
    return MISSING if not math.isfinite(share) else f"{100.0 * share:.0f}{THIN}%"


def duration_words(seconds: float) -> str:
    """Seconds below two minutes, else minutes and seconds, else hours and minutes."""
    if seconds < 120.0:
        return f"{seconds:.1f}{THIN}s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 120:
        return f"{minutes}{THIN}min {rest:02d}{THIN}s"
    return f"{minutes // 60}{THIN}h {minutes % 60:02d}{THIN}min"


def number_text(value: object) -> str:
    """Any value of a config, noise or run table: floats to six digits, everything else as it is."""
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: MISSING}[value]
    if isinstance(value, (float, np.floating)):
        return f"{value:.6g}".replace("-", "−") if math.isfinite(value) else MISSING
    if isinstance(value, (list, tuple, np.ndarray)):
        return ", ".join(number_text(v) for v in value)
    return str(value)
