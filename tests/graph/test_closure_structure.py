import numpy as np
import pytest

from jaxgeo.graph.closure_levels import MOST_AT_LAST, coarser_levels
from jaxgeo.graph.closure_structure import spanning_tree, structure_of


def test_only_poses_with_closures_and_the_ends_are_joints() -> None:
    """Eight poses, a closure from 2 to 6; the edge 3-4 is measured backwards."""
    first = np.array([0, 1, 2, 4, 4, 5, 6, 2])
    second = np.array([1, 2, 3, 3, 5, 6, 7, 6])
    built = structure_of(8, first, second, np.ones(8, bool), np.ones(8))
    assert built.stretches is not None
    assert np.asarray(built.joint)[:4].tolist() == [0, 2, 6, 7]
    assert np.asarray(built.stretches.edge)[:7].tolist() == [0, 1, 2, 3, 4, 5, 8 * 16]  # 6-7 lies between two joints
    assert np.asarray(built.stretches.sign)[:7].tolist() == [1, 1, 1, -1, 1, 1, 0]
    assert np.asarray(built.stretches.stretch)[:6].tolist() == [0, 0, 1, 1, 1, 1]
    assert np.asarray(built.stretches.pose)[:6].tolist() == [1, 2, 3, 4, 5, 6]
    assert np.asarray(built.direct_edge)[:2].tolist() == [6, 7]
    d = len(built.direct_edge)
    ties = list(zip(np.asarray(built.first).tolist(), np.asarray(built.second).tolist(), strict=True))
    assert ties[:2] == [(2, 3), (1, 2)]
    assert ties[d : d + 2] == [(0, 1), (1, 2)]


def test_an_edge_without_full_information_keeps_its_ends_as_joints() -> None:
    first, second = np.arange(5), np.arange(1, 6)
    definite = np.array([True, True, False, True, True])
    built = structure_of(6, first, second, definite, np.ones(5))
    assert np.asarray(built.joint)[:4].tolist() == [0, 2, 3, 5]


def test_two_edges_between_the_same_neighbours_are_no_stretch() -> None:
    built = structure_of(3, np.array([0, 1, 1]), np.array([1, 2, 2]), np.ones(3, bool), np.ones(3))
    assert np.asarray(built.joint)[:3].tolist() == [0, 1, 2]
    assert built.stretches is None


def test_spanning_tree_takes_odometry_first_and_is_a_tree() -> None:
    """Two sessions, 0-3 and 4-7, tied by two closures."""
    first, second = np.array([2, 5, 0, 1, 2, 4, 5, 7]), np.array([5, 1, 1, 2, 3, 5, 6, 6])
    tree = spanning_tree(8, first, second)
    assert tree[2:].all()
    assert tree[:2].sum() == 1


@pytest.mark.parametrize("n", [65, 300, 1000])
def test_groups_are_connected_edges_add_up_and_few_are_left(n: int) -> None:
    rng = np.random.default_rng(n)
    extra = rng.integers(0, n, (2, n // 2))
    first, second = np.concatenate([np.arange(n - 1), extra[0]]), np.concatenate([np.arange(1, n), extra[1]])
    levels, coarsest = coarser_levels(n, first, second, np.ones(len(first)))
    assert len(levels) > 0
    assert np.asarray(coarsest.real).sum() <= MOST_AT_LAST
    group = np.asarray(levels[0].group)[:n]
    for k in range(group.max() + 1):
        members = set(np.flatnonzero(group == k).tolist())
        reached, front = set(), {min(members)}
        while front:
            reached |= front
            inside = [(a, b) for a, b in zip(first.tolist(), second.tolist(), strict=True) if {a, b} <= members]
            front = {b for a, b in inside if a in front} | {a for a, b in inside if b in front}
            front -= reached
        assert reached == members
    coarse = np.asarray(levels[0].coarse_edge)
    following = levels[1] if len(levels) > 1 else coarsest
    a, b = np.asarray(following.first), np.asarray(following.second)
    for e in range(len(first)):
        ends = sorted((group[first[e]], group[second[e]]))
        if ends[0] == ends[1]:
            assert coarse[e] == levels[0].counts[1]
        else:
            assert [a[coarse[e]], b[coarse[e]]] == ends
