"""Hypothesis: trajectories as a reader might meet them."""

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from jaxgeo.data import Trajectory

_OFFSETS_S = st.sampled_from([0.0, -100.0, 1541777802.116735220, 1403637132.888318976])


@st.composite
def trajectories(draw: st.DrawFn) -> Trajectory:
    n = draw(st.integers(2, 6))
    # The smallest step is above the spacing of float64 at the largest offset (2.4e-7 s).
    steps_s = draw(hnp.arrays(float, n, elements=st.floats(1e-5, 1e3)))
    position_m = draw(hnp.arrays(float, (n, 3), elements=st.floats(-1e8, 1e8)))
    quat = draw(hnp.arrays(float, (n, 4), elements=st.floats(-1, 1, allow_subnormal=False)))
    quat[np.linalg.norm(quat, axis=1) < 1e-3] = [1.0, 0.0, 0.0, 0.0]
    quat /= np.linalg.norm(quat, axis=1, keepdims=True)
    return Trajectory(draw(_OFFSETS_S) + np.cumsum(steps_s), position_m, quat)
