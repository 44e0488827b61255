"""Whether the predicted uncertainty was right: one sigma against the error that the held-out visit really had."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from eval.figures.picture import Picture
from eval.figures.series_style import series_marker, titled
from jaxgeo.export.figure_style import figure_style, length_unit
from jaxgeo.export.held_out_stats import chi_square_quantile

SIDE_IN = 5.4


def predicted_achieved(
    rows: Mapping[str, tuple[Float[np.ndarray, "_"], Float[np.ndarray, "_"]]], simulated: bool = False
) -> Picture:
    """Both axes logarithmic and of one scale; the legend counts how many visits lie inside the band.

    Args:
        rows: by the name in the legend: predicted one sigma of every held-out visit, the square root of the trace of
            its 3 x 3 covariance, and the length of its error; metres. Visits with NaN are left out.
    """
    with figure_style():
        known = {name: _known(*pair) for name, pair in rows.items()}
        value = np.concatenate([np.concatenate(pair) for pair in known.values()]) if known else np.zeros(0)
        scale, unit = length_unit(float(np.median(value)) if value.size else 1.0)
        low, high = (float(value.min()), float(value.max())) if value.size else (0.1, 10.0)
        low, high = 0.6 * scale * low, 1.7 * scale * high
        below_in = 0.62 + 0.2 * (len(known) + 2)
        width_in, height_in = SIDE_IN + 1.0, SIDE_IN + below_in + 0.4
        figure = Figure(figsize=(width_in, height_in))
        axes = figure.add_axes((0.8 / width_in, below_in / height_in, SIDE_IN / width_in, SIDE_IN / height_in))
        axes.set(xscale="log", yscale="log", xlim=(low, high), ylim=(low, high))
        line = np.array([low, high])
        band = ratio_band()
        label = f"95 % of errors of a right prediction: {band[0]:.2f} to {band[1]:.2f} sigma"
        axes.fill_between(line, band[0] * line, band[1] * line, color="#0072B2", alpha=0.12, linewidth=0, label=label)
        axes.plot(line, line, color="#444444", linewidth=1.0, label="error as large as predicted")
        for i, (name, (sigma_m, error_m)) in enumerate(known.items()):
            ratio = error_m / sigma_m
            inside = int(((ratio >= band[0]) & (ratio <= band[1])).sum())
            style = {"markersize": 7, "markeredgecolor": "white", "markeredgewidth": 0.6, "zorder": 4}
            count = f"{name}: {inside} of {len(ratio)} inside"
            axes.plot(scale * sigma_m, scale * error_m, label=count, **style, **series_marker(i))
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 3000.0 * low else (1.0,)))
            axis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
            axis.set_minor_formatter(NullFormatter())
        axes.set_xlabel(f"Predicted sigma in space [{unit}], log scale")
        axes.set_ylabel(f"Held-out error in space [{unit}], log scale")
        axes.set_title(titled("Predicted and achieved, every held-out visit", simulated), loc="left")
        axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.5 / SIDE_IN), ncol=1, borderaxespad=0.0)
        return Picture(figure)


def ratio_band(probability: float = 0.95, degrees: int = 3) -> tuple[float, float]:
    """Band that the length of an error, over the root of its covariance's trace, keeps with this probability.

    Of an error alike in all `degrees` directions: |e|^2 / sigma^2 is chi-square with `degrees` degrees of freedom and
    the trace is degrees * sigma^2. An error with one large direction has a wider band.
    """
    tail = (1.0 - probability) / 2.0
    low, high = (chi_square_quantile(p, degrees) / degrees for p in (tail, 1.0 - tail))
    return float(np.sqrt(low)), float(np.sqrt(high))


def _known(sigma_m: np.ndarray, error_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The visits that have both, above zero: the others have no place on logarithmic axes."""
    sigma_m, error_m = np.asarray(sigma_m, dtype=float), np.asarray(error_m, dtype=float)
    good = np.isfinite(sigma_m) & np.isfinite(error_m) & (sigma_m > 0.0) & (error_m > 0.0)
    return sigma_m[good], error_m[good]
