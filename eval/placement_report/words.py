"""A plan in a surveyor's words."""

import math
import re
from collections.abc import Iterable, Iterator

import numpy as np

from eval.placement.answer import PlacementAnswer, WhatIf
from eval.placement_report.report import PlacementReport, count_of, gain, layout_by, sigma_along_m
from jaxgeo.export.noise_words import COMPONENT, noise_number
from jaxgeo.export.number_words import THIN, duration_words, grouped, length_words
from jaxgeo.georef import LocalFrame

METHOD = {
    "gradient": "gradient search",
    "greedy": "greedy",
    "exhaustive": "best of all choices",
    "exchange": "exchange",
    "equal spacing": "equal spacing",
    "given": "as given",
}
CRITERION = {
    "path": "root mean square over the path, all axes",
    "worst": "least accurate place, all axes",
    "D": "mean axis of the error ellipsoids (geometric)",
    "E": "longest axis of any error ellipsoid",
}
ROBUST = {
    "mixture": "of the mean covariance over the noise sets",
    "mean": "mean over the noise sets",
    "worst": "under the worst of the noise sets",
}
NOT_FIXED = "frame not fixed"
_AXIS = re.compile(r"^(trans|rot)_[xyz]_")


def verdict_words(report: PlacementReport, answer: PlacementAnswer) -> Iterator[str]:
    """What the chosen layout promises, and what the choice was worth."""
    chosen = answer.chosen
    new, stands = count_of(chosen), sum(chosen.standing)
    what = f"{len(chosen.name)} anchors as given" if report.predicted else anchors_words(new, stands)
    sigma = sigma_along_m(answer, chosen)[:, 3]
    worst = int(np.argmax(sigma))
    yield (
        f"With {what}, positions along the path are predicted to {length_words(chosen.accuracy_m['path'])} "
        "(root mean square, all three axes, 1 sigma); at the least accurate place, "
        f"{answer.distance_m[worst]:.0f}{THIN}m along the path, to {length_words(float(sigma[worst]))}."
    )
    if report.predicted:
        return
    yield f"Made small: the {CRITERION[answer.criterion]}. {gain_words(answer)}"
    if answer.starts:
        yield (
            f"The best layout was found by: {METHOD[chosen.method]}. Of {answer.starts} gradient searches from "
            f"different starts, {answer.starts_near_best} ended within 1{THIN}% of the best of them."
        )


def anchors_words(new: int, standing: int) -> str:
    """`5 anchors placed as below and 2 that stand already`."""
    more = f" and {standing} that {'stands' if standing == 1 else 'stand'} already" if standing else ""
    return f"{new} anchor{'s' * (new != 1)} placed as below{more}"


def gain_words(answer: PlacementAnswer) -> str:
    """The plan against equal spacing."""
    even = layout_by(answer, "equal spacing")
    if even is None or answer.chosen.method == "equal spacing":
        return "Equal spacing along the path is the best layout found."
    value = even.accuracy_m[answer.criterion]
    if not math.isfinite(value):
        return "As many anchors at equal spacing along the path would not fix the frame."
    share = 100.0 * gain(answer, answer.chosen)
    better = "hardly better" if share < 0.5 else f"{share:.0f}{THIN}% better"
    return f"As many anchors at equal spacing along the path: {length_words(value)}; the plan is {better}."


def what_if_words(change: WhatIf, frame: LocalFrame) -> str:
    """One change, without what it does."""
    match change.change:
        case "one more":
            assert change.point_m is not None
            east, north, _ = frame.to_grid(change.point_m)
            return f"One more anchor, at E {grouped(east, 1)}, N {grouped(north, 1)}"
        case "one lost":
            return f"Without {change.marker}"
        case "revisit":
            return f"Come back to {change.marker} after the end (+{change.further_m:.0f}{THIN}m)"
        case "better survey":
            return "A survey twice as good (half its sigma)"
        case "longer dwell":
            return "Twice the dwell at every visit (sighting sigma divided by √2)"


