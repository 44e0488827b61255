"""Benchmarks: the solver against GTSAM, and every real session from end to end."""

import jaxgeo  # noqa: F401  (sets the threads of BLAS before SciPy is loaded, and float64)
