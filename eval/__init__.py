"""Holds out, repeats, tabulates, draws, places anchors."""

import jaxgeo  # noqa: F401  (sets the threads of BLAS before SciPy is loaded, and float64)
