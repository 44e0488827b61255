"""The Monte-Carlo study's bookkeeping: what decides results, files that are kept, and rows from known records."""

import dataclasses

import jax
import numpy as np
import pytest

from eval.montecarlo.batch import STAGES
from eval.montecarlo.chunks import chunk_path, open_folder, read_chunks, write_chunk
from eval.montecarlo.records import SIGMAS, Records, together
from eval.montecarlo.regimes import REGIMES, regimes_named
from eval.montecarlo.sessions import session_arrays, stacked
from eval.montecarlo.settings import StudySettings, study_settings
from eval.montecarlo.summary import regime_rows, sigma_ratio, summary_dict
from eval.montecarlo.tables import sessions_table, study_tables
from eval.montecarlo.workers import simulated
from jaxgeo.errors import InputError
from jaxgeo.export.json_text import json_text

K, F = 7, 7


def settings_of(draws: int = 10, **changes) -> StudySettings:
    return study_settings(
        draws, 3, regimes_named("white,scale"), platform="cpu", poses=128, **{"chunk": 4, "batch": 1, **changes}
    )


def records_of(sessions: range, settings: StudySettings, length_m: float = 1.0) -> Records:
    """Errors of `length_m` times (stage + 1) along east, unit covariances, learned sigmas twice the true ones."""
    n, c = len(sessions), len(SIGMAS)
    error_m = np.zeros((n, 4, K, 3))
    error_m[..., 0] = length_m * np.arange(1.0, 5.0)[:, None]
    covariance_m2 = np.broadcast_to(np.eye(3), (n, 4, K, 3, 3)).copy()
    covariance_m2[:, 0] = np.nan
    sigma = np.tile([2.0, 1.5, 2.5, 0.5, 3.0, 0.2], (n, c, 1))
    number = np.array(sessions)
    return Records(
        session=number,
        seed=settings.seed + number,
        regime=number % 2,
        location=np.tile([0, 1, 2, 3, 4, 5, 0], (n, 1)),
        error_m=error_m,
        covariance_m2=covariance_m2,
        good=np.ones((n, 4, F), dtype=bool),
        sigma=sigma,
        true_sigma=np.ones((n, c)),
        model_weight=np.full((n, 6), 1.0 / 6.0),
        rounds=np.full((n, F), 4),
        stuck=np.zeros(n, dtype=bool),
    )


def test_a_session_depends_on_its_number_alone():
    few, many = settings_of(4), settings_of(40, chunk=3, batch=5)
    for i in range(4):
        assert few.regime_of(i) == many.regime_of(i)
        assert few.seed_of(i) == many.seed_of(i) == 3 + i
    one, again = (session_arrays(REGIMES["white"], 5, few.layout) for _ in range(2))
    assert all(np.array_equal(a, b) for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(again), strict=True))
    other = session_arrays(REGIMES["white"], 6, few.layout)
    assert not np.array_equal(one.chain.start.t[0], other.chain.start.t[0])


def test_sessions_come_in_their_order():
    settings = settings_of()
    alone = [session_arrays(settings.regime_of(i), settings.seed_of(i), settings.layout) for i in (1, 4, 5)]
    with simulated(settings, [1, 4, 5], workers=0, ahead=1) as found:
        for one, own in zip(found, alone, strict=True):
            assert np.array_equal(one.chain.start.t[0], own.chain.start.t[0])


def test_the_last_call_is_filled_up():
    stack = stacked([{"a": np.array([1.0])}, {"a": np.array([2.0])}], 5)
    assert stack["a"].tolist() == [[1.0], [2.0], [2.0], [2.0], [2.0]]


def test_what_is_constant_is_drawn_a_session():
    regime = REGIMES["biased"]
    drawn = np.array([regime.drawn(seed).bias_trans_m_per_m for seed in range(300)])
    assert drawn.std(axis=0) == pytest.approx(0.015, rel=0.15)
    assert regime.drawn(4) == regime.drawn(4) != regime.drawn(5)
    scale = np.array([REGIMES["scale"].drawn(seed).log_scale for seed in range(300)])
    assert scale.std() == pytest.approx(0.03, rel=0.15)
    assert REGIMES["white"].drawn(1) == REGIMES["white"].drift


@pytest.mark.parametrize("names", ["", "white,white", "white,purple"])
def test_unknown_regimes_are_refused(names):
    with pytest.raises(InputError, match="--regimes"):
        regimes_named(names)


