"""Georeferencing as the data come: the same answer as the batch job's, at every moment."""

from jaxgeo.online.anchor_log import Labels
from jaxgeo.online.georeference import OnlineGeoreference
from jaxgeo.online.online_pose import OnlinePose, OnlineResult, Update
from jaxgeo.online.settings import OnlineSettings

__all__ = ["Labels", "OnlineGeoreference", "OnlinePose", "OnlineResult", "OnlineSettings", "Update"]
