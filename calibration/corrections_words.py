"""Corrections as rows for a report: estimate, interval, whether the motion shows it, and if not, what motion would."""

import dataclasses

import numpy as np

from calibration.corrections import CorrectionEstimate
from jaxgeo.solve.corrections import ARM, CORRECTIONS, N_CORRECTIONS, TIME

# Posterior over prior width: up to the first a correction is observable, up to the second weakly so, beyond it not.
OBSERVABLE, WEAKLY = 0.05, 0.5
# A second offset this probable beside the best leaves open which of the two it is.
LIKELY_RIVAL = 0.05
# Above this correlation two corrections are called inseparable.
_TOGETHER = 0.8
# A body axis that swings less than this in the map leaves its arm the same vector all through the session.
_LITTLE_TURN = 0.3
_SIGMA_95 = 1.96
_SHOWN = {"s": (1e3, "ms"), "m": (1e3, "mm"), "rad": (1e3, "mrad")}


@dataclasses.dataclass(frozen=True)
class CorrectionRow:
    """One correction.

    Attributes:
        name: one of `CORRECTIONS`, with its unit.
        estimate, sigma, prior_sigma: in that unit.
        observable: "yes", "weakly" or "no".
        sentence: for the user.
    """

    name: str
    estimate: float
    sigma: float
    prior_sigma: float
    observable: str
    sentence: str


@dataclasses.dataclass(frozen=True)
class Corrections:
    """What is reported of a trajectory's corrections: a row for each that was estimated, and where it came from."""

    rows: tuple[CorrectionRow, ...]
    visits: int
    sightings: int
    rival_s: float | None

    @property
    def any_observable(self) -> bool:
        return any(row.observable != "no" for row in self.rows)


def corrections_of(found: CorrectionEstimate) -> Corrections:
    """The rows, in the order of `CORRECTIONS`."""
    open_clock = found.rival_s is not None and found.rival_odds > LIKELY_RIVAL
    rows = [_row(found, i, open_clock=open_clock) for i in range(N_CORRECTIONS) if found.prior_sigma[i] > 0]
    return Corrections(tuple(rows), found.visits, found.sightings, found.rival_s if open_clock else None)


def _row(found: CorrectionEstimate, i: int, *, open_clock: bool) -> CorrectionRow:
    estimate, sigma, prior = float(found.value[i]), float(found.sigma[i]), float(found.prior_sigma[i])
    share = sigma / prior
    observable = "yes" if share <= OBSERVABLE else "weakly" if share <= WEAKLY else "no"
    if i == TIME and open_clock:
        observable = "no"
    name, unit = CORRECTIONS[i].rsplit("_", 1)
    factor, small = _SHOWN[unit]
    name = name.replace("_", " ")
    figure = f"{factor * estimate:+.1f} {small} (standard deviation {factor * sigma:.1f}, before {factor * prior:.0f})"
    parts = [f"{name}: {_VERDICT[observable]}, {figure}"]
    if i == TIME and open_clock and found.rival_s is not None:
        parts.append(
            f"an offset of {factor * found.rival_s:+.0f} {small} fits nearly as well "
            f"(odds {found.rival_odds:.2f}): more motion, or a smaller prior width, would decide"
        )
    elif observable == "yes" and abs(estimate) > _SIGMA_95 * sigma:
        parts.append("it differs from zero")
    elif observable != "yes":
        parts.append(_motion_wanted(found, i))
    other = _inseparable(found, i)
    if other is not None:
        parts.append(other)
    return CorrectionRow(CORRECTIONS[i], estimate, sigma, prior, observable, "; ".join(parts) + ".")


_VERDICT = {"yes": "observable", "weakly": "weakly observable", "no": "not observable"}


def _motion_wanted(found: CorrectionEstimate, i: int) -> str:
    motion = found.motion
    if i == TIME:
        return (
            f"while it saw markers the rig moved at {motion.speed_m_s:.2f} m/s and turned at "
            f"{np.degrees(motion.turn_rad_s):.0f} deg/s, so that a second of offset moves a marker by "
            f"{motion.smear_m_s:.2f} m, {motion.varied_m_s:.2f} m of it not alike all through a visit: passing markers "
            "briskly, from both sides, or turning to and fro before them, would show it"
        )
    if i in range(N_CORRECTIONS)[ARM]:
        swing = motion.axis_turn[i - 1]
        if swing < _LITTLE_TURN:
            return (
                f"this body axis pointed the same way in all visits (it swung by {swing:.2f} of 1), so that an arm "
                "along it only shifts the whole frame: tilting the rig at the markers would show it"
            )
        return (
            "the sightings scatter too much for the turns that there were: seeing one marker from several headings, or "
            "turning about while it is in view, would show it"
        )
    return (
        "a turned camera moves a marker by its distance times the angle: seeing markers from near and far, on all "
        "sides of the rig, would show it"
    )


def _inseparable(found: CorrectionEstimate, i: int) -> str | None:
    """The correction that this one cannot be told from, if there is one."""
    scale = np.where(found.sigma > 0, found.sigma, 1.0)
    correlation = found.covariance[i] / (scale[i] * scale)
    correlation[i] = 0.0
    other = int(np.argmax(np.abs(correlation)))
    if abs(correlation[other]) < _TOGETHER:
        return None
    kind = "where it changes its heading and its distance to the markers"
    return (
        f"it moves together with {CORRECTIONS[other].rsplit('_', 1)[0].replace('_', ' ')} (correlation "
        f"{correlation[other]:+.2f}): only motion {kind} parts them"
    )
