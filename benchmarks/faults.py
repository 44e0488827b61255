"""Faults put to the commands, and what each gave: `python -m benchmarks.faults [--json|--markdown] [--only NAME]`.

Every row is a real run of the command line in a temporary folder. Computed of each: the exit code; one message that
names the place; nothing changed outside of the outputs; nothing half-written in them; the same command, once the fault
is gone, ends well and gives the results that it gives without. What is done is said in docs/faults.md.
"""

import concurrent.futures
import dataclasses
import functools
import json
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence

import typer

from benchmarks.fault_case import Row, attempt
from benchmarks.fault_page import page

KINDS = {
    "kills": "Killed, terminated, interrupted",
    "places": "Full disks, places for outputs, environments",
    "configs": "Configs and learned noise",
    "recordings": "Images, bags, archives, databases",
    "files": "Files that are none, or far too large",
}


def rows_asked(kinds: Sequence[str], only: str, quick: bool) -> Iterator[tuple[str, str, Callable[[], Row]]]:
    """(kind, name, what makes the row) of every fault of some kinds whose name has `only` in it."""
    from benchmarks.fault_configs import config_cases
    from benchmarks.fault_files import file_cases
    from benchmarks.fault_kills import kills
    from benchmarks.fault_places import place_cases
    from benchmarks.fault_recordings import recording_cases

    if "kills" in kinds:
        yield from (("kills", kill.name, kill.row) for kill in kills(quick) if only in kill.name)
    cases = {"places": place_cases, "configs": config_cases, "recordings": recording_cases, "files": file_cases}
    for kind in kinds:
        for case in cases[kind]() if kind in cases else ():
            if only in case.name:
                yield kind, case.name, functools.partial(attempt, case, not quick)


def main(
    as_json: bool = typer.Option(False, "--json", help="One JSON object."),
    markdown: bool = typer.Option(False, "--markdown", help="The page docs/faults.md."),
    only: str = typer.Option("", help="Faults whose name has this in it."),
    kinds: str = typer.Option(",".join(KINDS), help="Some of these, separated by commas."),
    quick: bool = typer.Option(False, "--quick", help="Fewer kills, and no second run where nothing was killed."),
    jobs: int = typer.Option(2, min=1, help="Commands at once."),
) -> None:
    started = time.perf_counter()
    chosen = kinds.split(",")
    if unknown := [kind for kind in chosen if kind not in KINDS]:
        raise typer.BadParameter(f"{unknown[0]!r}; expected some of {', '.join(KINDS)}.", param_hint="--kinds")
    asked = list(rows_asked(chosen, only, quick))
    rows: list[tuple[str, Row]] = []
    with concurrent.futures.ThreadPoolExecutor(jobs) as pool:
        for (kind, name, _), row in zip(asked, pool.map(lambda each: each[2](), asked), strict=True):
            rows.append((kind, row))
            print(f"{len(rows)}/{len(asked)} {'ok' if not row.problems else 'WRONG'} {name}", file=sys.stderr)
            for problem in row.problems:
                print(f"    {problem}", file=sys.stderr)
    wrong = [row.name for _, row in rows if row.problems]
    seconds = time.perf_counter() - started
    if as_json:
        found = {"faults": len(rows), "faults_wrong": len(wrong), "seconds": seconds, "load": os.getloadavg()}
        print(json.dumps(found | {"rows": [{"kind": kind} | dataclasses.asdict(row) for kind, row in rows]}))
    elif markdown:
        cores, load = os.cpu_count(), os.getloadavg()[2]
        print(page(rows, KINDS, f"{seconds:.0f} s, {jobs} at once, on {cores} cores under a load of {load:.0f}."))
    else:
        print(_text(rows))
        print(f"\n{len(rows)} faults, {len(wrong)} wrong, {seconds:.0f} s")
    raise typer.Exit(1 if wrong else 0)


def _text(rows: Sequence[tuple[str, Row]]) -> str:
    return "\n".join(
        f"{'ok' if not r.problems else 'WRONG':<6}{r.name:<34} {r.code:<8} {r.seconds:5.1f} s {r.rss_mb:5.0f} MB  "
        f"{r.message[:90]} | {r.outside} | {r.half} | {r.after}"
        for _, r in rows
    )


if __name__ == "__main__":
    typer.run(main)
