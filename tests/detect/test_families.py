"""Families: names, codes, what they can bear."""

import numpy as np
import pytest

from jaxgeo.detect.families import FAMILIES, family, family_name
from jaxgeo.errors import DetectError


@pytest.mark.parametrize(
    ("written", "name"),
    [
        ("DICT_4X4_50", "4x4_50"),
        ("tag36h11", "apriltag_36h11"),
        (" AprilTag_25h9 ", "apriltag_25h9"),
        ("aruco_mip_36h12", "aruco_mip_36h12"),
    ],
)
def test_names_are_read_as_people_write_them(written, name):
    assert family_name(written) == name
    assert name in FAMILIES


def test_an_unknown_name_gets_the_nearest():
    with pytest.raises(DetectError, match=r"'apriltag_36h12' is not known; did you mean .*apriltag_36h1"):
        family_name("apriltag_36h12")


def test_four_quarter_turns_come_back():
    one = family("6x6_50")
    bits = (one.codes[:, :, None] >> np.arange(36, dtype=np.uint64)) & np.uint64(1)
    grids = bits.reshape(-1, 4, 6, 6)
    for quarter in range(4):
        np.testing.assert_array_equal(np.rot90(grids[:, 0], quarter, axes=(1, 2)), grids[:, quarter])


def test_codes_are_as_far_apart_as_the_family_says():
    one = family("apriltag_36h11")
    distance = np.bitwise_count(one.codes[:, :1, None] ^ one.codes.reshape(1, 1, -1))[:, 0]
    own = np.arange(len(one.codes))
    distance[own, 4 * own] = 36
    assert distance.min() == 11


@pytest.mark.parametrize(
    ("name", "most"), [("apriltag_36h11", 3), ("apriltag_16h5", 0), ("4x4_50", 0), ("aruco_original", 0), ("7x7_50", 8)]
)
def test_no_more_bits_are_corrected_than_chance_allows(name, most):
    assert family(name).max_hamming == most


def test_families_with_too_many_ids_are_plain_throughout():
    assert family("4x4_1000").plain == frozenset(range(1000))
    assert family("apriltag_36h11").plain == frozenset()
    assert 0 in family("aruco_original").plain  # one white bar on black
