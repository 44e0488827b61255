"""`jaxgeo study paper`: the reference study made anew on simulated sessions, tables, figures and report in one go."""

import dataclasses
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from eval.clouds import CloudDistance, nearest_neighbour
from eval.reference_study import CITATION
from eval.study_figures import study_figures
from eval.study_files import put_files, study_files
from eval.study_page import study_page
from eval.tables.clouds import clouds_table
from eval.tables.cost import cost_table
from eval.tables.study import study_tables
from jaxgeo.cli.evaluated import EvaluatedSession, evaluate_session
from jaxgeo.cli.machine import device_words
from jaxgeo.cli.progress import Progress
from jaxgeo.cli.run import keep_compiled_programs
from jaxgeo.config import load_config
from jaxgeo.data import Trajectory
from jaxgeo.export.json_text import json_text
from jaxgeo.export.metrics import metrics_dict
from jaxgeo.export.result import SessionResult
from jaxgeo.export.table import Table, table_files
from jaxgeo.io.atomic import check_output_folder, output_folder
from jaxgeo.simulate import UAV, UGV, Layout, SimulatedSession, paper_drift, simulate_session, write_session_files
from jaxgeo.simulate.cloud import cloud_of, see_scene

LAYOUTS = {"uav": UAV, "ugv": UGV}
# What differs from run to run: nothing else does.
VARYING = ("run.json", "cost")
LEAD = (
    "The analyses of the reference study (below), made anew on two simulated sessions of its layout: six surveyed "
    "locations, one of them visited twice, two trajectories a session, with drifts that leave revisit gaps of the "
    "sizes it reports. Simulated: the tables show the method at work and what learning the noise adds; they are no "
    "accuracy of any real system.",
    f"Reference study: {CITATION}. Its figures stand beside ours; its recordings are other data.",
)


def study_paper(
    out: Path,
    seed: int,
    orthophoto: Path | None,
    overrides: Sequence[str],
    quiet: bool,
    layouts: dict[str, Layout] = LAYOUTS,
) -> None:
    """Simulate, run, evaluate, tabulate, draw. For one seed the same bytes each time, but for `VARYING`.

    Args:
        out: folder, written whole or not at all.
        seed: of both sessions; every analysis has it, too.
        orthophoto: GeoTIFF under the maps.
        overrides: of both sessions' configs, `key=value`.
        layouts: of the two sessions.

    Raises:
        JaxgeoError: bad input, or an estimate that is not to be had; nothing is written then.
    """
    started = time.perf_counter()
    check_output_folder(out)
    keep_compiled_programs()
    with Progress(quiet) as progress, output_folder(out) as temporary:
        simulated: dict[str, SimulatedSession] = {}
        sessions: dict[str, EvaluatedSession] = {}
        for name, layout in layouts.items():
            progress.phase("simulate", name)
            session = simulated[name] = simulate_session(seed, layout, drift=paper_drift(layout))
            path = write_session_files(session, temporary / "sessions" / name)
            basemap = [] if orthophoto is None else [f"basemap={orthophoto.resolve()}"]
            config = load_config(path, [f"name={name}", *basemap, *overrides])
            true = {trajectory: session.true_noise(trajectory) for trajectory in session.trajectories}
            sessions[name] = evaluate_session(config, progress, true=true)
        progress.phase("clouds")
        found, floor = cloud_distances(simulated, sessions)
        progress.phase("tables and figures")
        by_name = [{e.name: e for e in s.evaluations} for s in sessions.values()]
        files = paper_files(sessions, clouds_table(found, floor, by_name, beside=True), seed)
        run = {
            "simulated": True,
            "seed": seed,
            "device": device_words(),
            "seconds": time.perf_counter() - started,
            "versions": next(iter(sessions.values())).result.run["versions"],
        }
        put_files(temporary, files | {"run.json": json_text(run)})
    if not quiet:
        print(f"simulated study, seed {seed}: {out / 'report.html'}")


def paper_files(sessions: dict[str, EvaluatedSession], clouds: Table, seed: int) -> dict[str, str | bytes]:
    """Every file but the sessions' own and run.json, by its path."""
    evaluations = [e for s in sessions.values() for e in s.evaluations]
    results = [without_times(s.result) for s in sessions.values()]
    tables = study_tables(
        evaluations,
        {name: np.asarray(s.result.frame.origin_enh_m) for name, s in sessions.items()},
        {(name, t): noise for name, s in sessions.items() for t, noise in s.fixed.items()},
        {(name, t): noise for name, s in sessions.items() for t, noise in s.true.items()},
        beside=True,
    )
    tables = (*tables, clouds)
    figures = study_figures(results, evaluations, beside=True)
    made_with = {"seed": seed, "versions": results[0].run["versions"]}
    report = study_page("The reference study on simulated sessions", LEAD, results, tables, figures, made_with)
    files = study_files(tables, figures) | {"report.html": report}
    files["metrics.json"] = json_text({result.name: metrics_dict(result) for result in results})
    cost = cost_table(evaluations, device_words(), beside=True)
    if cost is not None:
        files |= {f"cost/{name}": text for name, text in table_files([cost]).items() if name != "tables.md"}
    return files


def cloud_distances(
    simulated: dict[str, SimulatedSession], sessions: dict[str, EvaluatedSession]
) -> tuple[dict[tuple[str, str], CloudDistance], CloudDistance]:
    """From the first session's cloud to the second's, by trajectory and stage; and carried by the true trajectories."""
    first, second = sessions

    seen = {name: see_scene(session) for name, session in simulated.items()}

    def distance(carry: dict[str, Trajectory]) -> CloudDistance:
        return nearest_neighbour(*(cloud_of(carry[name], seen[name]) for name in (first, second)))

    evaluations = {name: {e.name: e for e in s.evaluations} for name, s in sessions.items()}
    found = {}
    for trajectory in simulated[first].trajectories:
        estimates = {name: each[trajectory].estimates for name, each in evaluations.items()}
        for stage in estimates[first]:
            if all(stage in each for each in estimates.values()):
                found[trajectory, stage] = distance({n: each[stage] for n, each in estimates.items()})
    return found, distance({name: s.truth for name, s in simulated.items()})


def without_times(result: SessionResult) -> SessionResult:
    """What is the same in every run: no times, and no place on this machine's disk."""
    trajectories = {n: dataclasses.replace(t, timing_s={}) for n, t in result.trajectories.items()}
    run = {key: value for key, value in result.run.items() if key != "timing_s"}
    return dataclasses.replace(result, trajectories=trajectories, run=run, config=file_names(result.config))


def file_names(value: Any) -> Any:
    """A config whose absolute paths are their last part: the session's files lie beside it."""
    if isinstance(value, dict):
        return {key: file_names(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [file_names(inner) for inner in value]
    return Path(value).name if isinstance(value, str) and Path(value).is_absolute() else value
