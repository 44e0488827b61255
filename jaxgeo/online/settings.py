"""What is fixed before the first pose of an online session."""

import dataclasses

from jaxgeo.online.anchor_log import Labels
from jaxgeo.solve.correct import Settings


@dataclasses.dataclass(frozen=True)
class OnlineSettings:
    """How sightings become anchors, how the graph is solved, and for how much there is room.

    Attributes:
        gap_s, min_count: how sightings are cut into visits; a visit serves as an anchor once a pose has come more than
            `gap_s` after its last sighting.
        labels: how visits are tied to locations.
        solve: of the estimator, as in the batch job.
        capacity: poses, and `capacity_anchors` visits, whose arrays are there from the start. Every solve costs what
            they cost. Beyond them the arrays double, which compiles anew.
    """

    gap_s: float = 5.0
    min_count: int = 1
    labels: Labels = dataclasses.field(default_factory=Labels)
    solve: Settings = dataclasses.field(default_factory=Settings)
    capacity: int = 32768
    capacity_anchors: int = 63
