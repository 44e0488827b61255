"""Markers in images: masks, decoders, sub-pixel corners."""

from jaxgeo.detect.detection import Detections, no_detections
from jaxgeo.detect.detector import DECODERS, Detector, DetectorSettings
from jaxgeo.detect.families import FAMILIES, family_name
from jaxgeo.detect.gates import Gates
from jaxgeo.detect.mask import BLUE, GREEN, RED, HsvRange, MaskSettings

__all__ = [
    "BLUE",
    "DECODERS",
    "FAMILIES",
    "GREEN",
    "RED",
    "Detections",
    "Detector",
    "DetectorSettings",
    "Gates",
    "HsvRange",
    "MaskSettings",
    "family_name",
    "no_detections",
]
