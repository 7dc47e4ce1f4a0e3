"""Parts of a self-contained HTML page: its frame, sections, tables, and figures with their legends."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from importlib import metadata
from typing import Any, TypeAlias

from schuler.exceptions import MissingExtraError
from schuler.plotting import page
from schuler.plotting.figure import Figure
from schuler.plotting.interactive import css_name, panel_data
from schuler.plotting.style import style

#: HTML, already escaped, or a figure to draw there.
Block: TypeAlias = str | Figure

_GLYPHS = {"dot": "●", "cross": "×", "triangle": "▲", "ring": "○", "square": "■"}
_UNREPEATABLE = ("elapsed_s",)  # of a provenance: differs from run to run


@dataclass(frozen=True, eq=False)
class Section:
    """A part of the page with a heading and a link to it; empty blocks are left out, and a section without any too.

    Attributes
    ----------
    name : str
        Of the link: letters, digits, underscores.
    title : str
    blocks : tuple of str or Figure
        In the order in which they stand.
    """

    name: str
    title: str
    blocks: tuple[Block, ...]


def plotly_script() -> str:
    """The drawing library, to be put into the page.

    Raises
    ------
    MissingExtraError
        If plotly is not installed (extra ``report``).
    """
    try:
        from plotly.offline import get_plotlyjs
    except ImportError:
        raise MissingExtraError("plotly", "report", "the HTML report") from None
    source: str = get_plotlyjs()
    return source


def whole_page(
    title: str,
    kind: str,
    subtitle: str,
    sentences: Sequence[str],
    conventions: str,
    sections: Sequence[Section],
    script: str,
    contents: frozenset[str] | None = None,
) -> str:
    """A complete page.

    Parameters
    ----------
    title, kind : str
        Heading; the window is called ``title: kind``.
    subtitle : str
        Under the heading.
    sentences : sequence of str
        The verdict, before everything else.
    conventions : str
        Units, signs and frames that hold for all of the page.
    sections : sequence of Section
    script : str
        The drawing library, see :func:`plotly_script`.
    contents : frozenset of str, optional
        Names of the sections that are linked at the top; all by default.

    Returns
    -------
    str
        HTML that loads nothing from anywhere; the same text for the same arguments.
    """
    filled = [(s, [b for b in s.blocks if b]) for s in sections]
    filled = [(s, blocks) for s, blocks in filled if blocks]
    linked = [s for s, _ in filled if contents is None or s.name in contents]
    links = "".join(f'<a href="#{s.name}">{escape(s.title)}</a>' for s in linked)
    body = "\n".join(
        f'<section id="{s.name}">\n<h2>{escape(s.title)}</h2>\n'
        + "\n".join(figure_html(block) if isinstance(block, Figure) else block for block in blocks)
        + "\n</section>"
        for s, blocks in filled
    )
    figures = [block for _, blocks in filled for block in blocks if isinstance(block, Figure)]
    data = {f.name: [panel_data(f, p) for p in f.panels] for f in figures}
    # "</" would end the script element, and is the same string with the stroke escaped
    packed = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("</", "<\\/")
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{page.POLICY}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="generator" content="schuler {escape(metadata.version("schuler"))}">
<title>{escape(title)}: {escape(kind)}</title>
<link rel="icon" href="data:,">
<style>
{page.style_sheet()}
</style>
</head>
<body>
<header>
<h1>{escape(title)}</h1>
<p class="sub">{escape(subtitle)}</p>
</header>
<main>
<section id="verdict" class="verdict" aria-label="Verdict">
{"".join(f"<p>{escape(s)}</p>" for s in sentences)}
</section>
<noscript><p>The figures of this page are drawn by JavaScript, which is switched off here; the tables are
complete.</p></noscript>
<nav aria-label="Contents">{links}</nav>
<p class="small">{escape(conventions)}</p>
{body}
</main>
<script type="application/json" id="figures">{packed}</script>
<script>window.PlotlyConfig = {{MathJaxConfig: "local"}};</script>
<script>{script}</script>
<script>{page.SCRIPT}</script>
</body>
</html>
"""


def figure_html(figure: Figure) -> str:
    """Title, legend, empty panels that the script fills, and caption."""
    title_id = f"title-{figure.name}"
    panels = []
    for k, panel in enumerate(figure.panels):
        label = f"{figure.title}: {panel.y_label} against {panel.x_label}. {panel.title}".strip()
        size = "plan" if panel.equal else "tall" if len(figure.panels) == 1 or figure.columns == 2 else ""
        says = f'<p class="says">{escape(panel.title)}</p>' if panel.title else ""
        linked = ' data-linked="yes"' if figure.linked and len(figure.panels) > 1 else ""
        high = (
            f' data-height="{panel.height:g}" style="height: {190.0 * panel.height:.0f}px"'
            if panel.height != 1.0
            else ""
        )
        panels.append(
            f'<div>{says}<div class="plot {size}" role="img" aria-label="{escape(label)}" '
            f'data-figure="{escape(figure.name)}" data-panel="{k}"{linked}{high}></div></div>'
        )
    return (
        f'<figure aria-labelledby="{title_id}">\n<h3 id="{title_id}">{escape(figure.title)}</h3>\n{_keys(figure)}\n'
        f'<div class="panels c{figure.columns}">\n' + "\n".join(panels) + "\n</div>\n"
        f"<figcaption>{escape(figure.caption)}</figcaption>\n</figure>"
    )


