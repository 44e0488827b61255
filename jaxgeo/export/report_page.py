"""The pieces of an HTML page that needs no network: escaped text, tables, figures as data URIs, one style sheet."""

import base64
import hashlib
import html
from collections.abc import Iterable, Sequence

STYLE = """
:root { color: #1a1a1a; background: #fff; font: 15px/1.5 system-ui, "Segoe UI", "DejaVu Sans", Arial, sans-serif; }
body { max-width: 1040px; margin: 0 auto; padding: 1.2rem 1.2rem 4rem; }
h1 { font-size: 1.7rem; margin: .3rem 0; }
h2 { font-size: 1.3rem; margin: 2.4rem 0 .4rem; border-bottom: 2px solid #1a1a1a; }
h3 { font-size: 1.05rem; margin: 1.6rem 0 .3rem; } p { max-width: 90ch; margin: .4rem 0 .8rem; }
.lead { color: #444; } .note { color: #444; font-size: .9rem; }
.banner { background: #7a0000; color: #fff; font-weight: 700; text-align: center; padding: .6rem; }
.verdict { border-left: 6px solid; padding: .5rem .9rem; margin: .8rem 0; background: #f5f7f9; }
.verdict p { margin: .2rem 0; } .verdict .name { font-weight: 700; }
.good { border-color: #009e73; } .caution { border-color: #e69f00; }
.bad { border-color: #b00020; background: #fdf1f2; }
.warnings { border: 1px solid #e69f00; background: #fff8e8; padding: .5rem .9rem; } .warnings ul { margin: .2rem 0; }
.small { border-left: 6px solid #e69f00; background: #fff8e8; padding: .5rem .9rem; margin: .8rem 0; }
.small p { margin: .2rem 0; }
.either .interactive { display: none; } .either.drawn .interactive { display: block; }
.either.drawn .static { display: none; }
.tools { font-size: .88rem; margin: .3rem 0; } .tools input { vertical-align: middle; width: 11rem; max-width: 40vw; }
.tools button { font: inherit; padding: .1rem .7rem; border: 1px solid #888; border-radius: 4px; background: #fff; }
.tools button[aria-pressed="true"] { background: #0072b2; border-color: #0072b2; color: #fff; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; margin: .5rem 0 .9rem; font-size: .84rem; }
caption { text-align: left; white-space: nowrap; color: #444; padding-bottom: .3rem; }
th, td { padding: .18rem .45rem; border-bottom: 1px solid #ddd; white-space: nowrap; }
thead th { border-bottom: 1px solid #888; text-align: right; vertical-align: bottom; font-weight: 600; }
thead th.group { text-align: center; } tbody td { text-align: right; font-variant-numeric: tabular-nums; }
td.text, th.text { text-align: left; } td.wrap { white-space: normal; word-break: break-word; }
.edge { border-left: 1px solid #bbb; } tfoot td { border-top: 1px solid #888; font-weight: 600; text-align: right; }
tfoot td.text { text-align: left; }
figure { margin: .8rem 0 1.2rem; } figure img { width: 100%; height: auto; }
figcaption { color: #444; font-size: .9rem; max-width: 110ch; }
pre { background: #f5f7f9; padding: .7rem; overflow-x: auto; font-size: .8rem; } dt { font-weight: 600; }
dd { margin: 0 0 .4rem 1.2rem; max-width: 78ch; }
@media print { body { max-width: none; padding: 0; font-size: 10pt; } figure, .verdict { break-inside: avoid; }
  table { font-size: 7pt; } h2 { break-after: avoid; } details:not([open]) { display: none; }
  .either.drawn .interactive { display: none; } .either.drawn .static { display: block; } }
@media (max-width: 600px) { body { padding: .6rem .6rem 3rem; } caption { white-space: normal; } }
"""


def escape(text: object) -> str:
    """Text that is safe in HTML content and in quoted attributes."""
    return html.escape(str(text), quote=True)


def page(title: str, body: Iterable[str], scripts: Sequence[str] = ()) -> str:
    """The whole document. The policy in its head forbids a browser to fetch anything.

    `scripts`: JavaScript that is run once the body is there. The policy names them by their hash, so that nothing
    else in the page, a user's text least of all, can run.
    """
    run = " ".join(f"'sha256-{base64.b64encode(hashlib.sha256(s.encode()).digest()).decode()}'" for s in scripts)
    policy = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
    if scripts:
        policy = f"default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; script-src {run}"
    return "\n".join(
        [
            '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{policy}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>",
            *body,
            *(f"<script>{script}</script>" for script in scripts),
            "</body>\n</html>\n",
        ]
    )


def paragraph(text: str, kind: str = "") -> str:
    return f'<p class="{kind}">{escape(text)}</p>' if kind else f"<p>{escape(text)}</p>"


def bullets(lines: Iterable[str]) -> str:
    return "<ul>" + "".join(f"<li>{escape(line)}</li>" for line in lines) + "</ul>"


def figure(svg: bytes, alt: str, caption: str, width: float = 1.0) -> str:
    """An SVG as an image of its own: nothing in it can reach the page, or be reached from it.

    `width`: share of the page's; narrow figures look swollen on all of it.
    """
    data = base64.b64encode(svg).decode("ascii")
    style = f' style="width:{100 * width:.0f}%"' if width < 1.0 else ""
    return (
        f'<figure><img alt="{escape(alt)}"{style} src="data:image/svg+xml;base64,{data}">'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


def table(
    caption: str,
    columns: Sequence[str],
    rows: Iterable[Sequence[str]],
    *,
    groups: Sequence[tuple[str, int]] = (),
    footer: Iterable[Sequence[str]] = (),
    text_columns: Sequence[int] = (0,),
    wrap_columns: Sequence[int] = (),
) -> str:
    """A table of escaped texts; without a caption where that is empty.

    `groups` (title, columns spanned) make a second header row above.
    """
    starts, at = set(), 0
    for _, span in groups:
        starts.add(at)
        at += span
    starts.discard(0)

    def kind(i: int) -> str:
        words = ["text"] * (i in text_columns) + ["edge"] * (i in starts) + ["wrap"] * (i in wrap_columns)
        return f' class="{" ".join(words)}"' if words else ""

    def row(cells: Sequence[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}{kind(i)}>{escape(c)}</{tag}>" for i, c in enumerate(cells)) + "</tr>"

    upper = "".join(
        f'<th class="group{" edge" if i else ""}" colspan="{span}">{escape(title)}</th>'
        for i, (title, span) in enumerate(groups)
    )
    parts = [
        '<div class="scroll"><table>',
        f"<caption>{escape(caption)}</caption>" if caption else "",
        "<thead>",
        f"<tr>{upper}</tr>" if groups else "",
        row(columns, "th") if columns else "",
        "</thead><tbody>",
        *(row(cells, "td") for cells in rows),
        "</tbody>",
    ]
    foot = [row(cells, "td") for cells in footer]
    if foot:
        parts += ["<tfoot>", *foot, "</tfoot>"]
    return "".join([*parts, "</table></div>"])


def facts(caption: str, pairs: Iterable[tuple[str, str]]) -> str:
    """A two-column table of names and values."""
    return table(caption, (), pairs, text_columns=(0, 1), wrap_columns=(1,))


def details(summary: str, inner: str) -> str:
    """A part that opens on a click."""
    return f"<details><summary>{escape(summary)}</summary>{inner}</details>"
