"""placement.html: where the anchors go and what they promise, for a surveyor; one file, no network."""

import json
from collections.abc import Iterator

from eval.figures.placement_map import placement_map
from eval.placement.answer import PlacementAnswer
from eval.placement_report.map_spec import placement_map_figure
from eval.placement_report.profile_spec import profile_figure
from eval.placement_report.report import PlacementReport, count_of
from eval.placement_report.tables import anchors_table, counts_table, layouts_table, limits_table, what_if_table
from eval.placement_report.words import assumed_pairs, noise_pairs, verdict_words
from jaxgeo.export.interactive import interactive_scripts
from jaxgeo.export.json_text import json_ready
from jaxgeo.export.report_page import bullets, details, escape, facts, figure, page, paragraph
from jaxgeo.export.report_tables import flat_pairs
from jaxgeo.export.table import Table, html_text

WORDS = {
    "Anchor": "A marker with surveyed coordinates that the robot sees on its way: it ties the path to the grid there.",
    "Predicted accuracy": "One standard deviation of the position that a later run will report, worked out from the "
    "path, the odometry's noise, the survey and the sightings alone; nothing was measured. 'All axes' is the root of "
    "the sum of the three variances.",
    "95 % ellipse": "The region of the plan that should hold 95 of 100 errors.",
    "Equal spacing": "As many anchors at equal distances along the path: what one would do without a plan.",
    "Gradient search": "All anchors are moved at once, downhill in predicted error, from many starts.",
    "Best of all choices": "Every choice from a list of candidates was tried: those given, or places along the path.",
    "Greedy": "From a list of candidates, the best three, then one more at a time.",
    "Exchange": "From a list of candidates, one anchor after the other is exchanged for a better one, while it helps.",
}


def placement_html(report: PlacementReport) -> str:
    """The whole page."""
    body = [*head(report)]
    for answer in report.answers:
        body += answer_section(report, answer)
    body += [*assumptions(report), *glossary(), *run_section(report)]
    what = "predicted accuracy" if report.predicted else "where to put the anchors"
    title = f"{'SIMULATED: ' if report.simulated else ''}{report.name}: {what}"
    return page(title, body, interactive_scripts())


def head(report: PlacementReport) -> Iterator[str]:
    """Title, verdicts, warnings, numbers of anchors compared."""
    if report.simulated:
        yield '<div class="banner">SIMULATED DATA: the path or its noise was not measured</div>'
    what = "predicted accuracy of given anchors" if report.predicted else "where to put the anchors"
    yield f"<h1>{escape(report.name)}: {what}</h1>"
    yield paragraph("A prediction, made before anything is driven or surveyed.", "lead")
    for answer in report.answers:
        lines = "".join(paragraph(sentence) for sentence in verdict_words(report, answer))
        yield f'<div class="verdict good">{lines}</div>'
    if report.warnings:
        yield f'<div class="warnings"><strong>Warnings</strong>{bullets(report.warnings)}</div>'
    if len(report.answers) > 1:
        yield from titled_table(counts_table(report))


def answer_section(report: PlacementReport, answer: PlacementAnswer) -> Iterator[str]:
    """One number of anchors: map, profile, tables."""
    count = count_of(answer.chosen)
    yield "<h2>The anchors given</h2>" if report.predicted else f"<h2>{count} anchor{'s' * (count != 1)}</h2>"
    alt = "Map of the path coloured by predicted accuracy, with the anchors"
    caption = "Dark: accurate. Ellipses hold 95 of 100 errors. Thin lines lead to where the path passes an anchor."
    yield placement_map_figure(report, answer, figure(placement_map(report, answer).svg(), alt, caption))
    yield profile_figure(report, answer)
    yield from titled_table(anchors_table(report, answer))
    if len(answer.layouts) > 1:
        yield from titled_table(layouts_table(answer))
    yield from titled_table(what_if_table(report, answer))
    yield from titled_table(limits_table(answer))


def titled_table(table: Table) -> Iterator[str]:
    yield f"<h3>{escape(table.title)}</h3>"
    yield html_text(table, titled=False)


def assumptions(report: PlacementReport) -> Iterator[str]:
    yield "<h2>What this rests on</h2>"
    yield facts("", assumed_pairs(report))
    yield facts("Odometry noise, median, as what it makes of 100 m", noise_pairs(report))


def glossary() -> Iterator[str]:
    yield "<h2>Words used</h2>"
    yield "<dl>" + "".join(f"<dt>{escape(k)}</dt><dd>{escape(v)}</dd>" for k, v in WORDS.items()) + "</dl>"


def run_section(report: PlacementReport) -> Iterator[str]:
    """Versions, inputs and the config, so that the plan can be made again."""
    yield "<h2>This run</h2>"
    yield facts("Versions, inputs, seed and times", flat_pairs(report.run))
    config = json.dumps(json_ready(report.config), indent=2, ensure_ascii=False)
    yield details("The configuration, resolved", f"<pre>{escape(config)}</pre>")
