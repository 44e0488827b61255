"""What the config of a placement may say: the path, its noise, where anchors may stand, and how they will be seen."""

import math
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from jaxgeo.config.fields import (
    Columns,
    Crs,
    FileName,
    InputFile,
    Name,
    NonNegative,
    Positive,
    PositivePerAxis,
    Section,
    Vector,
)
from jaxgeo.config.inputs import Delimiter, NoiseValues, Odometry, TrajectoryFile

MOST_ANCHORS = 200


def _counts(value: Any) -> Any:
    counts = value if isinstance(value, list | tuple) else [value]
    whole = all(isinstance(n, int) and not isinstance(n, bool) and 1 <= n <= MOST_ANCHORS for n in counts)
    if not counts or not whole:
        raise ValueError(f"expected a number of anchors from 1 to {MOST_ANCHORS}, or a list of such numbers")
    if len(set(counts)) < len(counts):
        raise ValueError("a number stands twice: keep one")
    return tuple(counts)


def _exactly_one(section: Section, keys: tuple[str, ...]) -> None:
    given = [key for key in keys if getattr(section, key) is not None]
    if len(given) != 1:
        raise ValueError(f"give exactly one of {', '.join(keys)}; found {' and '.join(given) or 'none'}")


class WaypointsInput(Section):
    """The corners of a path, straight lines between them: a table with columns N, E and h in the config's `crs`.

    Attributes:
        columns: role -> header name or 0-based number; by header where it is not said.
        height_m: height of a path without heights.
        speed_m_s: at which the path is followed: it makes the stamps.
    """

    file: InputFile = Field(description="the table of corners, with columns N, E and h")
    delimiter: Delimiter | None = None
    columns: Columns | None = None
    height_m: float | None = None
    speed_m_s: Positive = 1.0


class PathTrajectory(TrajectoryFile):
    """A georeferenced trajectory of an earlier session.

    Attributes:
        frame: of its positions: `grid`, the config's `crs`; `local`: these minus `origin_enh_m`.
    """

    frame: Literal["grid", "local"] = "grid"


class PathOfRun(Section):
    """The corrected trajectory that an earlier `jaxgeo run` wrote; `trajectory` which, where it wrote several."""

    folder: InputFile = Field(description="the output folder of an earlier jaxgeo run")
    trajectory: FileName | None = None


class PathInput(Section):
    """The path to be driven: exactly one of `waypoints`, `trajectory` and `run`."""

    waypoints: WaypointsInput | None = None
    trajectory: PathTrajectory | None = None
    run: PathOfRun | None = None

    @model_validator(mode="after")
    def _check_source(self):
        _exactly_one(self, ("waypoints", "trajectory", "run"))
        return self


class PlannedNoise(Section):
    """The odometry's noise: learned in an earlier session (`file`), or the default of its kind.

    Attributes:
        values: replace single defaults.
        file: a noise.json of an earlier session of the same platform.
        trajectory: which trajectory of that file, where it holds several.
    """

    odometry: Odometry = Field(description="lidar, vio, wheel or mono: it chooses the default noise")
    values: NoiseValues = NoiseValues()
    file: InputFile | None = None
    trajectory: Name | None = None

    @model_validator(mode="after")
    def _check_file(self):
        if self.file is None and self.trajectory is not None:
            raise ValueError("'trajectory' is about the noise.json of an earlier session: give 'file', or remove it")
        if self.file is not None and self.values != NoiseValues():
            raise ValueError("'values' and 'file' both say what the noise is: remove one")
        return self


class PlannedPoint(Section):
    """A place; `h` may be left out where the list of places has a `height_m`."""

    N: float = Field(description="northing, metres")
    E: float = Field(description="easting, metres")
    h: float | None = None


