"""Pairing by stamp, against all pairs that are each other's nearest."""

from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxgeo.errors import ScanError
from jaxgeo.io.input_warning import InputWarning
from jaxgeo.io.rgbd.pairs import check_paired, nearest_pairs

# Multiples of 1/8 s: ties are exact
STREAM = st.lists(st.integers(0, 60), unique=True, max_size=12).map(lambda ticks: [t / 8 for t in sorted(ticks)])


def stamped(stamps):
    return [SimpleNamespace(stamp_s=stamp) for stamp in stamps]


def paired(ones, others, max_gap_s):
    found = list(nearest_pairs(stamped(ones), stamped(others), max_gap_s))
    return [(a.stamp_s if a else None, b.stamp_s if b else None) for a, b in found]


@given(ones=STREAM, others=STREAM, max_gap_s=st.sampled_from([0.0, 0.125, 0.3, 1.0]))
def test_everything_once_and_the_nearest_together(ones, others, max_gap_s):
    found = paired(ones, others, max_gap_s)
    assert [a for a, _ in found if a is not None] == ones
    assert [b for _, b in found if b is not None] == others
    pairs = [(a, b) for a, b in found if a is not None and b is not None]
    assert all(abs(a - b) <= max_gap_s for a, b in pairs)
    for a in ones:
        for b in others:
            alone = all(abs(x - b) > abs(a - b) for x in ones if x != a)
            alone &= all(abs(a - y) > abs(a - b) for y in others if y != b)
            if alone and abs(a - b) <= max_gap_s:
                assert (a, b) in pairs


def test_two_rates():
    """Every second image at 30 Hz has a partner at 15 Hz, 1 ms off."""
    colour = [i / 30 for i in range(8)]
    assert paired(colour, [0.001 + i / 15 for i in range(4)], 0.02) == [
        pair for i in range(4) for pair in ((colour[2 * i], 0.001 + i / 15), (colour[2 * i + 1], None))
    ]


def test_holds_two_members_of_a_stream():
    taken = []

    def stream():
        for i in range(100):
            taken.append(i)
            yield SimpleNamespace(stamp_s=float(i))

    pairs = nearest_pairs(stream(), stamped(range(100)), 0.1)
    for i, _ in zip(range(50), pairs, strict=False):
        assert len(taken) <= i + 3


def test_counts_what_is_left():
    with pytest.raises(ScanError, match=r"here: none of 3 colour and 2 depth images has a partner within 0\.02 s"):
        check_paired("here", 3, 2, 0, " within 0.02 s")
    with pytest.warns(InputWarning, match="1 of 3 colour and 0 of 2 depth images have no partner"):
        check_paired("here", 3, 2, 2, "")
