"""The study's rows as tables, and a row a session."""

import dataclasses
from collections.abc import Iterator

import numpy as np

from eval.montecarlo.batch import STAGES
from eval.montecarlo.records import SIGMAS, Records
from eval.montecarlo.settings import StudySettings
from eval.montecarlo.summary import WHITE, RegimeRow, identifiable, session_error_m, sigma_ratio
from jaxgeo.export.table import Column, Table
from jaxgeo.graph.components import COMPONENTS, ROT, TRANS

# Their geometric means are in the table.
AXES = (*COMPONENTS[TRANS], *COMPONENTS[ROT])
SIMULATED = "Simulated sessions: what learning costs and gains where the truth is known, not how real odometry errs."


def study_tables(rows: tuple[RegimeRow, ...]) -> list[Table]:
    """The tables of a study."""
    return [_errors(rows), _sigmas(rows), _uncertainty(rows)]


def _span(interval: tuple[float, float], digits: int) -> str:
    low, high = interval
    return f"{low:.{digits}f} to {high:.{digits}f}" if low == low else "–"


def _errors(rows: tuple[RegimeRow, ...]) -> Table:
    ratios = STAGES[:-1]
    return Table(
        name="summary",
        title="Monte-Carlo (simulated): held-out errors, and how far from those with the true noise",
        columns=(
            Column("regime", align="left"),
            Column("sessions"),
            Column("failed"),
            Column("stuck", unit="%", digits=1, factor=100.0),
            *(Column(stage, unit="cm", group="mean held-out error", digits=1, factor=100.0) for stage in STAGES),
            *(
                column
                for stage in ratios
                for column in (
                    Column(stage, group="error over that with the true noise", digits=3),
                    Column(f"{stage}, 95 %", group="error over that with the true noise", align="left"),
                )
            ),
        ),
        rows=tuple(
            (
                row.regime,
                row.n,
                row.n_failed,
                row.stuck_share,
                *(row.error_mean_m[stage] for stage in STAGES),
                *(x for stage in ratios for x in (row.ratio[stage], _span(row.ratio_interval[stage], 3))),
            )
            for row in rows
        ),
        notes=(
            SIMULATED,
            *(f"{row.regime}: {row.words}." for row in rows),
            "Every location is held out in turn; the learned noise is learned anew without it. Means over sessions and "
            "visits; intervals: bootstrap over sessions.",
            "Failed sessions (a fold not determined or not converged) are in no mean. Stuck, of all sessions: learning "
            "ran away from its prior or did not converge in some fold; these stay in the means.",
            "The true noise is that of the odometry's own, longer way, and the graph's model of it: a ratio can lie a "
            "little below one.",
        ),
    )


def _sigmas(rows: tuple[RegimeRow, ...]) -> Table:
    share = {"unit": "%", "digits": 0, "factor": 100.0}
    return Table(
        name="sigmas",
        title="Monte-Carlo (simulated): learned over true standard deviations of the odometry noise",
        columns=(
            Column("regime", align="left"),
            Column("component", align="left"),
            Column("sessions"),
            Column("median", group="learned over true", digits=2),
            Column("5 %", group="learned over true", digits=2),
            Column("95 %", group="learned over true", digits=2),
            Column("all", group="within 1.5 times", **share),
            Column("identifiable", group="within 1.5 times", **share),
            Column("identifiable", **share),
            Column("68 %", group="interval covers", **share),
            Column("95 %", group="interval covers", **share),
        ),
        rows=tuple(
            (
                row.regime,
                s.component,
                s.n,
                s.median,
                s.low,
                s.high,
                s.within,
                s.within_identifiable,
                s.identifiable,
                s.coverage_68,
                s.coverage_95,
            )
            for row in rows
            for s in row.sigmas
            if s.component not in AXES
        ),
        notes=(
            SIMULATED,
            "Identifiable: the estimate itself claims to know the sigma by a factor of 1.5 (one standard deviation).",
            "trans_m_per_sqrt_m and rot_rad_per_sqrt_m are geometric means over three axes; the axes themselves are in "
            "summary.json. Of what is constant over a session the truth is what the sessions were drawn from.",
            "What wanders and white noise can stand for each other over a few visits: where the odometry wanders, the "
            "learned white sigma has part of it.",
        ),
    )


def _uncertainty(rows: tuple[RegimeRow, ...]) -> Table:
    share = {"unit": "%", "digits": 1, "factor": 100.0}
    return Table(
        name="uncertainty",
        title="Monte-Carlo (simulated): held-out markers inside their own predicted ellipsoids",
        columns=(
            Column("regime", align="left"),
            Column("noise", align="left"),
            Column("markers"),
            Column("inside 50 %", **share),
            Column("inside 95 %", **share),
            Column("mean NEES", digits=2),
            Column("predicted RMS", unit="cm", digits=1, factor=100.0),
            Column("achieved RMS", unit="cm", digits=1, factor=100.0),
        ),
        rows=tuple(
            (
                row.regime,
                stage,
                u.n,
                u.coverage_50,
                u.coverage_95,
                u.nees_mean,
                u.predicted_rms_m,
                u.achieved_rms_m,
            )
            for row in rows
            for stage, u in row.uncertainty.items()
        ),
        notes=(SIMULATED, "The mean NEES is 3 where the predicted covariances are right."),
    )


def sessions_table(records: Records, settings: StudySettings) -> Table:
    """A row a session: its errors by stage, what was learned against the truth, and how it went."""
    return Table(
        name="sessions",
        title="Monte-Carlo (simulated): every session",
        columns=(
            Column("session"),
            Column("regime", align="left"),
            Column("seed"),
            *(Column(stage, unit="m", group="mean held-out error") for stage in STAGES),
            *(Column(name, group="learned over true") for name in SIGMAS),
            *(Column(name, group="identifiable") for name in WHITE),
            *(Column(stage, group="converged") for stage in STAGES),
            Column("stuck"),
        ),
        rows=tuple(_session_rows(records, settings)),
    )


def _session_rows(records: Records, settings: StudySettings) -> Iterator[tuple]:
    error_m = session_error_m(records)
    claimed = [identifiable(records, name) for name in WHITE]
    exists = records.true_sigma > 0
    ratio = {name: sigma_ratio(_with_something(records), name) for name in SIGMAS}
    for i in range(len(records)):
        yield (
            int(records.session[i]),
            settings.regimes[int(records.regime[i])].name,
            int(records.seed[i]),
            *error_m[i].tolist(),
            *(float(ratio[name][i]) if exists[i, c] else None for c, name in enumerate(SIGMAS)),
            *(int(each[i]) for each in claimed),
            *(int(x) for x in records.good[i].all(axis=1)),
            int(records.stuck[i]),
        )


def _with_something(records: Records) -> Records:
    """Ones where there is no such error, so that nothing is divided by zero; those cells are left empty."""
    return dataclasses.replace(records, true_sigma=np.where(records.true_sigma > 0, records.true_sigma, 1.0))
