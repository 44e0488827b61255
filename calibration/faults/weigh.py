"""Hypotheses as arrays, and their log evidence."""

import dataclasses
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from calibration.faults.evidence import Evidence, Labels, evidences
from calibration.faults.hypotheses import FREE, Hypothesis
from calibration.faults.session import Session, Site

# The survey of a location may be off by anything between a hand's breadth and the size of the site, every order of
# magnitude as likely as the next: normal shifts of geometric standard deviations, a factor apart.
SMALLEST_SHIFT_M, SHIFT_FACTOR = 0.3, 2.0
# The position of one visit may be off by this many standard deviations of its prediction.
SHIFT_SDS = np.geomspace(2.0, 50.0, 9)


@dataclasses.dataclass(frozen=True)
class Weighed:
    """A hypothesis and its log evidence; -inf where it fixes no frame (`determined` is false) or no noise was found."""

    hypothesis: Hypothesis
    log_evidence: float
    determined: bool


def weigh(session: Session, hypotheses: Sequence[Hypothesis]) -> list[Weighed]:
    """The log evidence of hypotheses with at most one open visit, whose place was not surveyed.

    A visit that is `shifted` has a density of its own: `log_shift_density`.
    """
    jobs, owner = [], []
    for i, h in enumerate(hypotheses):
        for width_m in location_shifts_m(session.site) if h.kind == "shifted location" else (0.0,):
            jobs.append(labels_of(session, h, width_m))
            owner.append(i)
    if not jobs:
        return []
    found, rows = evidences(session, jobs), np.array(owner)
    return [_gathered(session, h, found, np.flatnonzero(rows == i)) for i, h in enumerate(hypotheses)]


def labels_of(session: Session, hypothesis: Hypothesis, shift_m: float = 0.0) -> Labels:
    """A hypothesis as padded arrays; `shift_m` widens the survey of a shifted location, for all its visits alike."""
    table, site, told = session.table, session.site, session.told
    surveyed, shared = np.array(table.surveyed_m), np.array(table.survey_covariance_m2)
    location, use = np.array(table.location), np.zeros(len(table.real))
    number = {name: i for i, name in enumerate(dict.fromkeys(p for p in hypothesis.places if p != FREE))}
    for i, place in enumerate(hypothesis.places):
        if place == FREE:
            # A number of its own: the others of its location are no revisits of it.
            location[i] = len(number) + i
            continue
        use[i], location[i] = 1.0, number[place]
        if place != told[i]:
            at = site.index(place)
            surveyed[i], shared[i] = site.point_m[at], site.covariance_m2[at]
        if i in hypothesis.visits:
            shared[i] = shared[i] + shift_m**2 * np.eye(3)
    return Labels(jnp.asarray(surveyed), jnp.asarray(shared), jnp.asarray(location), jnp.asarray(use))


def location_shifts_m(site: Site) -> Float[np.ndarray, "s"]:
    """Standard deviations of the shifts that a location's survey may have."""
    size_m = max(float(np.linalg.norm(np.ptp(site.point_m, axis=0))), SHIFT_FACTOR * SMALLEST_SHIFT_M)
    count = 1 + round(np.log(size_m / SMALLEST_SHIFT_M) / np.log(SHIFT_FACTOR))
    return np.geomspace(SMALLEST_SHIFT_M, size_m, count)


def log_shift_density(error_m: Float[np.ndarray, "3"], covariance_m2: Float[np.ndarray, "3 3"]) -> float:
    """Of a surveyed position minus its prediction, where it is off by an unknown shift.

    A mixture of normals N(0, (1 + g^2) C), as Zellner's g-prior (1986): whether a visit fits is asked in the metric in
    which it is known.
    """
    each = [_log_normal(error_m, (1.0 + g**2) * covariance_m2) for g in SHIFT_SDS]
    return float(np.logaddexp.reduce(each)) - float(np.log(len(each)))


def log_somewhere_density(
    point_m: Float[np.ndarray, "3"], covariance_m2: Float[np.ndarray, "3 3"], site: Site
) -> float:
    """Of a marker where nothing was surveyed: normal about the site's middle, twice its variance and 1 m an axis."""
    spread = 2.0 * np.diag(np.var(site.point_m, axis=0)) + np.eye(3)
    return _log_normal(point_m - site.point_m.mean(axis=0), covariance_m2 + spread)


def _log_normal(x: Float[np.ndarray, "3"], covariance: Float[np.ndarray, "3 3"]) -> float:
    log_det = np.linalg.slogdet(2.0 * np.pi * covariance)[1]
    return -0.5 * float(x @ np.linalg.solve(covariance, x) + log_det)


def _gathered(session: Session, h: Hypothesis, found: Evidence, rows: np.ndarray) -> Weighed:
    total = float(np.logaddexp.reduce(found.log_marginal[rows])) - float(np.log(len(rows)))
    determined = bool(found.determined[rows].all())
    for j in (j for j, place in enumerate(h.places) if place == FREE):
        point = np.asarray(found.point_m[rows[0], j])
        covariance = np.asarray(found.error_covariance_m2[rows[0], j])
        if not (np.isfinite(total) and np.isfinite(point).all() and np.isfinite(covariance).all()):
            return Weighed(h, -np.inf, determined)
        total += log_somewhere_density(point, covariance, session.site)
    return Weighed(h, total, determined)
