"""`jaxgeo evaluate`: the study's tables and figures for recordings of one's own, one session or several together."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from jaxgeo.cli.progress import Progress
from jaxgeo.cli.run import keep_compiled_programs
from jaxgeo.config import load_config
from jaxgeo.config.schema import SessionConfig
from jaxgeo.errors import ConfigError
from jaxgeo.io.atomic import check_output_folder, output_folder

if TYPE_CHECKING:
    from jaxgeo.export.result import SessionResult


def evaluate_configs(paths: Sequence[Path], out: Path | None, overrides: Sequence[str], quiet: bool) -> None:
    """Run and evaluate sessions; write each session's own files, the tables and figures of all, and one report.

    One session's files lie in `out`; those of several in a folder each. Nothing is written unless all of it is.

    Raises:
        JaxgeoError: bad input, or an estimate that is not to be had.
    """
    configs = distinct([load_config(path, overrides) for path in paths], paths)
    out = (Path("out") / ("evaluate" if len(configs) > 1 else configs[0].name)) if out is None else out
    check_output_folder(out)

    from eval.study_figures import study_figures
    from eval.study_files import put_files, study_files
    from eval.study_page import study_page, study_sections
    from eval.tables.cost import cost_table
    from eval.tables.study import study_tables
    from jaxgeo.cli.evaluated import evaluate_session
    from jaxgeo.cli.machine import device_words
    from jaxgeo.export.report import report_html
    from jaxgeo.export.session_files import write_session
    from jaxgeo.precision import let_programs_go

    keep_compiled_programs()
    with Progress(quiet) as progress:
        sessions = []
        for config in configs:
            own = out if len(configs) == 1 else out / config.name
            sessions.append(evaluate_session(config, progress, out=own))
            let_programs_go()
        progress.phase("tables and figures")
        evaluations = [e for session in sessions for e in session.evaluations]
        tables = study_tables(
            evaluations,
            {s.result.name: s.result.frame.origin_enh_m for s in sessions},
            {(s.config.name, name): noise for s in sessions for name, noise in s.fixed.items()},
        )
        cost = cost_table(evaluations, device_words())
        tables = (*tables, *(() if cost is None else (cost,)))
        results = [session.result for session in sessions]
        figures = study_figures(results, evaluations)
        files = study_files(tables, figures)
        with output_folder(out) as temporary:
            if len(sessions) == 1:
                report = report_html(results[0], [*study_sections(tables, figures)])
                write_session(results[0], temporary)
            else:
                for result in results:
                    write_session(result, temporary / result.name)
                versions = results[0].run["versions"]
                seeds = {c.name: c.seed for c in configs}
                report = study_page(
                    f"{len(sessions)} sessions: held-out evaluation",
                    [f"Sessions {', '.join(c.name for c in configs)}, each georeferenced and judged on its own."],
                    results,
                    tables,
                    figures,
                    {"versions": versions, "seed": seeds},
                )
            put_files(temporary, files | {"report.html": report})
    if not quiet:
        say_warnings(results)
        print(f"{out / 'report.html'}")


def say_warnings(results: "Sequence[SessionResult]") -> None:
    """All of them on stderr, with session and trajectory."""
    for result in results:
        for name, trajectory in result.trajectories.items():
            for warning in trajectory.warnings:
                print(f"warning: {result.name}: {name}: {warning}", file=sys.stderr)


def distinct(configs: list[SessionConfig], paths: Sequence[Path]) -> list[SessionConfig]:
    """The configs, once no two have one name.

    Raises:
        ConfigError: names both files.
    """
    seen: dict[str, Path] = {}
    for config, path in zip(configs, paths, strict=True):
        if config.name in seen:
            raise ConfigError(
                f"{path}: name {config.name!r} is that of {seen[config.name]} too, and tables tell sessions apart by "
                "their names: give one of them another."
            )
        seen[config.name] = path
        if not config.evaluate.leave_one_out:
            raise ConfigError(
                f"{path}: evaluate.leave_one_out is false, so there is nothing to evaluate: remove it, or use "
                "'jaxgeo run'."
            )
    return configs
