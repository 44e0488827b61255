"""jaxgeo: georeference a drifting trajectory with a few surveyed markers."""

import os

# The dense systems here are small: on a busy machine the Cholesky factor of 336 rows takes 1 ms with one thread of
# OpenBLAS and 100 ms with four. Read when SciPy loads it, so before JAX is imported; a value set by the user stays.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# XLA (jaxlib 0.10) takes a thread per core, and its kernels of batched small matrices wait, in one of these threads,
# for others: with two threads both can wait for ever. Learning on two cores hung within seconds, every time; with one,
# three or four threads never. XLA reads NPROC for their number.
os.environ.setdefault("NPROC", str(max(4, os.cpu_count() or 4)))

from jaxgeo.precision import enable_float64

enable_float64()

__version__ = "0.1.0"
__all__ = ["__version__"]