def table(
    caption: str,
    heads: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    numbers: bool = True,
    explained: Sequence[str] = (),
) -> str:
    """A table whose first column names the row.

    Parameters
    ----------
    caption : str
    heads : sequence of str
        Of the columns.
    rows : sequence of sequence of str
        What follows a line break in a cell is in small letters.
    numbers : bool
        The other columns are numbers, set to the right.
    explained : sequence of str
        A sentence under each row, across the whole table.
    """
    cell = ' class="n"' if numbers else ""
    head = f'<th scope="col">{escape(heads[0])}</th>' + "".join(
        f'<th scope="col"{cell}>{escape(h)}</th>' for h in heads[1:]
    )
    lines = []
    for row, text in zip(rows, explained or [""] * len(rows), strict=True):
        cells = "".join(f"<td{cell}>{_cell(v)}</td>" for v in row[1:])
        told = ' class="told"' if text else ""
        lines.append(f'<tr{told}><th scope="row">{escape(row[0])}</th>{cells}</tr>')
        if text:
            lines.append(f'<tr><td class="small" colspan="{len(heads)}">{escape(text)}</td></tr>')
    body = "\n".join(lines)
    kind = "" if numbers else ' class="texts"'
    return (
        f"<table{kind}>\n<caption>{escape(caption)}</caption>\n<thead><tr>{head}</tr></thead>\n"
        f"<tbody>\n{body}\n</tbody>\n</table>"
    )


def bullets(sentences: Sequence[str]) -> str:
    """A list of notes."""
    return '<ul class="notes">' + "".join(f"<li>{escape(s)}</li>" for s in sentences) + "</ul>"


def folded(summary: str, html: str) -> str:
    """Something that is opened by a click on its summary."""
    return f"<details><summary>{escape(summary)}</summary>\n{html}\n</details>"


def notes(sentences: Sequence[str]) -> str:
    """The notes of a result, or that there are none."""
    if not sentences:
        return "<p>Nothing was assumed, repaired or left out beyond the options below.</p>"
    return f"<p>What was assumed, repaired or left out.</p>\n{bullets(sentences)}"


def provenance_rows(provenance: dict[str, Any]) -> list[tuple[str, str]]:
    """Path and text of everything a result says it was made from, but for what differs from run to run."""
    rows = [(k, v) for k, v in _flat(provenance) if k.rsplit(".", 1)[-1] not in _UNREPEATABLE]
    if "schuler" not in provenance:
        rows.insert(0, ("schuler", metadata.version("schuler")))
    return rows


def _cell(text: str) -> str:
    first, _, second = text.partition("\n")
    return f'{escape(first)}<br><span class="small">{escape(second)}</span>' if second else escape(first)


def _keys(figure: Figure) -> str:
    """The legend: a button for everything that can be hidden."""
    entries = []
    for label, (kind, role) in figure.legend().items():
        look = style(role)
        area = kind in ("band", "bars", "span") or (kind == "line" and look.alpha < 1.0)
        if area:
            name = css_name(role, area=kind != "bars")
            swatch = f'<i class="box" style="background: var({name})"></i>'
        elif kind == "line":
            swatch = f'<i class="{"dash" if look.dash else "line"}" style="color: var({css_name(role)})"></i>'
        else:
            swatch = f'<i style="color: var({css_name(role)})">{_GLYPHS[look.symbol]}</i>'
        if kind == "span":
            entries.append(f'<li><span class="key">{swatch}{escape(label)}</span></li>')
        else:
            entries.append(
                f'<li><button type="button" aria-pressed="true" data-figure="{escape(figure.name)}" '
                f'data-name="{escape(label)}">{swatch}{escape(label)}</button></li>'
            )
    return f'<ul class="keys" aria-label="Legend">{"".join(entries)}</ul>' if entries else ""


def _flat(value: Any, key: str = "") -> Iterator[tuple[str, str]]:
    """Rows of nested options: path and text."""
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _flat(inner, f"{key}.{name}" if key else str(name))
    elif isinstance(value, list | tuple):
        yield key, ", ".join(str(v) for v in value) or "none"
    else:
        yield key, str(value)
