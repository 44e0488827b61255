"""The site and the two sessions of the reference study: where, in what order, how long, and how well it was seen.

Coordinates, visiting order, counts, repeatability and durations are the study's; so is the longest trajectory's 1829
poses. The other's number, rig heights, standing distance and ways are not reported there and are ours: 1800 poses let
both sessions share their compiled programs.
"""

import dataclasses

import numpy as np

from jaxgeo.errors import InputError

CRS = "EPSG:2169"
LOCATIONS: tuple[str, ...] = ("A", "B", "C", "D", "E", "F")
SURVEYED_NEH_M = np.array(
    [
        [76839.129, 79345.498, 340.570],
        [76829.898, 79357.502, 339.409],
        [76821.262, 79363.262, 338.276],
        [76789.028, 79320.063, 338.382],
        [76804.525, 79309.431, 340.234],
        [76815.709, 79296.809, 341.129],
    ]
)
ORIGIN_ENH_M = np.array([79300.0, 76800.0, 300.0])
# The surveyed positions in the local frame (E, N, h), and one origin for both sessions: their results can be compared.
SURVEYED_ENH_M = SURVEYED_NEH_M[:, [1, 0, 2]] - ORIGIN_ENH_M
ORDER: tuple[str, ...] = ("A", "B", "C", "D", "E", "F", "A")


@dataclasses.dataclass(frozen=True)
class Layout:
    """One session at the study's site: a marker moved from location to location, a rig that looks at it from each.

    Attributes:
        name: of the session; in file names.
        counts: sightings of each visit.
        repeatability_m: RMS of each visit's marker positions about their centroid.
        duration_s: of the trajectory.
        n_poses: of every trajectory, evenly in time.
        rig_height_m: of the body above the marker's height.
        order: the location of each visit.
        standoff_m: horizontal distance from which the marker is looked at.
        detour_share: how far the ways bend aside, in their chords' lengths; negative: to the other side.
        image_rate_hz: of the sightings; a visit lasts count / rate.
        stream: sets apart the random numbers of layouts under one seed; the survey's error is common to all.

    Raises:
        InputError: the visits' lists differ in length, a location is unknown, or a number is out of range.
    """

    name: str
    counts: tuple[int, ...]
    repeatability_m: tuple[float, ...]
    duration_s: float
    n_poses: int
    rig_height_m: float
    order: tuple[str, ...] = ORDER
    standoff_m: float = 3.0
    detour_share: float = 0.12
    image_rate_hz: float = 10.0
    stream: int = 0

    def __post_init__(self) -> None:
        if not len(self.counts) == len(self.repeatability_m) == len(self.order):
            raise InputError(
                f"layout {self.name!r}: {len(self.order)} visits in the order, {len(self.counts)} counts and "
                f"{len(self.repeatability_m)} repeatabilities; expected one of each a visit."
            )
        unknown = [name for name in self.order if name not in LOCATIONS]
        if unknown:
            raise InputError(f"layout {self.name!r}: location {unknown[0]!r}; the site has {', '.join(LOCATIONS)}.")
        if len(self.order) < 2 or any(a == b for a, b in zip(self.order, self.order[1:], strict=False)):
            raise InputError(f"layout {self.name!r}: expected two visits or more, neighbours at different locations.")
        if min(self.counts) < 1 or min(self.repeatability_m) < 0 or self.n_poses < 2 or self.standoff_m <= 0:
            raise InputError(
                f"layout {self.name!r}: expected a sighting or more a visit, repeatabilities of 0 m or more, two poses "
                "or more and a standing distance above 0 m."
            )
        stays_s = sum(self.counts) / self.image_rate_hz
        if not stays_s < self.duration_s:
            raise InputError(
                f"layout {self.name!r}: the visits alone last {stays_s:g} s of {self.duration_s:g} s; expected time to "
                "walk between them. Raise duration_s or lower counts."
            )


UAV = Layout(
    name="UAV",
    counts=(152, 289, 167, 209, 197, 185, 175),
    repeatability_m=(0.1471, 0.2254, 0.1094, 0.0603, 0.1821, 0.1443, 0.0794),
    duration_s=319.1,
    n_poses=1800,
    rig_height_m=2.6,
)
UGV = Layout(
    name="UGV",
    counts=(226, 84, 260, 92, 200, 110, 181),
    repeatability_m=(0.1376, 0.3755, 0.2043, 0.0811, 0.1544, 0.2270, 0.1222),
    duration_s=362.4,
    n_poses=1829,
    rig_height_m=0.5,
    detour_share=-0.08,
    stream=1,
)
