"""What flows through: trajectories, sightings, visits, surveys, anchors, rigs, scans."""

from jaxgeo.data.anchor import Anchors
from jaxgeo.data.relative_poses import RelativePoses
from jaxgeo.data.rig import Camera, Rig
from jaxgeo.data.scan import RgbdFrame, Scan
from jaxgeo.data.sighting import CornerSightings, Sightings
from jaxgeo.data.survey import Survey
from jaxgeo.data.trajectory import Trajectory
from jaxgeo.data.visit import Visit

__all__ = [
    "Anchors",
    "Camera",
    "CornerSightings",
    "RelativePoses",
    "RgbdFrame",
    "Rig",
    "Scan",
    "Sightings",
    "Survey",
    "Trajectory",
    "Visit",
]
