"""Many small sessions through `jaxgeo campaign`: `python -m benchmarks.campaign [--json] [--sessions N] [--pool]`.

One worker of two is killed (SIGKILL) half-way. All rows have to be there, none twice; throughput, with starting and
killing in it, is compared with a plain loop over some of the sessions in one warm process, half of it before the
campaign and half after. Both may use the same cores: the loop's XLA takes all of them for each program, every worker
of the campaign one. Processor time a session is given beside it: where others use the machine too, the processes of
one terminal may share one share of its cores, and it says what Dask and starting cost. `--pool` measures instead what
noise pooled over the other sessions gains.
"""

import json
import os
import signal
import statistics
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import psutil
import typer

from eval.campaign import write_platform_sessions
from eval.montecarlo.regimes import regimes_named
from jaxgeo.cli.campaign import SUMMARY, TABLE, run_campaign
from jaxgeo.cli.campaign_pass import CampaignAsked, first_tasks, rows_of
from jaxgeo.cli.campaign_rows import ROWS, SessionRow
from jaxgeo.cli.campaign_sessions import campaign_sessions
from jaxgeo.cli.campaign_task import library_versions, run_task
from jaxgeo.precision import enable_compilation_cache

REGIME = "misassumed"
POOL_REGIMES = "misassumed,biased,gauss-markov,scale"
LOOP_SESSIONS = 60
# First calls of the loop: its programs are loaded, one for each number of visits and locations.
WARM_SESSIONS = 4


class Killer(threading.Thread):
    """Kills one worker process when half of the rows are there and all workers are in the middle of a session."""

    def __init__(self, rows: Path, at: int, workers: int) -> None:
        super().__init__(daemon=True)
        self._rows, self._at, self._workers = rows, at, workers
        self.killed: int | None = None

    def run(self) -> None:
        while len(list(self._rows.glob("*.json"))) < self._at:
            time.sleep(0.1)
        while len(list(self._rows.glob("[0-9a-f]*.attempts"))) < self._workers:
            time.sleep(0.01)
        time.sleep(0.05)
        workers = [p for p in psutil.Process().children(recursive=True) if "spawn_main" in " ".join(p.cmdline())]
        self.killed = workers[0].pid
        os.kill(self.killed, signal.SIGKILL)


def measure(n: int, workers: int, loop: int, folder: Path) -> dict[str, Any]:
    """Campaign and loop over the same sessions, and whether they agree."""
    import pyarrow.parquet as pq

    configs = write_platform_sessions(folder / "sessions", regimes_named(REGIME)[0], n)
    loop = min(loop, n)
    some = configs[:loop]
    run_loop(some[:WARM_SESSIONS], folder / "warm")
    cpu = cpu_s()
    before_s, before = run_loop(some[: loop // 2], folder / "loop_before")
    loop_cpu_s = (cpu_s() - cpu) / (loop // 2)
    out = folder / "campaign"
    killer = Killer(out / ROWS, n // 2, workers)
    killer.start()
    load_start = os.getloadavg()[0]
    started, cpu = time.perf_counter(), cpu_s()
    code = run_campaign(CampaignAsked([str(folder / "sessions")], out, workers, quiet=True))
    campaign_s, campaign_cpu_s = time.perf_counter() - started, cpu_s() - cpu
    load_end = os.getloadavg()[0]
    after_s, after = run_loop(some[loop // 2 :], folder / "loop_after")
    table = pq.read_table(out / TABLE).to_pylist()
    found = {row["config"]: row for row in table}
    looped = dict(zip([str(path.resolve()) for path in some], [*before, *after], strict=True))
    apart_m = max(
        abs(found[config]["held_out_learned_mean_m"] - row.trajectories["icp"]["loo"]["learned"]["mean_m"])
        for config, row in looped.items()
    )
    loop_per_s, campaign_per_s = loop / (before_s + after_s), n / campaign_s
    return {
        "sessions": n,
        "workers": workers,
        "exit_code": code,
        "campaign_rows": len(table),
        "campaign_rows_twice": len(table) - len(found),
        "campaign_rows_missing": n - len(found),
        "campaign_rows_ok": sum(row["status"] == "ok" for row in table),
        "worker_killed": killer.killed is not None,
        "sessions_restarted": sum(row["attempts"] > 1 for row in table),
        "campaign_s": campaign_s,
        "campaign_per_s": campaign_per_s,
        "loop_sessions": loop,
        "loop_per_s": loop_per_s,
        "loop_per_s_before_after": [loop // 2 / before_s, (loop - loop // 2) / after_s],
        "campaign_speedup": campaign_per_s / loop_per_s,
        "loop_cpu_s_per_session": loop_cpu_s,
        "campaign_cpu_s_per_session": campaign_cpu_s / n,
        "loop_median_s": statistics.median(row.seconds for row in looped.values()),
        "campaign_median_s": statistics.median(row["seconds_s"] for row in table),
        # The rest of the workers' time: starting, being killed, waiting for the last session, ending.
        "campaign_in_sessions": sum(row["seconds_s"] for row in table) / (workers * campaign_s),
        "apart_m": apart_m,
        "cores": len(os.sched_getaffinity(0)),
        "load_average": [load_start, load_end],
    }


def cpu_s() -> float:
    """Processor time of this process and of its children that have ended."""
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system


def run_loop(configs: list[Path], out: Path) -> tuple[float, list[SessionRow]]:
    """The same work without Dask: every task in this process, one after the other."""
    versions = library_versions()
    (out / ROWS).mkdir(parents=True)
    asked = CampaignAsked([], out, 1)
    tasks = first_tasks(asked, campaign_sessions(configs, [], versions, out), out, versions)
    started = time.perf_counter()
    for task in tasks:
        run_task(task)
    return time.perf_counter() - started, rows_of(tasks)


def measure_pool(n: int, workers: int, folder: Path) -> dict[str, Any]:
    """What a prior from the other sessions gains, on `n` short sessions of each simulated platform."""
    found = {}
    for regime in regimes_named(POOL_REGIMES):
        sessions = folder / "sessions" / regime.name
        write_platform_sessions(sessions, regime, n)
        out = folder / regime.name
        run_campaign(CampaignAsked([str(sessions)], out, workers, pool=True, quiet=True))
        found[regime.name] = json.loads((out / SUMMARY).read_text(encoding="utf-8"))["pooled"]["all"]
    return found


def main(
    as_json: bool = typer.Option(False, "--json", help="One JSON object."),
    sessions: int = typer.Option(500, min=2, help="Sessions of the campaign; with --pool of each platform."),
    workers: int = typer.Option(2, min=1, help="Worker processes."),
    loop: int = typer.Option(LOOP_SESSIONS, min=2, help="Sessions of the plain loop."),
    pool: bool = typer.Option(False, "--pool", help="Measure what pooling gains instead."),
) -> None:
    enable_compilation_cache()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        found = measure_pool(sessions, workers, folder) if pool else measure(sessions, workers, loop, folder)
    if as_json:
        print(json.dumps(found, allow_nan=False))
        return
    for name, value in found.items():
        print(f"{name:<28}{value}")


if __name__ == "__main__":
    typer.run(main)
