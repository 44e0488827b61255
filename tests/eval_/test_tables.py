"""What rows say of how they were computed, where several trajectories or failed choices stand behind one row."""

from types import SimpleNamespace

import numpy as np
import pytest

from eval.subsets import SubsetErrors
from eval.tables.by_count import by_count_table
from eval.tables.uncertainty import uncertainty_table
from jaxgeo.export.result import HeldOut
from jaxgeo.export.table import Table


class Anchors(SimpleNamespace):
    def __len__(self) -> int:
        return len(self.location)


def evaluation(session: str, seed: int, failed: int) -> SimpleNamespace:
    """What the tables read of one trajectory: four choices of three locations, of which some failed."""
    error = np.where(np.arange(4)[:, None] < failed, np.nan, 1.0 + seed) * np.ones((4, 5))
    used = ~np.eye(4, 4, dtype=bool)
    choices = SubsetErrors(3, 4, used, error, error, np.ones((4, 5)), np.arange(4) < failed)
    held_out = HeldOut(np.full((5, 3), 0.1), np.tile(np.eye(3), (5, 1, 1)), ("converged",) * 4 + ("not settled",))
    return SimpleNamespace(
        session=session,
        name="icp",
        simulated=False,
        seed=seed,
        versions={"jaxgeo": str(seed)},
        subsets={"fixed": (choices,)},
        held_out={"fixed": held_out},
        anchors=Anchors(location=("A", "B", "C", "D", "A")),
        result=SimpleNamespace(noise={"fixed": {"sigma_trans_m_per_sqrt_m": 0.01 * (1 + seed)}}),
    )


@pytest.fixture
def both() -> list[SimpleNamespace]:
    return [evaluation("one", 0, failed=1), evaluation("other", 1, failed=2)]


def rows(table: Table | None) -> list[dict[str, object]]:
    assert table is not None
    return [dict(zip((c.head for c in table.columns), row, strict=True)) for row in table.rows]


def test_pooled_choices_count_every_sessions_failures_and_name_both_noises(both):
    (row,) = rows(by_count_table(both, beside=True))
    assert (row["choices"], row["failed"]) == (8, 3)
    assert row["result"] == "5 converged; 3 failed"
    assert row["anchors"] == "those of 3 locations"
    assert row["noise"] == "sigma_trans_m_per_sqrt_m 0.01 | sigma_trans_m_per_sqrt_m 0.02"
    assert row["seed"] == "0; 1"


def test_choices_of_one_session_are_its_own(both):
    one, other = rows(by_count_table(both))
    assert (one["session"], one["result"], one["seed"]) == ("one", "3 converged; 1 failed", "0")
    assert (other["session"], other["result"], other["seed"]) == ("other", "2 converged; 2 failed", "1")


def test_the_row_of_all_trajectories_is_of_all(both):
    *single, together = rows(uncertainty_table(both))
    assert [row["anchors"] for row in single] == ["5", "5"]
    assert (together["anchors"], together["n"], together["seed"]) == ("5 + 5", 10, "0; 1")
    assert together["result"] == "8 converged; 2 not settled"
