"""Where on Earth: coordinate reference systems and the local frame."""

from jaxgeo.georef.crs import LOCAL, GridCrs, read_crs
from jaxgeo.georef.local_frame import LocalFrame, check_in_area, default_origin

__all__ = ["LOCAL", "GridCrs", "LocalFrame", "check_in_area", "default_origin", "read_crs"]
