"""A session ready for questions about its labels: what no hypothesis changes, and what one changes."""

import dataclasses
from collections import Counter
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from calibration.calibrate import LearnSettings, learn_options
from calibration.learn import FamilyPriorArrays, LearnOptions, prior_arrays
from jaxgeo.data import Anchors, Survey, Trajectory
from jaxgeo.graph.anchor_table import AnchorTable, anchor_table
from jaxgeo.graph.chain import Chain, chain_of
from jaxgeo.precision import assert_float64
from jaxgeo.solve.correct import Settings


@dataclasses.dataclass(frozen=True)
class Site:
    """Surveyed points, local frame: (n, 3), and their covariances (n, 3, 3)."""

    name: tuple[str, ...]
    point_m: Float[np.ndarray, "n 3"]
    covariance_m2: Float[np.ndarray, "n 3 3"]

    def index(self, name: str) -> int:
        return self.name.index(name)


@dataclasses.dataclass(frozen=True)
class Session:
    """One trajectory's anchors as told, the survey, and what the compiled programs are given of them."""

    anchors: Anchors
    site: Site
    chain: Chain
    table: AnchorTable
    prior: FamilyPriorArrays
    options: LearnOptions

    @property
    def told(self) -> tuple[str, ...]:
        return self.anchors.location


def site_of(survey: Survey, origin_enh_m: Sequence[float] | Float[np.ndarray, "3"]) -> Site:
    """The survey in the local frame: grid minus origin."""
    covariance = survey.sigma_m[:, :, None] ** 2 * np.eye(3)
    return Site(tuple(survey.name), survey.enh_m - np.asarray(origin_enh_m, dtype=np.float64), covariance)


def session_of(
    trajectory: Trajectory, anchors: Anchors, site: Site, settings: Settings, learn: LearnSettings
) -> Session:
    """Positions alone are weighed, and all of them at their full weight.

    A surveyed rotation belongs to the marker that the label names; a robust loss would forgive what is looked for.
    """
    assert_float64()
    settings = dataclasses.replace(settings, loss="none", use_rotation=False)
    learn = dataclasses.replace(learn, observations="both")
    chain = chain_of(trajectory)
    table = anchor_table(anchors, chain, settings.extra_sigma_m)
    return Session(anchors, site, chain, table, prior_arrays(learn.family), learn_options(settings, learn))


def relabelled(anchors: Anchors, places: Sequence[str], site: Site) -> Anchors:
    """The same visits under other names: what is surveyed of them changes, what was seen does not.

    Rotations are told by nothing then (NaN): those surveyed were of the markers that the old names said.
    """
    index = [site.index(name) for name in places]
    first = {name: i for i, name in enumerate(dict.fromkeys(places))}
    seen: Counter[str] = Counter()
    label = []
    for name in places:
        again = seen[name]
        label.append(name if again == 0 else f"{name}_revisit{again if again > 1 else ''}")
        seen[name] += 1
    return dataclasses.replace(
        anchors,
        label=tuple(label),
        location=tuple(places),
        location_index=np.array([first[name] for name in places]),
        surveyed_enh_m=site.point_m[index],
        survey_covariance_m2=site.covariance_m2[index],
        quat_grid_marker_wxyz=np.full_like(anchors.quat_grid_marker_wxyz, np.nan),
    )


def with_anchors(session: Session, anchors: Anchors) -> Session:
    """The same visits, differently labelled."""
    padding = session.table.real.shape[0] - len(anchors)
    location = np.concatenate([anchors.location_index, np.full(padding, -1)])
    surveyed, covariance = np.array(session.table.surveyed_m), np.array(session.table.survey_covariance_m2)
    surveyed[: len(anchors)], covariance[: len(anchors)] = anchors.surveyed_enh_m, anchors.survey_covariance_m2
    table = dataclasses.replace(session.table, surveyed_m=surveyed, survey_covariance_m2=covariance, location=location)
    return dataclasses.replace(session, anchors=anchors, table=table)
