"""The study's anchor geometry to its printed digits, and the contrast of the near-collinear locations to the others."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from eval.collinearity import Neighbours, collinearity_contrast, near_collinear, neighbours
from jaxgeo.errors import InputError

NAMES = tuple("ABCDEF")
# As the study prints them, metres: northing, easting, height; here turned into E, N, h.
STUDY_ENH_M = np.array(
    [
        [76839.129, 79345.498, 340.570],
        [76829.898, 79357.502, 339.409],
        [76821.262, 79363.262, 338.276],
        [76789.028, 79320.063, 338.382],
        [76804.525, 79309.431, 340.234],
        [76815.709, 79296.809, 341.129],
    ]
)[:, [1, 0, 2]]


def by_name(found: tuple[Neighbours, ...]) -> dict[str, Neighbours]:
    return {each.name: each for each in found}


def test_the_studys_figures_to_the_printed_digits():
    found = by_name(neighbours(NAMES, STUDY_ENH_M))
    assert (found["B"].before, found["B"].after) == ("A", "C")
    assert f"{100 * found['B'].distance_m:.1f} {100 * found['B'].share:.2f}" == "201.5 7.96"
    assert f"{100 * found['E'].distance_m:.1f} {100 * found['E'].share:.2f}" == "220.4 6.21"
    others = sorted(100 * found[name].distance_m for name in "ACDF")
    assert (f"{others[0]:.0f}", f"{others[-1]:.0f}") == ("1014", "1803")
    assert near_collinear(tuple(found.values())) == {"B", "E"}
    assert (found["A"].before, found["F"].after) == ("F", "A")


@given(seed=st.integers(0, 10**6))
def test_nothing_depends_on_where_the_survey_lies_or_how_it_is_turned(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-50, 50, (5, 3))
    moved = Rotation.random(rng=rng).apply(points) + rng.uniform(-1e3, 1e3, 3)
    for a, b in zip(neighbours("abcde", points), neighbours("abcde", moved), strict=True):
        assert a.distance_m == pytest.approx(b.distance_m, abs=1e-9)
        assert a.share == pytest.approx(b.share, abs=1e-9)


def test_the_line_goes_on_beyond_the_neighbours():
    found = neighbours("abc", np.array([[0.0, 0, 0], [5.0, 1.0, 0], [2.0, 0, 0]]))
    assert found[1].distance_m == pytest.approx(1.0)
    assert found[1].segment_m == pytest.approx(2.0)
    assert found[1].share == pytest.approx(0.5)


def test_few_or_coincident_locations():
    assert neighbours("ab", np.zeros((2, 3))) == ()
    found = neighbours("abc", np.array([[0.0, 0, 0], [3.0, 4.0, 0], [0.0, 0, 0]]))
    assert found[1].distance_m == pytest.approx(5.0)
    assert found[1].share == np.inf
    assert near_collinear(found) == {"a", "c"}
    with pytest.raises(InputError, match="every location once"):
        neighbours("aba", np.zeros((3, 3)))


def test_contrast():
    found = collinearity_contrast({"A": 2.0, "B": 1.0, "C": 4.0, "D": np.nan, "E": 2.0}, {"B", "E"})
    assert (found.near_mean_m, found.others_mean_m, found.ratio) == (1.5, 3.0, 0.5)
    assert np.isnan(collinearity_contrast({"A": 2.0}, set()).ratio)
    with pytest.raises(InputError, match="Z are not among"):
        collinearity_contrast({"A": 2.0}, {"Z"})