class PlacesInput(Section):
    """Named places in the config's `crs`: exactly one of `file` (a survey, its sigmas not read) and `points`.

    Attributes:
        height_m: height of all places that have none.
        ignore: names of places not to be used.
    """

    file: InputFile | None = None
    delimiter: Delimiter | None = None
    columns: Columns | None = None
    points: dict[str, PlannedPoint] | None = Field(default=None, min_length=1)
    height_m: float | None = None
    ignore: list[Name] = Field(default=[])

    @model_validator(mode="after")
    def _check_source(self):
        _exactly_one(self, ("file", "points"))
        for key in ("delimiter", "columns"):
            if self.file is None and getattr(self, key) is not None:
                raise ValueError(f"{key!r} describes a file, but there are 'points': remove it")
        for name, point in (self.points or {}).items():
            if point.h is None and self.height_m is None:
                raise ValueError(f"point {name!r} has no h: give it one, or give 'height_m'")
        return self


class AnchorsWanted(Section):
    """How many anchors are to be placed, and where they may stand.

    Attributes:
        count: of new anchors, one number or several to be compared; those in `standing` come on top.
        reach_m: anchors stand at most so far from the path in plan; by default half of `sighting.range_m`.
        height_above_path_m: of the anchors.
        areas: GeoJSON of polygons in which anchors may stand; without it, anywhere within reach.
        areas_crs: `wgs84` (longitude, latitude) or `grid` (easting, northing); by default what the file says, and
            WGS84 where it says nothing.
        candidates: the only places where anchors may stand, in place of `areas`.
        standing: anchors that stand already.
    """

    count: Annotated[tuple[int, ...], BeforeValidator(_counts)] = Field(
        default=(), description="how many anchors to place: 6, or several numbers to compare: [4, 5, 6]"
    )
    reach_m: Positive | None = None
    height_above_path_m: float = 0.0
    areas: InputFile | None = None
    areas_crs: Literal["grid", "wgs84"] | None = None
    candidates: PlacesInput | None = None
    standing: PlacesInput | None = None

    @model_validator(mode="after")
    def _check_where(self):
        if self.candidates is not None:
            for key, given in (
                ("areas", self.areas is not None),
                ("reach_m", self.reach_m is not None),
                ("height_above_path_m", self.height_above_path_m != 0.0),
            ):
                if given:
                    raise ValueError(f"'candidates' are the only places where anchors may stand: remove {key!r}")
        if self.areas is None and self.areas_crs is not None:
            raise ValueError("'areas_crs' is about the file of areas: give 'areas', or remove it")
        return self


class Sighting(Section):
    """How anchors will be seen from the path.

    Attributes:
        range_m: an anchor is seen from so far.
        sigma_m: standard deviation of one visit, each axis: scatter, lever arm and what does not average out.
        sigma_one_m, rate_hz, dwell_s, floor_m: in its place: of one sighting, sightings a second, seconds that a visit
            lasts, and what does not average out: sigma_m^2 = floor_m^2 + sigma_one_m^2 / (rate_hz dwell_s).
        passes: `every` pass of an anchor is a visit; `one`: a single marker is moved along, each place seen once.
        apart_m: passes nearer to each other along the path are one visit; by default twice `range_m`.
    """

    range_m: Positive = Field(description="how far away an anchor is seen, metres")
    sigma_m: Positive | None = None
    sigma_one_m: Positive | None = None
    rate_hz: Positive | None = None
    dwell_s: Positive | None = None
    floor_m: NonNegative | None = None
    passes: Literal["every", "one"] = "every"
    apart_m: Positive | None = None

    @model_validator(mode="after")
    def _check_sigma(self):
        parts = {key: getattr(self, key) for key in ("sigma_one_m", "rate_hz", "dwell_s", "floor_m")}
        given = [key for key, value in parts.items() if value is not None]
        if self.sigma_m is not None and given:
            raise ValueError(f"'sigma_m' is of a whole visit, {given[0]!r} of single sightings: remove one of the two")
        if self.sigma_m is None:
            missing = [key for key, value in parts.items() if value is None and key != "floor_m"]
            if missing:
                raise ValueError(
                    "give 'sigma_m' of one visit, or 'sigma_one_m', 'rate_hz' and 'dwell_s' of single sightings "
                    f"(missing: {', '.join(missing)})"
                )
            if parts["rate_hz"] * parts["dwell_s"] < 1.0:
                raise ValueError("a visit of 'dwell_s' at 'rate_hz' has less than one sighting: raise one of them")
        return self

    @property
    def visit_sigma_m(self) -> float:
        """Standard deviation of one visit."""
        if self.sigma_m is not None:
            return self.sigma_m
        assert self.sigma_one_m is not None  # checked above
        assert self.rate_hz is not None
        assert self.dwell_s is not None
        return math.hypot(self.floor_m or 0.0, self.sigma_one_m / math.sqrt(self.rate_hz * self.dwell_s))


