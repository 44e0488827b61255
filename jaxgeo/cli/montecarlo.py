"""`jaxgeo study montecarlo`: many simulated sessions, held out and learned from, in one resumable run."""

import dataclasses
import sys
from pathlib import Path

from jaxgeo.cli.montecarlo_bar import SessionBar
from jaxgeo.cli.run import keep_compiled_programs
from jaxgeo.export.json_text import json_text
from jaxgeo.export.table import csv_text, write_tables
from jaxgeo.io.atomic import atomic_path, check_output_folder


@dataclasses.dataclass(frozen=True)
class Asked:
    """The command's options; None: by the machine."""

    out: Path
    draws: int
    seed: int
    regimes: str
    poses: int
    chunk: int | None
    devices: int | None
    batch: int | None
    workers: int | None
    quiet: bool


def study_montecarlo(asked: Asked) -> None:
    """Run the study, or what is missing of it, and write its tables.

    Raises:
        InputError: an unknown regime, a folder that holds another study or cannot be written to.
    """
    check_output_folder(asked.out)

    # First of all, and before the modules that make arrays as they are imported: it says how many devices there are.
    from eval.montecarlo.devices import cores, study_devices

    devices = study_devices(asked.devices)

    from eval.montecarlo.batch import session_mesh
    from eval.montecarlo.chunks import CHUNK_FOLDER, open_folder
    from eval.montecarlo.regimes import regimes_named
    from eval.montecarlo.settings import study_settings
    from eval.montecarlo.study import run_study

    settings = study_settings(
        asked.draws,
        asked.seed,
        regimes_named(asked.regimes),
        platform=devices[0].platform,
        poses=asked.poses,
        chunk=asked.chunk,
        batch=asked.batch,
    )
    open_folder(asked.out, settings)
    keep_compiled_programs()
    workers = max(1, cores() // 2) if asked.workers is None else asked.workers
    n_chunks = len(settings.chunks())
    with SessionBar(settings.draws, f"{len(devices)} x {devices[0].device_kind}", asked.quiet) as bar:
        try:
            records = run_study(settings, asked.out, session_mesh(devices), workers, bar.begin, bar.done, bar.warn)
        except BaseException:
            kept = len(list((asked.out / CHUNK_FOLDER).glob("[0-9]*.npz")))
            print(
                f"stopped: {kept} of {n_chunks} chunks are in {asked.out / CHUNK_FOLDER}; the same command goes on "
                "from there",
                file=sys.stderr,
            )
            raise
    write_results(asked.out, records, settings)
    if not asked.quiet:
        print(f"{settings.draws} simulated sessions: {asked.out / 'summary.md'}")


def write_results(out: Path, records, settings) -> None:
    """`sessions.csv`, the tables in every format, `summary.json` and the figures."""
    from eval.figures.calibration_ratio import calibration_ratio
    from eval.figures.picture import write_pictures
    from eval.montecarlo.summary import WHITE, regime_rows, sigma_ratio, summary_dict
    from eval.montecarlo.tables import sessions_table, study_tables

    rows = regime_rows(records, settings)
    good = records.take(~records.failed)
    write_tables(out, study_tables(rows))
    write_pictures(
        out,
        {
            f"ratio_{name.split('_')[0]}": calibration_ratio(
                {r.name: sigma_ratio(good.take(good.regime == i), name) for i, r in enumerate(settings.regimes)},
                f"Learned over true {words}",
            )
            for name, words in zip(WHITE, ("white position noise", "white direction noise"), strict=True)
        },
    )
    for name, text in (
        ("sessions.csv", csv_text(sessions_table(records, settings))),
        ("summary.json", json_text(summary_dict(rows, records, settings))),
    ):
        with atomic_path(out / name) as temporary:
            temporary.write_text(text, encoding="utf-8", newline="\n")
