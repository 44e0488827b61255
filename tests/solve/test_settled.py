"""Where the solver stops: near enough to the optimum in metres, too, however uncertain the poses are."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from solve.chain_session import NOISE, Session, anchors_at, drifted, graph_of, trajectory_of, walk
from solve.programs import optimum, solve

from jaxgeo.solve.solver import result_words

N, K = 100, 4
# Some kilometres of path, with hundreds of metres and a standard deviation of metres between two anchors.
SIZE = 30.0


def long_session(seed: int) -> Session:
    near = walk(N)
    truth = RigidTransform.from_components(SIZE * near.translation, near.rotation)
    index = np.linspace(0, N - 1, K).astype(int)
    return Session(
        trajectory_of(truth), trajectory_of(drifted(truth, NOISE, seed)), anchors_at(truth, index, seed), NOISE
    )


@pytest.mark.parametrize("seed", range(4))
def test_no_pose_is_half_a_millimetre_off(seed):
    """By the cost alone, which a step of 1e-4 standard deviations hardly lowers, seed 1 would stop 1.8 mm off."""
    graph = graph_of(long_session(seed))
    found, exact = solve(graph), optimum(graph).base
    assert result_words(found.result) == "converged"
    off = np.stack(found.poses.t, axis=1) - np.stack(exact.t, axis=1)
    assert np.linalg.norm(off, axis=1).max() < 5e-4
