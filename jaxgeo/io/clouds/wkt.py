"""A coordinate reference system as the text that LAS carries."""

import pyproj
from pyproj.exceptions import CRSError

from jaxgeo.errors import CloudError


def las_wkt(crs: str) -> str:
    """WKT 1 of `EPSG:<code>[+<code>]` (OGC 01-009, which LAS 1.4 asks for).

    LAS x is the easting. Where the register puts the northing first (EPSG:2169), PROJ writes WKT 1 without AXIS
    entries, which means easting, then northing; UTM's entries say the same in words.

    Raises:
        CloudError: the code is unknown.
    """
    try:
        return pyproj.CRS.from_user_input(crs).to_wkt("WKT1_GDAL")
    except CRSError as failure:
        raise CloudError(f"crs {crs!r} cannot be written as WKT ({failure}). Use another EPSG code.") from None
