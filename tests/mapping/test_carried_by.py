import re
from collections.abc import Iterator

import numpy as np
import pytest
from test_carry import EPOCH_S, wandering

from jaxgeo.errors import CloudError
from jaxgeo.io.clouds import CloudChunk, CloudSource
from jaxgeo.mapping.carried_by import choose_by, place_finder
from jaxgeo.mapping.carry import PoseCorrections, pose_corrections

TRAJECTORY = wandering(0)
MIDDLE_S = float(TRAJECTORY.stamp_s.mean())


class Columns(CloudSource):
    """A cloud of ten points at one place."""

    def __init__(self, **columns: np.ndarray | float) -> None:
        self.path, self.n_points, self.crs, self.origin_enh_m = "cloud.ply", 10, None, np.zeros(3)
        self.values = {name: np.broadcast_to(np.asarray(values), 10) for name, values in columns.items()}
        self.columns = {name: values.dtype for name, values in self.values.items()}

    def chunks(self, size: int = 4) -> Iterator[CloudChunk]:
        yield CloudChunk(np.zeros((10, 3)), self.values)

    def column(self, name: str, size: int = 4) -> Iterator[np.ndarray]:
        yield from np.split(self.values[name], [4, 8])


@pytest.fixture(scope="module")
def corrections() -> PoseCorrections:
    return pose_corrections(TRAJECTORY, TRAJECTORY)


@pytest.mark.parametrize(
    ("columns", "by", "why"),
    [
        ({"stamp_s": MIDDLE_S, "pose_index": 3}, "stamp", r"^its stamp_s 17.* to 17.* \(trajectory: 17"),
        ({"stamp_s": 0.0, "pose_index": 3}, "index", r"^its pose_index 3 to 3 \(trajectory: 12 poses\)"),
        ({"stamp_s": np.nan, "pose_index": 3}, "index", "^its pose_index"),
        ({"pose_index": 3}, "index", "^its pose_index"),
        ({"pose_index": 3.0}, "nearest", "its pose_index is float64, not a whole number"),
        ({"pose_index": 12}, "nearest", r"no pose saw any of its points by pose_index 12 to 12"),
        ({"stamp_s": MIDDLE_S + 100.0}, "nearest", r"no pose saw any of its points by stamp_s 17"),
        (
            {"stamp_s": np.float32(MIDDLE_S)},
            "nearest",
            r"float32 at 1\.7e\+09 s, come in steps of 128 s, the poses every",
        ),
        ({}, "nearest", "it has no stamp_s; it has no pose_index"),
    ],
)
def test_the_first_column_that_leads_to_poses(corrections: PoseCorrections, columns: dict, by: str, why: str) -> None:
    chosen = choose_by(Columns(**columns), corrections)
    assert chosen.by == by
    assert chosen.n_outside == 0
    assert re.search(why, chosen.why), chosen.why


def test_points_outside_are_counted(corrections: PoseCorrections) -> None:
    stamp_s = np.where(np.arange(10) < 3, EPOCH_S + 1e4, MIDDLE_S)
    source = Columns(stamp_s=stamp_s)
    chosen = choose_by(source, corrections)
    assert (chosen.by, chosen.n_outside) == ("stamp", 3)
    _, inside = place_finder(corrections, chosen)(next(source.chunks()))
    np.testing.assert_array_equal(inside, np.arange(10) >= 3)
    most = choose_by(Columns(stamp_s=stamp_s[::-1], pose_index=1), corrections)
    assert most.by == "stamp"
    few = choose_by(Columns(stamp_s=np.where(np.arange(10) < 6, 0.0, MIDDLE_S), pose_index=1), corrections)
    assert few.by == "index"


def test_what_is_asked_for_is_done_or_refused(corrections: PoseCorrections) -> None:
    both = Columns(stamp_s=MIDDLE_S, pose_index=3)
    assert choose_by(both, corrections, "index").by == "index"
    assert choose_by(both, corrections, "nearest").by == "nearest"
    some = choose_by(Columns(stamp_s=np.where(np.arange(10) < 9, 0.0, MIDDLE_S)), corrections, "stamp")
    assert (some.by, some.n_outside) == ("stamp", 9)
    with pytest.raises(CloudError, match=r"cloud\.ply: cannot be carried by stamp: it has no stamp_s"):
        choose_by(Columns(pose_index=3), corrections, "stamp")
    with pytest.raises(CloudError, match="cannot be carried by stamp: its stamps, float32"):
        choose_by(Columns(stamp_s=np.float32(MIDDLE_S)), corrections, "stamp")


def test_the_hold_reaches_the_stamps(corrections: PoseCorrections) -> None:
    late = Columns(stamp_s=TRAJECTORY.stamp_s[-1] + 2.0)
    assert choose_by(late, corrections).by == "nearest"
    assert choose_by(late, corrections, hold_s=2.1).by == "stamp"
