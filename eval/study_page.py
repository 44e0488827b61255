"""One page about several sessions: verdicts, all tables and figures, then every trajectory in full; no network."""

import dataclasses
from collections.abc import Iterator, Sequence

from eval.figures import Picture
from jaxgeo.export.figure_style import WIDTH_IN
from jaxgeo.export.interactive import interactive_scripts
from jaxgeo.export.report import glossary, interactive, method, summary
from jaxgeo.export.report_page import escape, facts, figure, page, paragraph
from jaxgeo.export.report_tables import flat_pairs
from jaxgeo.export.result import SessionResult
from jaxgeo.export.table import Table, html_text
from jaxgeo.export.trajectory_section import trajectory_section


@dataclasses.dataclass(frozen=True)
class StudyFigure:
    """A figure of a study.

    Attributes:
        name: of its files.
        table: name of the table that it stands behind.
        picture: drawn; `alt` what it shows, `caption` how to read it.
        on_page: False where the page has the same already, trajectory by trajectory.
    """

    name: str
    table: str
    picture: Picture
    alt: str
    caption: str
    on_page: bool = True


def study_page(
    title: str,
    lead: Sequence[str],
    sessions: Sequence[SessionResult],
    tables: Sequence[Table],
    figures: Sequence[StudyFigure],
    made_with: dict,
) -> str:
    """The page as HTML. `lead`: what was studied, in sentences; `made_with`: seeds and versions."""
    simulated = any(result.simulated for result in sessions)
    drawn = all(interactive(result) for result in sessions)
    body: list[str] = []
    if simulated:
        body.append('<div class="banner">SIMULATED DATA: nothing in this report was measured</div>')
    body.append(f"<h1>{escape(title)}</h1>")
    body += [paragraph(sentence, "lead") for sentence in lead]
    body.append(contents(sessions, tables))
    for result in sessions:
        body.append(f'<h2 id="session-{escape(result.name)}">Session {escape(result.name)} in short</h2>')
        body += summary(result)
    body += study_sections(tables, figures)
    for result in sessions:
        body.append(f"<h2>Session {escape(result.name)} in full</h2>")
        body += [part.replace("<h2>", "<h3>").replace("</h2>", "</h3>") for part in method(result)]
        for trajectory in result.trajectories.values():
            heading, *rest = trajectory_section(result, trajectory, interactive=drawn)
            body += [heading.replace("<h2>", f"<h2>Session {escape(result.name)}: "), *rest]
    body += [*glossary(), "<h2>This run</h2>", facts("Versions and seeds", flat_pairs(made_with))]
    heading = f"{'SIMULATED: ' if simulated else ''}{title}"
    return page(heading, body, interactive_scripts() if drawn else ())


def study_sections(tables: Sequence[Table], figures: Sequence[StudyFigure]) -> Iterator[str]:
    """Every table, and behind it its figures."""
    for table in tables:
        yield f'<h2 id="table-{escape(table.name)}">{escape(table.title)}</h2>'
        yield html_text(table, titled=False)
        for each in figures:
            if each.table == table.name and each.on_page:
                width = min(each.picture.figure.get_figwidth() / WIDTH_IN, 1.0)
                yield figure(each.picture.svg(), each.alt, each.caption, width)


def contents(sessions: Sequence[SessionResult], tables: Sequence[Table]) -> str:
    """Where to find what."""
    links = [f'<a href="#session-{escape(r.name)}">Session {escape(r.name)} in short</a>' for r in sessions]
    links += [f'<a href="#table-{escape(t.name)}">{escape(t.title)}</a>' for t in tables]
    return "<ul>" + "".join(f"<li>{link}</li>" for link in links) + "</ul>"