def change_words(before_m: float, after_m: float) -> str:
    """`4.2 cm → 3.9 cm`."""
    after = length_words(after_m) if math.isfinite(after_m) else NOT_FIXED
    return f"{length_words(before_m)} → {after}"


def better_words(before_m: float, after_m: float) -> str:
    """`7 % better`, `as good`, `40 % worse`; of the standard deviation."""
    if not math.isfinite(after_m):
        return "–"
    share = 100.0 * (after_m / before_m - 1.0)
    if abs(share) < 0.5:
        return "as good"
    size = f"{abs(share):.0f}{THIN}%" if abs(share) < 1000.0 else f"{after_m / before_m:.0f} times"
    return f"{size} {'worse' if share > 0.0 else 'better'}"


def limit_name(component: str) -> str:
    """What limits the accuracy: a component of the odometry's noise, the survey or the sightings."""
    return {"survey": "survey of the anchors", "sighting": "sighting of the anchors"}.get(
        component, f"odometry: {COMPONENT[component].name}" if component in COMPONENT else component
    )


def noise_words(report: PlacementReport) -> str:
    """Where the noise is from."""
    facts = report.noise
    if facts["file"] is None:
        return f"the usual values of {facts['odometry']} odometry; nothing was learned of this platform"
    return (
        f"learned in session {facts['session']}, trajectory {facts['trajectory']} ({facts['odometry']} odometry, "
        f"{facts['sets']} sets of values: what that session left open is averaged over)"
    )


def noise_pairs(report: PlacementReport) -> Iterator[tuple[str, str]]:
    """Every component that is there, as drift over 100 m; three equal axes once."""
    sigma = {name: value for name, value in report.noise["sigma_median"].items() if value > 0.0}
    for kind, names in by_kind(sigma).items():
        alike = len(names) == 3 and len({sigma[name] for name in names}) == 1
        for name in [kind] if alike else names:
            words = COMPONENT[name]
            yield f"{words.name} ({words.when})", noise_number(name, sigma[names[0] if alike else name])


def by_kind(names: Iterable[str]) -> dict[str, list[str]]:
    """Noise components with the body axes of one kind together: `trans_m_per_sqrt_m`: x, y, z."""
    found: dict[str, list[str]] = {}
    for name in names:
        found.setdefault(_AXIS.sub(r"\1_", name), []).append(name)
    return found


def assumed_pairs(report: PlacementReport) -> Iterator[tuple[str, str]]:
    """What the prediction rests on."""
    given, frame = report.given, report.frame
    stamp_s = report.path.stamp_s
    yield (
        "Path",
        f"{report.path_said}: {length_words(report.path_length_m)}, {duration_words(stamp_s[-1] - stamp_s[0])}",
    )
    where = f"{frame.crs} ({frame.crs_name})" if frame.has_datum else "site frame without a datum"
    yield "Coordinates", f"{where}; easting E, northing N, height h in metres; height: {frame.height}"
    yield "Odometry noise", noise_words(report)
    yield "An anchor is seen from", length_words(given.range_m)
    yield "One visit (each axis)", f"± {length_words(given.sighting_sigma_m)}"
    passes = "counted once: one marker is moved along" if given.most_passes == 1 else "counted every time it is passed"
    yield "An anchor is", f"{passes}; passes within {length_words(given.apart_m)} of path are one visit"
    east, north, height = (length_words(x) for x in given.survey_sigma_m)
    yield "Survey of an anchor (E, N, h)", f"± {east}, {north}, {height}"
    if not report.predicted:
        yield "Anchors may stand", allowed_words(report)
    yield "Accuracy", f"{CRITERION[given.criterion]}; {ROBUST[given.robust]}"


def allowed_words(report: PlacementReport) -> str:
    """Where anchors were allowed."""
    given = report.given
    if given.candidate_m is not None:
        return f"at {len(given.candidate_m)} candidates only"
    above = f", {length_words(given.lift_m)} above it" if given.lift_m else ""
    areas = " and inside the areas drawn" if given.areas_en_m else ""
    return f"at most {length_words(given.reach_m)} from the path in plan{above}{areas}"
