"""jaxgeo: georeference a drifting trajectory with a few surveyed markers."""

from jaxgeo.precision import enable_float64

enable_float64()

__version__ = "0.1.0"
__all__ = ["__version__"]
