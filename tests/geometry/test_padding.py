import numpy as np
import pytest
from numpy.testing import assert_array_equal

from jaxgeo.geometry import bucket_size, pad_rows


@pytest.mark.parametrize(("count", "size"), [(0, 16), (1, 16), (16, 16), (17, 32), (1829, 2048), (4096, 4096)])
def test_bucket(count, size):
    assert bucket_size(count) == size


def test_padding_repeats_the_last_row():
    assert_array_equal(pad_rows(np.array([[1, 2], [3, 4]]), 4), [[1, 2], [3, 4], [3, 4], [3, 4]])
    assert_array_equal(pad_rows(np.arange(3), 3), [0, 1, 2])
