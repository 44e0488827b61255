"""One sentence on what was done to a trajectory: in which coordinates, with how many anchors, with which noise."""

from typing import Any

from jaxgeo.export.noise_words import COMPONENT, MODEL, noise_number, single_axis
from jaxgeo.export.number_words import percent
from jaxgeo.export.result import SessionResult, TrajectoryResult

# A kind of noise that is probably not there is not told here; the section on the noise has all of them.
TOLD_FROM = 0.5
# The fixed noise's values by the components that say them.
FIXED = {
    "trans_m_per_sqrt_m": "sigma_trans_m_per_sqrt_m",
    "rot_rad_per_sqrt_m": "sigma_rot_rad_per_sqrt_m",
    "turn_rad_per_sqrt_rad": "sigma_turn_rad_per_sqrt_rad",
    "log_scale": "sigma_log_scale",
    "bias_trans_m_per_m": "sigma_bias_trans_m_per_m",
    "bias_rot_rad_per_m": "sigma_bias_rot_rad_per_m",
}


def what_was_done(result: SessionResult, trajectory: TrajectoryResult) -> str:
    """Plain text."""
    anchors, frame = trajectory.anchors, result.frame
    n = len(set(anchors.location))
    where = f"{frame.crs} ({frame.crs_name})" if frame.has_datum else "the site frame"
    learned = trajectory.noise.get("learned")
    noise = learned_words(learned) if learned is not None else fixed_words(trajectory.noise.get("fixed", {}))
    return (
        f"Done: one similarity for the whole trajectory, then a correction pose by pose, in {where}, with "
        f"{len(anchors)} visits to {n} surveyed locations. {noise}"
    )


def learned_words(learned: dict[str, Any]) -> str:
    """The learned noise: its most probable model, and its values where they are probably there."""
    best = learned["models"][0]
    told = [s for s in learned["sigmas"] if s["probability"] >= TOLD_FROM and not single_axis(s["component"])]
    values = {s["component"]: s["median"] for s in told}
    return (
        f"The odometry's noise was learned from this session; the most probable of {len(learned['models'])} models: "
        f"{MODEL.get(best['name'], best['name'])} ({percent(best['weight'])}){listed(values)}."
    )


def fixed_words(fixed: dict[str, Any]) -> str:
    """The fixed noise; of three axes the largest. Noise of another session's file is named."""
    if "session" in fixed:
        return f"The odometry's noise was taken from session {fixed['session']}, trajectory {fixed['trajectory']}."
    values = {name: largest(fixed[key]) for name, key in FIXED.items() if key in fixed}
    return f"The odometry's noise was fixed beforehand{listed({k: v for k, v in values.items() if v > 0.0})}."


def largest(value: float | list[float]) -> float:
    return max(value) if isinstance(value, list) else float(value)


def listed(values: dict[str, float]) -> str:
    """`: random position drift 20 cm after 100 m, ..`, one sigma each."""
    known = [name for name in COMPONENT if name in values]
    said = [f"{COMPONENT[name].name} {noise_number(name, values[name])} {COMPONENT[name].when}" for name in known]
    return f"; one sigma: {', '.join(said)}" if said else ""
