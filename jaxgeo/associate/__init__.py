"""From what a camera saw to anchors: pose of a marker, visits, labels, lever arms."""

from jaxgeo.associate.ambiguity import AmbiguityRule
from jaxgeo.associate.anchors import make_anchors
from jaxgeo.associate.axis_order import refuse_exchanged_axes, upside_down
from jaxgeo.associate.from_truth import sightings_from_trajectory, survey_from_trajectory
from jaxgeo.associate.labels import label_visits
from jaxgeo.associate.pnp import corners_to_sightings
from jaxgeo.associate.visits import cut_visits

__all__ = [
    "AmbiguityRule",
    "corners_to_sightings",
    "cut_visits",
    "label_visits",
    "make_anchors",
    "refuse_exchanged_axes",
    "sightings_from_trajectory",
    "survey_from_trajectory",
    "upside_down",
]
