"""`jaxgeo campaign`: many sessions, each georeferenced and held out by itself, on a Dask cluster; resumable."""

import contextlib
import functools
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxgeo.cli.campaign_cluster import campaign_client, need_dask
from jaxgeo.cli.campaign_columns import columns, table_rows
from jaxgeo.cli.campaign_parquet import need_pyarrow, write_parquet
from jaxgeo.cli.campaign_pass import CampaignAsked, first_tasks, rows_of, run_pass
from jaxgeo.cli.campaign_rows import ROWS, remove_torn
from jaxgeo.cli.campaign_sessions import campaign_sessions, config_paths
from jaxgeo.cli.campaign_summary import pool_summary, summary
from jaxgeo.cli.campaign_task import library_versions
from jaxgeo.cli.progress import Progress
from jaxgeo.export.csv_text import csv_text
from jaxgeo.export.json_text import json_text
from jaxgeo.io.atomic import atomic_path, check_output_folder

if TYPE_CHECKING:
    from jaxgeo.cli.campaign_cluster import Client

TABLE, TABLE_TEXT, SUMMARY = "campaign.parquet", "campaign.csv", "summary.json"
SHOWN_FAILURES = 5


def run_campaign(asked: CampaignAsked) -> int:
    """Run what is not done yet, write the tables, and return the exit code: 0, or the gravest of the failed sessions'.

    Raises:
        JaxgeoError: no such sessions, no cluster, or a folder that cannot be written to.
    """
    started = time.perf_counter()
    need_dask()
    need_pyarrow()
    check_output_folder(asked.out)
    out = asked.out.absolute()
    paths, said = config_paths(asked.sessions)
    versions = library_versions()
    sessions = campaign_sessions(paths, asked.overrides, versions, out)
    (out / ROWS).mkdir(parents=True, exist_ok=True)
    remove_torn(out)
    _say(said)
    with _Cluster(asked) as cluster, Progress(asked.quiet) as progress:
        tasks = first_tasks(asked, sessions, out, versions)
        computed = run_pass(tasks, cluster.client, progress, "sessions", asked.fresh)
        rows = rows_of(tasks)
        pooled, platforms = None, {}
        if asked.pool:
            from jaxgeo.cli.campaign_second_pass import second_pass

            pooled, platforms = second_pass(asked, sessions, rows, tasks, out, cluster.client, progress)
    remove_torn(out)
    table = table_rows(sessions, rows, pooled)
    found = summary(table, versions, time.perf_counter() - started, computed)
    if pooled is not None:
        found |= {"pooled": pool_summary(table), "platforms": platforms}
    write_results(out, table, found, pooled is not None)
    _report(asked, table, found)
    return found["exit_code"]


def write_results(out: Path, table: Sequence[dict[str, Any]], found: dict[str, Any], pooled: bool) -> None:
    """The table, typed and as text, and the summary; each replaces an older one in one step."""
    which = columns(pooled)
    names = [column.name for column in which]
    label = ["SIMULATED DATA in some rows: not a measurement"] if found["simulated"] else []
    write_parquet(out / TABLE, which, table, {f"version_{k}": v for k, v in found["versions"].items()})
    for name, text in (
        (TABLE_TEXT, csv_text([*label, "jaxgeo campaign"], names, ([row[n] for n in names] for row in table))),
        (SUMMARY, json_text(found)),
    ):
        with atomic_path(out / name) as temporary:
            temporary.write_text(text, encoding="utf-8", newline="\n")


class _Cluster:
    """Starts when it is first needed: a campaign that is done needs none."""

    def __init__(self, asked: CampaignAsked) -> None:
        self._asked = asked
        self._stack = contextlib.ExitStack()

    @functools.cached_property
    def _client(self) -> "Client":
        return self._stack.enter_context(campaign_client(self._asked.workers, self._asked.scheduler))

    def client(self) -> "Client":
        return self._client

    def __enter__(self) -> "_Cluster":
        return self

    def __exit__(self, *error: Any) -> None:
        self._stack.__exit__(*error)


def _say(said: Sequence[str]) -> None:
    for sentence in said:
        print(f"warning: {sentence}", file=sys.stderr)


def _report(asked: CampaignAsked, table: Sequence[dict[str, Any]], found: dict[str, Any]) -> None:
    """Failures on stderr, always; the rest where it is wanted."""
    failed = [row for row in table if row["status"] != "ok"]
    for row in failed[:SHOWN_FAILURES]:
        print(f"{row['status']}: {row['folder']}: {row['message']}", file=sys.stderr)
    if len(failed) > SHOWN_FAILURES:
        print(f".. and {len(failed) - SHOWN_FAILURES} more: see {asked.out / TABLE_TEXT}", file=sys.stderr)
    without = found.get("pooled", {}).get("n_without", 0)
    if without:
        _say([f"{without} trajectory(s) have no second pass: pooled_message in {asked.out / TABLE_TEXT} says why"])
    if asked.quiet:
        return
    gains = {"learned noise over the similarity": found["held_out"]["all"]["learned_over_coarse"]}
    if "pooled" in found:
        gains["pooled prior over learned alone"] = found["pooled"]["all"]["pooled_over_learned"]
    for words, each in gains.items():
        if each["ratio"] is not None:
            print(f"held-out error, {words}: {each['ratio']:.3f} (geometric mean of {each['n']} trajectories)")
    label = " (simulated data)" if found["simulated"] else ""
    good = found["status"].get("ok", 0)
    print(f"{good} of {found['n_sessions']} sessions{label}: {asked.out / TABLE}")
