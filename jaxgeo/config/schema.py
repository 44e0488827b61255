"""What the config of one session may say: lengths in metres, times in seconds, angles in radians."""

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from jaxgeo.config.corrections import CorrectionsInput
from jaxgeo.config.fields import Crs, FileName, InputFile, Name, NonNegative, Positive, Section, Vector, nearest
from jaxgeo.config.images import ImagesSightingsInput
from jaxgeo.config.inputs import (
    AnyTrajectoryInput,
    ComputedTrajectoryInput,
    ControlPointSightingsInput,
    CornerSightingsInput,
    FromTrajectorySightingsInput,
    NoiseValues,
    PoseSightingsInput,
    RigInput,
    SightingsInput,
    SurveyInput,
)
from jaxgeo.config.recording import MappingInput, RgbdInput, ScansInput


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
    """Odometry noise: learned from the session itself, or fixed.

    Attributes:
        mode: learned, or fixed. The fixed noise is worked out beside the learned one too, for comparison.
        values: replace the defaults of every trajectory; a trajectory's own `noise` goes before them. They are the
            fixed noise, and where the prior of the learned one has its medians.
        observations: what is learned from: anchors, revisits without coordinates, or both.
        free_anchor_factor: also learn one common factor on the anchors' own standard deviations.
        file: noise.json of another session; `trajectory` which of several trajectories in it.
        use: of the file: `prior`, where learning starts; `fixed`, used as it is, with mode fixed.
    """

    mode: Literal["learned", "fixed"] = "learned"
    values: NoiseValues = NoiseValues()
    observations: Literal["both", "anchors", "revisit"] = "both"
    free_anchor_factor: bool = False
    file: InputFile | None = None
    trajectory: Name | None = None
    use: Literal["prior", "fixed"] = "prior"

    @model_validator(mode="after")
    def _check_file(self):
        if self.file is None:
            for key, given in (("trajectory", self.trajectory is not None), ("use", self.use == "fixed")):
                if given:
                    raise ValueError(f"{key!r} is about the noise.json of another session: give 'file', or remove it")
        elif self.mode == "learned" and self.use == "fixed":
            raise ValueError(
                "use is fixed, but mode is learned: with 'mode: fixed' the file's noise is used as it is, with "
                "'use: prior' learning starts from it"
            )
        elif self.mode == "fixed" and self.use == "prior":
            raise ValueError(
                "mode is fixed, so nothing is learned that the file could be a prior of: with 'use: fixed' its noise "
                "is used as it is, with 'mode: learned' learning starts from it"
            )
        return self


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
    """What is held out.

    Attributes:
        leave_one_out: hold every location out in turn.
        subsets: `jaxgeo evaluate` also tries fewer anchors: at most so many choices of each number; 0: none.
        cost: `jaxgeo evaluate` also measures what the computing costs.
        check: look for wrong anchors; null: `jaxgeo run` does, the other commands do not.
    """

    leave_one_out: bool = True
    subsets: Annotated[int, Field(ge=0, le=10_000)] = 40
    cost: bool = True
    check: bool | None = None


class Report(Section):
    """`interactive`: figures that answer the pointer; they add 5 MB of JavaScript to report.html, none fetched."""

    interactive: bool = True


class SessionConfig(Section):
    """One session: one survey, its sightings, and one or more trajectories, each corrected on its own.

    Attributes:
        crs: of the survey.
        simulated: every output is labelled simulated.
        scans, rgbd: raw sensors; without `trajectories`, LiDAR odometry (`icp`) and mapping (`dense`) are made of them.
        corrections: of the sightings' clock, the camera's place and its attitude, to be estimated; None: none.
        origin_enh_m: E, N, h subtracted before anything is estimated; None: the survey's median, rounded to 100 m.
        basemap: an orthophoto (GeoTIFF) of the site, drawn under the maps.
    """

    name: FileName = Field(description="the session's name, used in file names")
    crs: Crs = Field(
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
    scans: ScansInput | None = None
    rgbd: RgbdInput | None = None
    mapping: MappingInput = MappingInput()
    trajectories: dict[FileName, AnyTrajectoryInput] = Field(
        min_length=1,
        description="the trajectories by name: {icp: {file: .., format: .., odometry: ..}}; or give 'scans'",
    )
    noise: Noise = Noise()
    coarse: Coarse = Coarse()
    anchors: AnchorOptions = AnchorOptions()
    corrections: CorrectionsInput | None = Field(default=None)
    solver: Solver = Solver()
    evaluate: Evaluate = Evaluate()
    report: Report = Report()
    basemap: InputFile | None = None

    @model_validator(mode="before")
    @classmethod
    def _trajectories_of_scans(cls, value: Any) -> Any:
        """With scans and no word of trajectories: the reference study's two."""
        if isinstance(value, dict) and value.get("scans") is not None and "trajectories" not in value:
            return value | {"trajectories": {"icp": {"computed": "odometry"}, "dense": {"computed": "mapping"}}}
        return value

    @model_validator(mode="after")
    def _check_computed(self):
        for name, source in self.trajectories.items():
            if not isinstance(source, ComputedTrajectoryInput):
                continue
            place = f"trajectories.{name}.computed is {source.computed!r}"
            if source.computed == "odometry" and self.scans is None:
                raise ValueError(f"{place}, which needs LiDAR scans: give 'scans'")
            if source.computed == "mapping":
                if self.scans is None and self.rgbd is None:
                    raise ValueError(f"{place}, which needs sensors: give 'scans' or 'rgbd'")
                along = self.mapped_along(name)
                other = self.trajectories.get(along)
                if other is None or along == name or getattr(other, "computed", None) == "mapping":
                    known = ", ".join(n for n in self.trajectories if n != name) or "none"
                    raise ValueError(f"{place}, of {along!r}: 'of' has to name another trajectory (there: {known})")
        if self.rgbd is not None and self.rig is None:
            raise ValueError("'rgbd' needs a camera: give 'rig'")
        return self

    def mapped_along(self, name: str) -> str:
        """The trajectory that the mapped one follows: what `of` names, else the first that is not mapped itself."""
        source = self.trajectories[name]
        if isinstance(source, ComputedTrajectoryInput) and source.of is not None:
            return source.of
        return next((n for n, t in self.trajectories.items() if getattr(t, "computed", None) != "mapping"), name)

    @model_validator(mode="after")
    def _check_corrections(self):
        if self.corrections is not None and self.noise.mode == "fixed":
            raise ValueError(
                "corrections are estimated together with the odometry's noise, but noise.mode is fixed: learn it, or "
                "remove 'corrections'"
            )
        return self

    @model_validator(mode="after")
    def _check_basemap(self):
        if self.basemap is not None and self.crs == "local":
            raise ValueError(
                "basemap: crs is local, a site frame without a place on a map: give the EPSG code, or remove 'basemap'"
            )
        return self

    @model_validator(mode="after")
    def _check_rig(self):
        match self.sightings:
            case CornerSightingsInput() if self.rig is None:
                raise ValueError("sightings of kind 'corners' are pixels and need a camera: give 'rig'")
            case ImagesSightingsInput() if self.rig is None:
                raise ValueError("sightings of kind 'images' are pixels and need a camera: give 'rig'")
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
    def _check_noise(self):
        if self.noise.use == "fixed":
            given = {"noise.values": self.noise.values}
            given |= {f"trajectories.{name}.noise": t.noise for name, t in self.trajectories.items()}
            for key, values in given.items():
                if values != NoiseValues():
                    raise ValueError(f"{key} and noise.file (use: fixed) both say what the noise is: remove one")
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