def test_chunks_are_read_back_and_spoiled_ones_named(tmp_path):
    settings = settings_of()
    open_folder(tmp_path, settings)
    parts = [records_of(sessions, settings) for sessions in settings.chunks()]
    assert [len(part) for part in parts] == [4, 4, 2]
    for number, part in enumerate(parts):
        write_chunk(tmp_path, number, part, settings)
    found, warnings = read_chunks(tmp_path, settings)
    assert warnings == []
    for field in dataclasses.fields(Records):
        assert np.array_equal(getattr(found[2], field.name), getattr(parts[2], field.name), equal_nan=True)
    # One cut short, one of other sessions, one of another study.
    whole = chunk_path(tmp_path, 0).read_bytes()
    chunk_path(tmp_path, 0).write_bytes(whole[: len(whole) // 2])
    chunk_path(tmp_path, 2).write_bytes(chunk_path(tmp_path, 1).read_bytes())
    write_chunk(tmp_path, 1, parts[1], settings_of(11))
    found, warnings = read_chunks(tmp_path, settings)
    assert found == {}
    assert [part in " ".join(warnings) for part in ("00000.npz", "another study", "expected sessions 8 to 9")] == [
        True
    ] * 3


@pytest.mark.parametrize(
    ("changes", "key"),
    [({"draws": 11}, "draws"), ({"chunk": 5}, "chunk"), ({"batch": 2}, "batch"), ({"poses": 256}, "layout.n_poses")],
)
def test_another_study_in_the_folder_is_refused(tmp_path, changes, key):
    open_folder(tmp_path, settings_of())
    open_folder(tmp_path, settings_of())
    base = {"draws": 10, "poses": 128, "chunk": 4, "batch": 1} | changes
    other = study_settings(
        base["draws"],
        3,
        regimes_named("white,scale"),
        platform="cpu",
        **{name: base[name] for name in ("poses", "chunk", "batch")},
    )
    with pytest.raises(InputError, match=rf"settings.json: .*: {key} is"):
        open_folder(tmp_path, other)


def test_a_foreign_settings_file_is_refused(tmp_path):
    (tmp_path / "settings.json").write_text("[1]", encoding="utf-8")
    with pytest.raises(InputError, match="is not the settings of a Monte-Carlo study"):
        open_folder(tmp_path, settings_of())


def test_rows_say_what_the_records_hold():
    settings = settings_of()
    records = records_of(range(10), settings)
    white, scale = regime_rows(records, settings)
    assert (white.regime, white.n, white.n_failed, scale.regime) == ("white", 5, 0, "scale")
    assert white.error_mean_m == pytest.approx(dict(zip(STAGES, (1.0, 2.0, 3.0, 4.0), strict=True)))
    assert white.ratio == pytest.approx({"similarity": 0.25, "fixed": 0.5, "learned": 0.75})
    assert white.ratio_interval["learned"] == pytest.approx((0.75, 0.75))
    sigma = next(s for s in white.sigmas if s.component == "trans_m_per_sqrt_m")
    assert (sigma.median, sigma.low, sigma.high) == pytest.approx((2.0, 2.0, 2.0))
    # Twice the truth is not within 1.5 times; the 95 % interval, 0.5 to 3, holds it, the 68 % one, 1.5 to 2.5, not.
    assert (sigma.within, sigma.identifiable, sigma.coverage_68, sigma.coverage_95) == (0.0, 1.0, 0.0, 1.0)
    # Errors of 2 m under unit covariances: NEES 4, inside the 95 % ellipsoid (7.81), outside that of 50 % (2.37).
    fixed = white.uncertainty["fixed"]
    assert (fixed.nees_mean, fixed.coverage_50, fixed.coverage_95) == pytest.approx((4.0, 0.0, 1.0))


def test_failed_sessions_are_counted_and_in_no_mean():
    settings = settings_of()
    good, bad = records_of(range(8), settings), records_of(range(8, 10), settings, length_m=1000.0)
    bad.good[:, 2, 3] = False
    bad.stuck[:] = True
    records = together([good, bad])
    white, scale = regime_rows(records, settings)
    assert (white.n, white.n_failed, scale.n_failed) == (4, 1, 1)
    assert white.error_mean_m["similarity"] == pytest.approx(1.0)
    assert white.stuck_share == pytest.approx(0.2)
    assert summary_dict((white, scale), records, settings)["failed"] == 2


def test_a_regime_of_failures_alone_has_no_figures():
    settings = settings_of()
    records = records_of(range(4), settings)
    records.good[:, 1] = False
    rows = regime_rows(records, settings)
    assert [(row.n, row.n_failed) for row in rows] == [(0, 2), (0, 2)]
    assert np.isnan(rows[0].ratio["learned"])
    assert "null" in json_text(summary_dict(rows, records, settings))
    assert len(study_tables(rows)[0].rows) == 2


def test_only_errors_that_the_odometry_has_are_compared():
    settings = settings_of()
    records = records_of(range(4), settings)
    records.true_sigma[:] = 0.0
    records.true_sigma[:, SIGMAS.index("log_scale")] = 0.5
    rows = regime_rows(records, settings)
    assert [s.component for s in rows[1].sigmas] == ["log_scale"]
    assert sigma_ratio(records, "log_scale").tolist() == [4.0] * 4
    table = sessions_table(records, settings)
    heads = [column.full_title for column in table.columns]
    row = dict(zip(heads, table.rows[0], strict=True))
    assert row["learned over true: log_scale"] == 4.0
    assert row["learned over true: bounded_m"] is None
    assert "simulated" in table.title