class PlannedSurvey(Section):
    """`sigma_m`: standard deviation of the survey of every anchor, [E, N, h] or one number."""

    sigma_m: PositivePerAxis = (0.01, 0.01, 0.01)


class Search(Section):
    """How hard is searched.

    Attributes:
        starts: of the gradient search.
        watched: places along the path whose accuracy is predicted.
        exhaustive: all choices of candidates are tried where they are no more than this; 0: never.
    """

    starts: Annotated[int, Field(ge=1, le=4096)] = 64
    watched: Annotated[int, Field(ge=8, le=2048)] = 128
    exhaustive: Annotated[int, Field(ge=0, le=10_000_000)] = 50_000


class PlacementConfig(Section):
    """A mission before it is driven: its path, its noise, what anchors are possible, and what is to be accurate.

    Attributes:
        crs: of the path, and of all places.
        simulated: every output is labelled simulated.
        origin_enh_m: E, N, h subtracted before anything is computed; None: the path's median, rounded to 100 m.
        criterion: what is made small: `path`: the root mean square position error along the path; `worst`: of its
            least accurate place; `D`: the mean axis of all error ellipsoids (geometric); `E`: their longest axis.
        robust: over learned noise, which is itself uncertain: `mixture`: of the mean covariance; `mean`: of the
            criterion; `worst`: of the worst noise.
        layout: for `jaxgeo predict`: anchors whose accuracy is asked for; those in `anchors.standing` come on top.
        basemap: an orthophoto (GeoTIFF) of the site, drawn under the maps.
    """

    name: FileName = Field(description="the plan's name, used in file names")
    crs: Crs = Field(description="the coordinate system: EPSG:2169, EPSG:2169+5773, .. or local for a site frame")
    simulated: bool = False
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    origin_enh_m: Vector | None = None
    path: PathInput = Field(description="the path: {waypoints: {file: ..}}, {trajectory: {..}} or {run: {folder: ..}}")
    noise: PlannedNoise = Field(
        description="the odometry's noise: {odometry: lidar}, {odometry: vio, file: noise.json}"
    )
    anchors: AnchorsWanted = AnchorsWanted()
    sighting: Sighting = Field(description="how anchors are seen: {range_m: 10, sigma_m: 0.02}")
    survey: PlannedSurvey = PlannedSurvey()
    criterion: Literal["path", "worst", "D", "E"] = "path"
    robust: Literal["mixture", "mean", "worst"] = "mixture"
    search: Search = Search()
    layout: PlacesInput | None = None
    basemap: InputFile | None = None

    @model_validator(mode="after")
    def _check_origin(self):
        if self.path.trajectory is not None and self.path.trajectory.frame == "local" and self.origin_enh_m is None:
            raise ValueError("path.trajectory.frame is local: give 'origin_enh_m', what was subtracted from the grid")
        return self

    @model_validator(mode="after")
    def _check_places(self):
        if self.crs == "local":
            if self.basemap is not None:
                raise ValueError("basemap: crs is local, a site frame without a place on a map: remove 'basemap'")
            if self.anchors.areas_crs == "wgs84":
                raise ValueError("anchors.areas_crs is wgs84, but crs is local, which has no longitude and latitude")
        if abs(self.anchors.height_above_path_m) >= self.sighting.range_m:
            raise ValueError(
                f"anchors.height_above_path_m is {self.anchors.height_above_path_m}, but sighting.range_m is "
                f"{self.sighting.range_m}: no anchor would be seen"
            )
        return self
