"""Anchors of the visits so far: each made once, and again only where its sightings changed."""

import dataclasses
from collections.abc import Collection, Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from jaxgeo.associate import label_visits, make_anchors
from jaxgeo.associate.centroid import CentroidRule
from jaxgeo.data import Anchors, Survey, Trajectory, Visit
from jaxgeo.errors import SightingError
from jaxgeo.online.visit_log import VisitLog

# One anchor's row of every column of `Anchors` that does not name its visit or location.
COLUMNS = tuple(
    field.name for field in dataclasses.fields(Anchors) if field.name not in ("label", "location", "location_index")
)
Row = dict[str, np.ndarray]


@dataclasses.dataclass(frozen=True)
class Labels:
    """How visits are tied to locations; see `label_visits`.

    Attributes:
        order: the locations in the order in which one moved marker visits them; None: by id.
        locations: marker id -> location, where the two differ.
        ignore: locations that are not used.
    """

    order: tuple[str, ...] | None = None
    locations: Mapping[str, str] = dataclasses.field(default_factory=dict)
    ignore: Collection[str] = ()

    def check(self, survey: Survey) -> None:
        """Refuse locations that the survey does not have.

        Raises:
            SightingError: naming them.
        """
        named = self.order if self.order is not None else tuple(self.locations.values())
        missing = sorted(set(named) - set(survey.name) - set(self.ignore))
        if missing:
            raise SightingError(
                f"the labels name {', '.join(map(repr, missing))}; the survey has {', '.join(survey.name[:20])}. "
                "Mend the name, or survey the point."
            )

    def known(self, marker: str, survey: Survey) -> bool:
        """Whether sightings of this id can serve: by order any id can."""
        if self.order is not None:
            return True
        location = self.locations.get(marker, marker)
        return location in survey.name or location in self.ignore


class AnchorLog:
    """Anchors by visit.

    Attributes:
        outside: sightings of the visits in use that lie outside the trajectory's time.
        said: sentences about single visits.
    """

    def __init__(
        self, survey: Survey, origin_enh_m: Float[np.ndarray, "3"], labels: Labels, rule: CentroidRule | None
    ) -> None:
        labels.check(survey)
        self._survey, self._origin_enh_m = survey, np.asarray(origin_enh_m, dtype=np.float64)
        self._labels, self._rule = labels, rule
        self._made: dict[tuple[str, bytes], Row] = {}
        self.outside = 0
        self.said: tuple[str, ...] = ()

    def anchors(self, visits: Sequence[Visit], log: VisitLog, trajectory: Trajectory) -> Anchors | None:
        """The anchors of these visits, as `make_anchors` makes them of all at once; None where there are none.

        Raises:
            SightingError: more visits than the order names.
        """
        made: dict[tuple[str, bytes], Row] = {}
        kept: list[Visit] = []
        outside = 0
        first_s, last_s = trajectory.stamp_s[0], trajectory.stamp_s[-1]
        for visit in self._labelled(visits):
            rows = visit.sightings
            if visit.start_s < first_s or visit.end_s > last_s:
                stamp_s = log.stamp_s(rows)
                rows = rows[(stamp_s >= first_s) & (stamp_s <= last_s)]
                outside += visit.count - len(rows)
                if len(rows) == 0:
                    continue
            key = (visit.location, rows.tobytes())
            made[key] = self._made[key] if key in self._made else self._make(visit, rows, log, trajectory)
            kept.append(visit)
        self._made, self.outside = made, outside
        return _together(kept, list(made.values())) if made else None

    def _labelled(self, visits: Sequence[Visit]) -> list[Visit]:
        order = self._labels.order
        known = [visit for visit in visits if self._labels.known(visit.marker, self._survey)]
        if order is not None and len(known) <= len(order):
            order = order[: len(known)]
        ignored = [self._labels.locations.get(visit.marker, visit.marker) in self._labels.ignore for visit in known]
        if not known or (order is None and all(ignored)):
            return []
        labelled, _ = label_visits(
            known, self._survey, order=order, locations=self._labels.locations or None, ignore=self._labels.ignore
        )
        return labelled

    def _make(self, visit: Visit, rows: Int[np.ndarray, "m"], log: VisitLog, trajectory: Trajectory) -> Row:
        one = dataclasses.replace(visit, sightings=np.arange(len(rows)))
        anchors, said = make_anchors(
            trajectory, log.sightings(rows), [one], self._survey, origin_enh_m=self._origin_enh_m, rule=self._rule
        )
        self.said = (*self.said, *said)
        return {name: getattr(anchors, name) for name in COLUMNS}


def _together(visits: Sequence[Visit], single: Sequence[Row]) -> Anchors:
    """Anchors of single visits, given in the order of their visits, as one table sorted along the trajectory."""
    order = np.argsort([row["pose_index"][0] for row in single], kind="stable")
    first_visit = {name: i for i, name in enumerate(dict.fromkeys(visit.location for visit in visits))}
    location = tuple(visits[i].location for i in order)
    return Anchors(
        label=tuple(visits[i].label for i in order),
        location=location,
        location_index=np.array([first_visit[name] for name in location]),
        **{name: np.concatenate([single[i][name] for i in order]) for name in COLUMNS},
    )


def padded(anchors: Anchors, capacity: int, last_pose: int) -> tuple[Anchors, Int[np.ndarray, "k"]]:
    """The anchors with rows that say nothing up to `capacity`, and 1 for the real ones.

    What fills up hangs on the last pose of the padded chain.
    """
    count, missing = len(anchors), capacity - len(anchors)
    eye, none = np.broadcast_to(np.eye(3), (missing, 3, 3)), np.full((missing, 4), np.nan)
    fill = {
        "location_index": np.full(missing, -1),
        "pose_index": np.full(missing, last_pose),
        "lever_arm_m": np.zeros((missing, 3)),
        "lever_covariance_m2": eye,
        "surveyed_enh_m": np.zeros((missing, 3)),
        "survey_covariance_m2": eye,
        "quat_body_marker_wxyz": none,
        "quat_grid_marker_wxyz": none,
        "rotation_covariance_rad2": eye,
        "repeatability_m": np.zeros(missing),
        "count": np.zeros(missing, dtype=int),
        "stamp_s": np.zeros(missing),
    }
    columns = {name: np.concatenate([getattr(anchors, name), rows]) for name, rows in fill.items()}
    names = ("",) * missing
    both = Anchors(label=(*anchors.label, *names), location=(*anchors.location, *names), **columns)
    return both, (np.arange(capacity) < count).astype(float)
