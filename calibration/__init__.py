"""Learns the noise of one trajectory from its own anchors and revisits."""

import jaxgeo  # noqa: F401  (sets the threads of BLAS before SciPy is loaded, and float64)
