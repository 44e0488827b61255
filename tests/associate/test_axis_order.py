"""Exchanged axes: the fit that tells against jaxgeo's own Umeyama, and when it is believed."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxgeo.associate.axis_order import similarity_rms, upside_down
from jaxgeo.geometry.umeyama import umeyama


@pytest.mark.parametrize("gravity", [False, True])
@pytest.mark.parametrize("scale", [False, True])
@pytest.mark.parametrize("mirrored", [False, True])
def test_rms_is_that_of_the_one_time_similarity(scale, gravity, mirrored):
    random = np.random.default_rng(3)
    source = random.normal(size=(7, 3)) * [30.0, 20.0, 2.0]
    turn = Rotation.from_euler("z", 2.0) if gravity else Rotation.from_rotvec([0.3, -2.0, 1.0])
    target = 1.1 * turn.apply(source) + random.normal(size=(7, 3)) + [5.0, 6.0, 7.0]
    target = target[:, [1, 0, 2]] if mirrored else target
    expected = umeyama(source, target, np.ones(7), scale=scale, gravity=gravity).rms_m
    assert similarity_rms(source, target, scale=scale, gravity=gravity) == pytest.approx(float(expected), rel=1e-9)


def test_three_locations_fit_equally_well_either_way():
    source, target = np.random.default_rng(1).normal(size=(2, 3, 3))
    given, exchanged = (similarity_rms(source, target[:, a], scale=True, gravity=False) for a in ([0, 1, 2], [1, 0, 2]))
    assert given == pytest.approx(exchanged, rel=1e-9)


@pytest.mark.parametrize(("turn", "n"), [([0, 0, 1.0], 0), ([np.pi, 0, 0], 1), ([np.pi / 2, 0, 0], 0)])
def test_only_a_trajectory_on_its_head_is_warned_about(turn, n):
    assert len(upside_down(Rotation.from_rotvec(turn).as_matrix())) == n
