"""Which pairs of keyframes are looked at."""

import itertools

import numpy as np
from scipy.spatial.transform import Rotation

from jaxgeo.mapping.loop_candidates import CandidateSettings, loop_candidates
from jaxgeo.mapping.scan_context import ScanContexts, scan_context, scan_contexts
from jaxgeo.mapping.submaps import path_length_m

SETTINGS = CandidateSettings(gap_m=10.0, near_m=2.0, drift_share=0.02, max_drift_share=0.2)


def there_and_back(offset_m: float) -> np.ndarray:
    """20 m out along x and back `offset_m` beside it, a pose a metre, facing along the way."""
    out = np.tile(np.eye(4), (21, 1, 1))
    out[:, 0, 3] = np.arange(21)
    back = out[::-1].copy()
    back[:, :3, :3] = Rotation.from_euler("z", np.pi).as_matrix()
    back[:, 1, 3] = offset_m
    return np.concatenate([out, back])


def contexts(T: np.ndarray, places: np.ndarray) -> ScanContexts:
    """Every pose sees the posts of its place, level."""
    found = []
    for k in range(len(T)):
        rng = np.random.default_rng(int(places[k]))
        posts = np.column_stack([rng.uniform(-9, 9, (150, 2)), rng.uniform(0.2, 5.0, 150)])
        found.append(scan_context(posts, 10.0))
    return scan_contexts(found)


def test_near_pairs_with_enough_path_between():
    T = there_and_back(0.5)
    path = path_length_m(T)
    found = loop_candidates(T, path, None, SETTINGS)
    assert found
    for one in found:
        assert one.first < one.second
        assert path[one.second] - path[one.first] >= 10.0
        assert np.linalg.norm(T[one.first, :3, 3] - T[one.second, :3, 3]) < 3.0
        assert not one.alike
        assert np.allclose(T[one.first] @ one.starts[0], T[one.second])


def test_a_keyframe_s_pairs_are_spread_and_few():
    found = loop_candidates(there_and_back(0.5), path_length_m(there_and_back(0.5)), None, SETTINGS)
    for second in {one.second for one in found}:
        firsts = sorted(one.first for one in found if one.second == second)
        assert len(firsts) <= SETTINGS.per_keyframe
        assert all(b - a >= SETTINGS.apart for a, b in itertools.pairwise(firsts))


def test_places_that_look_alike_are_found_where_the_odometry_has_drifted_away():
    T = there_and_back(6.0)  # 2 m and 2 % of the path do not reach
    places = np.concatenate([np.arange(21), np.arange(21)[::-1]])
    found = loop_candidates(T, path_length_m(T), contexts(T, places), SETTINGS)
    true = [one for one in found if places[one.first] == places[one.second]]
    assert len(true) > 5
    assert all(one.alike for one in true)


def test_the_start_of_a_like_place_turns_the_second_frame_into_the_first():
    T = there_and_back(0.0)
    places = np.concatenate([np.arange(21), np.arange(21)[::-1]])
    for one in loop_candidates(T, path_length_m(T), contexts(T, places), SETTINGS):
        if one.alike and places[one.first] == places[one.second]:
            # the posts were given in level frames, so the headings differ as the odometry says
            truth = T[one.first, :3, :3].T @ T[one.second, :3, :3]
            assert np.allclose(one.starts[-1][:3, :3], truth, atol=1e-9)


def test_likeness_beyond_belief_is_not_looked_at():
    T = there_and_back(30.0)  # 30 m off after at most 71 m of path
    places = np.concatenate([np.arange(21), np.arange(21)[::-1]])
    assert not loop_candidates(T, path_length_m(T), contexts(T, places), SETTINGS)
