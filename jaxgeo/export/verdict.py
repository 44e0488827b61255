"""The verdict on one trajectory, in words: was it worth it, can its uncertainty be believed, what to beware of."""

import dataclasses
import math

import numpy as np

from jaxgeo.export.held_out_stats import HeldOutStats, final_stage, revisit_gap_m, stats_by_stage
from jaxgeo.export.number_words import length_words
from jaxgeo.export.result import TrajectoryResult


@dataclasses.dataclass(frozen=True)
class Verdict:
    """`level` is `good`, `caution` or `bad`; the sentences are plain text."""

    level: str
    sentences: tuple[str, ...]


def verdict(trajectory: TrajectoryResult) -> Verdict:
    """Judge by the held-out errors only: what the anchors are fitted to proves nothing."""
    stage = final_stage(trajectory)
    stats = stats_by_stage(trajectory)
    if stage not in stats or not math.isfinite(stats[stage].mean_m):
        sentence = "There is no held-out error: nothing in this report says how good the corrected trajectory is."
        return Verdict("bad", (sentence, *revisit_sentences(trajectory)))
    level, sentences = gain(stats, stage)
    applied = trajectory.corrections is not None and trajectory.corrections["applied"]
    sentences += learned_or_fixed(stats, corrected=applied)
    for judge in (consistency, failures):
        worse, more = judge(stats[stage])
        level = worst(level, worse)
        sentences += more
    return Verdict(level, (*sentences, *revisit_sentences(trajectory)))


def gain(stats: dict[str, HeldOutStats], stage: str) -> tuple[str, tuple[str, ...]]:
    """Corrected against the one-time similarity, both held out."""
    refined = stats[stage]
    found = (
        f"With its location left out of everything, a marker is predicted {length_words(refined.mean_m)} from its "
        f"surveyed position on average (RMS {length_words(refined.rms_m)}, {refined.n_locations} locations)"
    )
    coarse = stats.get("coarse")
    if coarse is None or not math.isfinite(coarse.mean_m):
        return "caution", (found + ".",)
    against = f"{found}; the one-time similarity alone gives {length_words(coarse.mean_m)}."
    ratio = refined.mean_m / coarse.mean_m
    if ratio < 0.95:
        return "good", (f"{against} The correction takes off {100 * (1 - ratio):.0f} % of the error.",)
    if ratio <= 1.05:
        return "caution", (f"{against} The correction makes no difference that matters.",)
    noise = f", with {stage} noise," if stage == "learned" else ""
    return "bad", (
        f"{against} The correction{noise} makes it worse, by {100 * (ratio - 1):.0f} %: do not use this trajectory as "
        "it is.",
    )


def learned_or_fixed(stats: dict[str, HeldOutStats], *, corrected: bool) -> tuple[str, ...]:
    """Learned noise against fixed noise, on the visits that both have an error of.

    `corrected`: clock or camera too, with the learned noise only; which of the two pays cannot be told then.
    """
    if "learned" not in stats or "fixed" not in stats:
        return ()
    both = np.isfinite(stats["learned"].norm_m) & np.isfinite(stats["fixed"].norm_m)
    if not both.any():
        return ()
    learned, fixed = (float(stats[stage].norm_m[both].mean()) for stage in ("learned", "fixed"))
    pair = f"held out {length_words(learned)} against {length_words(fixed)}"
    if corrected:
        return (
            f"Learned odometry noise and the corrections of clock and camera together: {pair} with fixed noise and the "
            "sightings as recorded.",
        )
    if learned < 0.95 * fixed:
        said = f"Learning the odometry noise pays: {pair} with fixed noise, {100 * (1 - learned / fixed):.0f} % less."
    elif learned <= 1.05 * fixed:
        said = f"Learned and fixed odometry noise do equally well: {pair}."
    else:
        said = (
            f"Learning the odometry noise does not pay here: {pair} with fixed noise, "
            f"{100 * (learned / fixed - 1):.0f} % more (noise.mode: fixed keeps to that)."
        )
    return (said,)


def consistency(stats: HeldOutStats) -> tuple[str, tuple[str, ...]]:
    """Are the errors as large as was predicted?"""
    if stats.n_covariance == 0:
        return "caution", ("No uncertainty was predicted for the held-out markers.",)
    low, high = stats.nees_band
    inside = round(stats.coverage_95 * stats.n_covariance)
    share = f"{inside} of {stats.n_covariance} held-out markers lie inside their predicted 95 % ellipsoid"
    if stats.nees_mean > high:
        factor = math.sqrt(stats.nees_mean / 3.0)
        return "caution", (
            f"The predicted uncertainty is too small: {share}, and errors are about {factor:.1f} times the predicted "
            "ones.",
        )
    if stats.nees_mean < low:
        factor = math.sqrt(3.0 / stats.nees_mean)
        return "caution", (
            f"The predicted uncertainty is too large: {share}, and errors are about {factor:.1f} times smaller than "
            "predicted.",
        )
    return "good", (f"The predicted uncertainty fits the errors found: {share}.",)


def failures(stats: HeldOutStats) -> tuple[str, tuple[str, ...]]:
    """Folds without an answer are missing from every mean."""
    if stats.n_failed == 0:
        return "good", ()
    return "caution", (
        f"{stats.n_failed} of {len(stats.norm_m)} held-out visits have no result (see the result codes); the means "
        "leave them out and may be too good.",
    )


def revisit_sentences(trajectory: TrajectoryResult) -> tuple[str, ...]:
    """How well two visits to one place agree."""
    if not trajectory.revisit:
        return ("No location was visited twice, so the trajectory could not be checked against itself.",)
    name, gap = max(trajectory.revisit.items(), key=lambda item: np.nan_to_num(revisit_gap_m(item[1])[0], nan=np.inf))
    gap_m, held_out = revisit_gap_m(gap)
    where = (
        f"at {name}" if len(trajectory.revisit) == 1 else f"at {name}, the worst of {len(trajectory.revisit)} locations"
    )
    found = f"Visits to one location disagree by {length_words(gap_m)} {where}"
    before = f"one-time similarity: {length_words(gap['coarse_m'])}"
    if held_out:
        return (
            f"{found} when neither visit is tied to it ({before}; with all anchors in: "
            f"{length_words(gap['refined_m'])}).",
        )
    return (f"{found} with all anchors in, which pulls them together ({before}); there is no held-out figure.",)


def worst(*levels: str) -> str:
    return max(levels, key=("good", "caution", "bad").index)
