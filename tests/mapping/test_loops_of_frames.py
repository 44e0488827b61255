"""Closures between RGB-D frames, carried over to keyframes."""

import numpy as np

from jaxgeo.geometry import rigid
from jaxgeo.mapping.closure import Closure
from jaxgeo.mapping.rgbd_loops import _at_keyframes


def test_a_closure_of_frames_says_the_same_of_their_keyframes():
    rng = np.random.default_rng(4)
    T_map_frame = rigid.exp(rng.normal(size=(2, 6)))
    T_key_frame = rigid.exp(0.2 * rng.normal(size=(2, 6)))
    T_map_key = T_map_frame @ rigid.inverse(T_key_frame)
    truth = rigid.inverse(T_map_frame[0]) @ T_map_frame[1]
    error = 0.01 * rng.normal(size=6)
    root = rng.normal(size=(6, 6))
    of_frames = Closure(0, 1, truth @ rigid.exp(-error), root.T @ root, 0.5, "rgbd")
    found = _at_keyframes(of_frames, [3, 8], T_key_frame)
    assert (found.first, found.second, found.score, found.kind) == (3, 8, 0.5, "rgbd")
    seen = rigid.log(rigid.inverse(found.T_first_second) @ rigid.inverse(T_map_key[0]) @ T_map_key[1])
    assert np.isclose(seen @ found.information @ seen, error @ of_frames.information @ error, rtol=1e-9)
    assert np.allclose(found.information, found.information.T)
