"""What the config of one session may say: lengths in metres, times in seconds, angles in radians."""

import re
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from jaxgeo.config.fields import FileName, Name, NonNegative, Positive, Section, Vector, nearest
from jaxgeo.config.inputs import (
    ControlPointSightingsInput,
    CornerSightingsInput,
    FromTrajectorySightingsInput,
    NoiseValues,
    PoseSightingsInput,
    RigInput,
    SightingsInput,
    SurveyInput,
    TrajectoryInput,
)


def _crs(value: Any) -> Any:
    if not isinstance(value, str) or not re.fullmatch(r"local|epsg:\d+(\+\d+)?", value.lower()):
        raise ValueError("expected EPSG:<code>, EPSG:<horizontal>+<vertical>, or local for a site frame")
    return "local" if value.lower() == "local" else value.upper()


def _noise_mode(value: Any) -> Any:
    if value == "learned":
        raise ValueError("noise is not learned by this version; expected fixed (values by odometry kind, or your own)")
    return value


class Visits(Section):
    """How sightings are cut into visits and tied to locations.

    Attributes:
        gap_s: a longer gap between sightings of a marker starts a new visit.
        min_count: visits with fewer sightings are dropped.
        order: the locations in the order visited, where one marker was moved and its id says nothing.
        locations: marker id -> location, where the two differ.
    """

    gap_s: Positive = 5.0
    min_count: Annotated[int, Field(ge=1)] = 1
    order: list[Name] | None = Field(default=None, min_length=1)
    locations: dict[str, Name] = Field(default={})

    @model_validator(mode="after")
    def _check_labels(self):
        if self.order is not None and self.locations:
            raise ValueError("'order' is for markers without ids, 'locations' for markers with ids: remove one")
        return self


class Noise(Section):
    """`mode`: fixed. `values` replace the defaults of every trajectory; a trajectory's own `noise` goes before them."""

    mode: Annotated[Literal["fixed"], BeforeValidator(_noise_mode)] = "fixed"
    values: NoiseValues = NoiseValues()


class Coarse(Section):
    """The one-time similarity. `scale`: estimated, else 1. `gravity`: the map's z axis is up, only yaw is free."""

    scale: bool = True
    gravity: bool = False


class AnchorOptions(Section):
    """How anchors enter the pose graph.

    Attributes:
        loss, loss_width: robust loss on the anchors, and its width in standard deviations.
        use_rotation: use surveyed marker rotations too.
        extra_sigma_m: added (in squares) to every anchor, for systematic errors that scatter does not show.
    """

    loss: Literal["none", "huber", "cauchy", "geman_mcclure"] = "none"
    loss_width: Positive = 3.0
    use_rotation: bool = False
    extra_sigma_m: NonNegative = 0.0


class Solver(Section):
    """`max_steps`: trial steps before the solver gives up."""

    max_steps: Annotated[int, Field(ge=1, le=10_000)] = 50


class Evaluate(Section):
    """`leave_one_out`: hold every location out in turn."""

    leave_one_out: bool = True


class SessionConfig(Section):
    """One session: one survey, its sightings, and one or more trajectories, each corrected on its own.

    Attributes:
        crs: of the survey.
        simulated: every output is labelled simulated.
        origin_enh_m: E, N, h subtracted before anything is estimated; None: the survey's median, rounded to 100 m.
    """

    name: FileName = Field(description="the session's name, used in file names")
    crs: Annotated[str, BeforeValidator(_crs)] = Field(
        description="the survey's coordinate system: EPSG:2169, EPSG:2169+5773, .. or local for a site frame"
    )
    simulated: bool = False
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    origin_enh_m: Vector | None = None
    survey: SurveyInput | None = Field(
        default=None,
        description="the surveyed points: {file: ..}, {points: ..} or {from_trajectory: ..}; none with control_points",
    )
    rig: RigInput | None = None
    sightings: SightingsInput = Field(discriminator="kind", description="the sightings: {kind: .., file: .., ..}")
    visits: Visits = Visits()
    trajectories: dict[FileName, TrajectoryInput] = Field(
        min_length=1, description="the trajectories by name: {icp: {file: .., format: .., odometry: ..}}"
    )
    noise: Noise = Noise()
    coarse: Coarse = Coarse()
    anchors: AnchorOptions = AnchorOptions()
    solver: Solver = Solver()
    evaluate: Evaluate = Evaluate()

    @model_validator(mode="after")
    def _check_rig(self):
        match self.sightings:
            case CornerSightingsInput() if self.rig is None:
                raise ValueError("sightings of kind 'corners' are pixels and need a camera: give 'rig'")
            case PoseSightingsInput(frame=frame) if frame != "body" and self.rig is None:
                raise ValueError(f"sightings.frame is {frame!r}, a camera: give 'rig', or 'frame: body'")
        return self

    @model_validator(mode="after")
    def _check_survey(self):
        if isinstance(self.sightings, ControlPointSightingsInput):
            if self.survey is not None:
                raise ValueError("sightings of kind 'control_points' hold the surveyed coordinates: remove 'survey'")
        elif self.survey is None:
            raise ValueError(
                "missing key 'survey': the surveyed points: {file: ..}, {points: ..} or {from_trajectory: ..}"
            )
        return self

    @model_validator(mode="after")
    def _check_order(self):
        named = isinstance(self.sightings, ControlPointSightingsInput | FromTrajectorySightingsInput)
        for key in ("order", "locations"):
            if named and getattr(self.visits, key):
                kind = self.sightings.kind
                raise ValueError(f"sightings of kind {kind!r} name their locations: remove 'visits.{key}'")
        return self

    @model_validator(mode="after")
    def _check_locations(self):
        survey = self.survey
        if survey is None:
            return self
        known = survey.points or (survey.from_trajectory.rows if survey.from_trajectory else None)
        if known is None:
            return self
        used = {"survey.ignore": survey.ignore, "visits.order": self.visits.order or []}
        used["visits.locations"] = list(self.visits.locations.values())
        if isinstance(self.sightings, FromTrajectorySightingsInput):
            used["sightings.visits"] = [visit.location for visit in self.sightings.visits]
        for key, names in used.items():
            for name in names:
                if name not in known:
                    raise ValueError(f"{key} names {name!r}, which is not surveyed{nearest(name, known)}")
        return self
