"""The learned odometry noise: what was learned, how sure that is, and what it means for the path.

`learned` is the part of noise.json of that name, see `jaxgeo.export.noise_file`.
"""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from jaxgeo.export.drift_plot import drift_plot
from jaxgeo.export.noise_words import COMPONENT, MODEL, in_words, noise_number, single_axis
from jaxgeo.export.number_words import MISSING, decimal, length_words, percent
from jaxgeo.export.profile_plot import profile_plot
from jaxgeo.export.report_page import bullets, details, figure, paragraph, table
from jaxgeo.export.result import DriftGrowth

SOURCE = {
    "both": "the contradictions between the anchors, and between visits to one place",
    "anchors": "the contradictions between the anchors",
    "revisit": "the differences between visits to one place, without using its coordinates",
}


def noise_section(name: str, learned: dict[str, Any], growth: DriftGrowth | None) -> Iterator[str]:
    """Tables, sentences and figures of one trajectory."""
    yield paragraph(introduction(learned))
    if learned["sentences"]:
        yield bullets([in_words(sentence) for sentence in learned["sentences"]])
    yield sigma_table(learned)
    axes = [sigma for sigma in learned["sigmas"] if single_axis(sigma["component"])]
    if axes:
        yield details("Random drift axis by axis", sigma_table({**learned, "sigmas": axes}, axes=True))
    yield model_table(learned)
    if growth is not None:
        yield figure(drift_plot(growth), f"Drift growth of {name}", drift_caption(growth))
    if learned.get("profiles"):
        yield figure(
            profile_plot(learned["profiles"]),
            f"Profile likelihoods of {name}",
            "How much worse the best explanation becomes (log-likelihood) when one kind of noise is held at a value: "
            "The values under the dotted line are the 95 % range. Solid: with the prior; dashed: what the data "
            "alone say. Where a dashed curve stays low to one side, the data do not bound that noise on that side. "
            f"All for the most probable model, {learned['models'][0]['name']}.",
        )


def introduction(learned: dict[str, Any]) -> str:
    """What was learned, from what."""
    best = learned["models"][0]
    n = learned["n_contrasts"]
    return (
        f"The noise of this odometry was learned from {SOURCE[learned['observations']]}: {n} independent "
        f"{'number' if n == 1 else 'numbers'}, starting from what is usual for {learned['kind']} odometry. "
        f"The most probable of {len(learned['models'])} models is '{best['name']}' "
        f"({MODEL.get(best['name'], best['name'])}), with {percent(best['weight'])}; all of them were used, each with "
        "its weight."
    )


def sigma_table(learned: dict[str, Any], *, axes: bool = False) -> str:
    """Every kind of noise: one sigma before and after."""
    kept = [s for s in learned["sigmas"] if single_axis(s["component"]) == axes]
    order = list(COMPONENT)
    kept.sort(key=lambda s: order.index(s["component"]) if s["component"] in order else len(order))
    rows = []
    for s in kept:
        words = COMPONENT.get(s["component"])
        rows.append(
            [
                words.name if words else s["component"],
                words.when if words else "",
                noise_number(s["component"], s["prior_median"]),
                factor(s["prior_log_sd"]),
                noise_number(s["component"], s["median"]),
                f"{noise_number(s['component'], s['low_95'])} … {noise_number(s['component'], s['high_95'])}",
                factor(s["log_sd"]),
                percent(s["probability"]),
            ]
        )
    return table(
        "Standard deviation of every kind of noise, before (prior) and after learning; ×÷: known to this factor, 95 %",
        ["Kind of noise", "stated", "median", "×÷", "median", "95 % range", "×÷", "probability that it is there"],
        rows,
        groups=[("", 2), ("Before", 2), ("Learned", 3), ("", 1)],
        text_columns=(0, 1),
    )


def factor(log_sd: float) -> str:
    """The factor within which a sigma is known, 95 %."""
    value = math.exp(1.96 * log_sd) if log_sd < 300 else math.inf
    if not math.isfinite(value):
        return MISSING
    return decimal(value, 1 if value < 20 else 0)


def model_table(learned: dict[str, Any]) -> str:
    """The models that were weighed against each other."""
    rows = [
        [
            m["name"],
            MODEL.get(m["name"], ""),
            percent(m["weight"]) if m["weight"] >= 0.005 or m["weight"] == 0 else "below 1 %",
            *(
                decimal(m[key], 1) if m["converged"] and m[key] is not None else MISSING
                for key in ("log_evidence", "log_predictive")
            ),
            "yes" if m["converged"] else "no",
        ]
        for m in learned["models"]
    ]
    return table(
        "Models and their weights: by evidence, and by how well each location is foretold from the others "
        "(logarithms, relative to the best)",
        ["Model", "it has", "weight", "evidence", "foretelling", "fitted"],
        rows,
        text_columns=(0, 1),
    )


def drift_caption(growth: DriftGrowth) -> str:
    """The figure's main number in words, and how to read the points."""
    far = float(growth.distance_m[-1])
    at = 100.0 if far > 100.0 else far
    fixed = length_words(float(np.interp(at, growth.distance_m, growth.fixed_m)))
    if growth.learned_m is None or growth.learned_band_m is None:
        said = f"Over {length_words(at)} the odometry alone is expected to drift by {fixed}."
    else:
        middle = float(np.interp(at, growth.distance_m, growth.learned_m))
        low, high = (float(np.interp(at, growth.distance_m, end)) for end in growth.learned_band_m)
        said = (
            f"Over {length_words(at)} the odometry alone is expected to drift by {length_words(middle)} (one sigma; "
            f"95 % range {length_words(low)} … {length_words(high)}); the fixed noise says {fixed}."
        )
    return (
        f"{said} Points: by how much odometry carried on from the first anchor misses each other one, in the frame of "
        "the one-time similarity. That fit turns the path as a whole, so far points lie rather below the curve, near "
        "ones perhaps above it; points far above it all along would say that the noise is set too small."
    )
