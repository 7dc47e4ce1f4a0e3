"""Parts of an HTML page: figures with their legends, tables, lists, folded text, provenance."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape
from typing import Any

import numpy as np

from schuler.files import package_version
from schuler.plotting.figure import TIME, Figure, Line
from schuler.plotting.interactive import css_name
from schuler.plotting.style import style

_GLYPHS = {"dot": "●", "cross": "×", "triangle": "▲", "ring": "○", "square": "■"}
_UNREPEATABLE = ("elapsed_s",)  # of a provenance: differs from run to run


def figure_html(figure: Figure) -> str:
    """Title, legend, empty panels that the script fills, and caption."""
    title_id = f"title-{figure.name}"
    keys = _keys(figure) + _menu(figure)
    panels = []
    for k, panel in enumerate(figure.panels):
        label = f"{figure.title}: {panel.y_label} against {panel.x_label}. {panel.title}".strip()
        size = "plan" if panel.equal else "tall" if len(figure.panels) == 1 or figure.columns == 2 else ""
        says = f'<p class="says">{escape(panel.title)}</p>' if panel.title else ""
        linked = ' data-linked="yes"' if figure.linked and len(figure.panels) > 1 else ""
        if panel.x_label == TIME and figure.linked:
            linked = ' data-time="yes"'
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
        f'<figure aria-labelledby="{title_id}">\n<h3 id="{title_id}">{escape(figure.title)}</h3>\n{keys}\n'
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
        Heads of the columns.
    rows : sequence of sequence of str
        Cells; text after a line break in a cell is in small letters.
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
        joined = ' class="told"' if text else ""
        lines.append(f'<tr{joined}><th scope="row">{escape(row[0])}</th>{cells}</tr>')
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


def number(value: float | None, unit: str = "") -> str:
    """Three significant digits without exponents, with the unit; a dash for what is not known."""
    if value is None or not np.isfinite(value):
        return "-"
    size = abs(value)
    digits = 0 if size >= 100.0 else 1 if size >= 10.0 else 2 if size >= 1.0 else 3
    text = f"{value:.{digits}f}" if size >= 1e-3 or value == 0.0 else f"{value:.2g}"
    return f"{text} {unit}".strip()


def provenance_rows(provenance: dict[str, Any]) -> list[tuple[str, str]]:
    """Path and text of everything a result says it was made from, but for what differs from run to run."""
    rows = [(k, v) for k, v in _flat(provenance) if k.rsplit(".", 1)[-1] not in _UNREPEATABLE]
    if "schuler" not in provenance:
        rows.insert(0, ("schuler", package_version()))
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


def _menu(figure: Figure) -> str:
    """A choice of what colours the curves that know more than their coordinates; empty without such curves."""
    names = [
        [name for name, _ in item.along] for panel in figure.panels for item in panel.items
        if isinstance(item, Line) and len(item.along) > 1
    ]  # fmt: skip
    if not names:
        return ""
    options = "".join(f'<option value="{k}">{escape(name)}</option>' for k, name in enumerate(names[0]) if k > 0)
    return (
        f'<p class="menu"><label>colour by <select data-figure="{escape(figure.name)}"><option value="">solution'
        f'</option>{options}</select></label> <span class="scale"></span></p>'
    )


def _flat(value: Any, key: str = "") -> Iterator[tuple[str, str]]:
    """Rows of nested options: path and text."""
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _flat(inner, f"{key}.{name}" if key else str(name))
    elif isinstance(value, list | tuple):
        yield key, ", ".join(str(v) for v in value) or "none"
    else:
        yield key, str(value)
