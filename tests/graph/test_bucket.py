import hypothesis
import hypothesis.strategies as st

from jaxgeo.graph.bucket import anchor_bucket, pose_bucket
from jaxgeo.solve.prefix import BLOCK


@hypothesis.given(st.integers(1, 2_000_000))
def test_pose_buckets_hold_little_padding_and_whole_blocks(n):
    size = pose_bucket(n)
    assert n <= size <= max(1.25 * n, 128)
    assert size % BLOCK == 0
    assert pose_bucket(size) == size
    assert pose_bucket(size + 1) > size


@hypothesis.given(st.integers(1, 5_000))
def test_anchor_buckets(k):
    size = anchor_bucket(k)
    assert k <= size <= max(1.25 * k, 8)
    assert anchor_bucket(size) == size


def test_the_first_buckets():
    assert [pose_bucket(n) for n in (1, 128, 129, 160, 161, 257, 20_000)] == [128, 128, 160, 160, 192, 320, 20_480]
    assert [anchor_bucket(k) for k in (1, 8, 9, 11, 17)] == [8, 8, 10, 12, 20]
