"""`jaxgeo study placement`: the reference study's findings on anchors, predicted and achieved on simulated sessions."""

import dataclasses
import platform
import time
from importlib.metadata import version
from pathlib import Path

from eval.montecarlo.regimes import regimes_named
from eval.placement.findings import findings
from eval.tables.placement_findings import findings_tables, findings_words
from jaxgeo.cli.printed_table import print_table
from jaxgeo.cli.progress import Progress
from jaxgeo.cli.run import keep_compiled_programs
from jaxgeo.export.json_text import json_text
from jaxgeo.export.table import table_files
from jaxgeo.io.atomic import check_output_folder, output_folder
from jaxgeo.simulate import UAV, UGV, Layout

LAYOUTS = (UAV, UGV)


def study_placement(
    out: Path, sessions: int, seed: int, regimes: str, quiet: bool, layouts: tuple[Layout, ...] = LAYOUTS
) -> None:
    """Simulate, predict, correct, compare; `findings.json` and the tables go to `out`, all or nothing.

    Raises:
        InputError: an unknown regime, or a folder that cannot be written to.
    """
    started = time.perf_counter()
    asked = regimes_named(regimes)
    check_output_folder(out)
    keep_compiled_programs()
    with Progress(quiet) as progress, output_folder(out) as temporary:
        found = []
        for layout in layouts:
            for regime in asked:
                progress.phase("simulate and correct", f"{layout.name}, {regime.name}")
                found.append(findings(regime, layout, sessions, seed))
        tables, words = findings_tables(found), list(findings_words(found))
        facts = {
            "simulated": True,
            "sessions": sessions,
            "seed": seed,
            "versions": {"jaxgeo": version("jaxgeo"), "python": platform.python_version()},
            "seconds": time.perf_counter() - started,
            "words": words,
            "findings": [dataclasses.asdict(each) | {"ratio_predicted": each.ratio_predicted} for each in found],
        }
        (temporary / "findings.json").write_text(json_text(facts), encoding="utf-8")
        for name, text in table_files(tables).items():
            (temporary / name).write_text(text, encoding="utf-8")
    if not quiet:
        for table in tables:
            print_table(table)
        print("\n".join(words))
        print(f"study placement (simulated data): {out}")
