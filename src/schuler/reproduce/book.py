"""One self-contained HTML page with everything that was reproduced."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from html import escape
from pathlib import Path

from schuler.files import package_version, write_text
from schuler.plotting import parts
from schuler.plotting.page import Block, Section, plotly_script, whole_page
from schuler.reproduce.cells import Cell
from schuler.reproduce.items import Result
from schuler.reproduce.run import THESES, Reproduction

_CONVENTIONS = (
    "agrees: every number that is compared is met within the band beside it, one of the thesis's own within a factor "
    "of two. in part: so, but numbers that are not compared are a fifth or more apart. differs: with the reason. The "
    "rest could not, or hardly, have come out otherwise. within noise: other seeds say the other. weak: no band is "
    "narrower than a factor of two. pattern only: an ordering or a shape, no number. transcribed: numbers that were "
    "put in. corrected: the equations are met after their errors are mended, and what the thesis prints differs or "
    "cannot be compared. shown: the thesis prints nothing to compare with. Class hardware: the thesis used recordings "
    "that are not public; ours come from simulated sensors of the same parameters. Check: numbers of an independent "
    "computation from a thesis's equations, verified and mended."
)


def write_book(reproductions: Sequence[Reproduction], path: Path | str) -> Path:
    """Write the page.

    Parameters
    ----------
    reproductions : sequence of Reproduction
    path : Path or str
        The HTML file.

    Returns
    -------
    Path
        The file.
    """
    sections: list[Section] = [_overview(reproductions)]
    for one in reproductions:
        for k, result in enumerate(one.results):
            heading = f"{THESES[one.thesis]}: " if k == 0 else ""
            name = _section_name(one.thesis, result)
            sections.append(Section(name, f"{heading}{result.item.id}, {result.item.title}", _blocks(name, result)))
    rows = [
        ("schuler", package_version()),
        *((one.thesis, f"{'quick' if one.effort.quick else 'full'}, seed {one.effort.seed}") for one in reproductions),
    ]
    table = parts.table("What this page is made from", ("entry", "value"), rows, numbers=False)
    sections.append(Section("provenance", "Provenance", (table,)))
    drawn = any(not isinstance(block, str) for section in sections for block in section.blocks)
    text = whole_page(
        "Reproduced", "Reproduction", "Five theses on inertial navigation beside schuler",
        [_sentence(one) for one in reproductions], _CONVENTIONS, sections, plotly_script() if drawn else "",
        contents=_first_of_each(reproductions),
    )  # fmt: skip
    return write_text(path, text)


def _first_of_each(reproductions: Sequence[Reproduction]) -> frozenset[str]:
    """Sections named at the top: hundreds of items would bury the page."""
    firsts = (_section_name(one.thesis, one.results[0]) for one in reproductions if one.results)
    return frozenset(("overview", *firsts, "provenance"))


def _section_name(thesis: str, result: Result) -> str:
    return f"{thesis}_{result.item.id}".replace("-", "_").replace(".", "_")


def _sentence(one: Reproduction) -> str:
    cut = "" if one.complete else " Interrupted: not all items."
    return f"{THESES[one.thesis]}: {one.headline()}.{cut}"


def _overview(reproductions: Sequence[Reproduction]) -> Section:
    lines = []
    for one in reproductions:
        for r in one.results:
            link = f'<a href="#{_section_name(one.thesis, r)}">{escape(r.item.id)}</a>'
            cells = (one.thesis, link, escape(r.item.title), r.item.kind, r.verdict)
            lines.append("<tr>" + "".join(f"<td>{c}</td>" for c in cells) + "</tr>")
    heads = "".join(f'<th scope="col">{h}</th>' for h in ("thesis", "item", "what", "class", "verdict"))
    table = f"<table>\n<thead><tr>{heads}</tr></thead>\n<tbody>\n" + "\n".join(lines) + "\n</tbody>\n</table>"
    return Section("overview", "All items", (table,))


def _blocks(name: str, result: Result) -> tuple[Block, ...]:
    rows = [(c.name, c.printed or "none", c.shown(), c.unit, _band(c), _agreement(c)) for c in result.outcome.cells]
    heads = ("number", "printed", "ours", "unit", "ours is to be", "verdict")
    caption = f"Class {result.item.kind}, verdict {result.verdict}"
    figures = tuple(replace(figure(), name=f"{name}_figure_{k + 1}") for k, figure in enumerate(result.outcome.figures))
    reason = "".join(f"<p>{escape(text)}</p>" for text in (result.item.flips, result.outcome.reason) if text)
    return (parts.table(caption, heads, rows, numbers=False), reason, *figures)


def _agreement(cell: Cell) -> str:
    if cell.uncompared:
        return f"not compared: {cell.why}"
    if cell.transcribed and cell.agrees:
        return "yes, was put in"
    return {None: "", True: "yes", False: "no"}[cell.agrees]


def _band(cell: Cell) -> str:
    if not cell.compared:
        return ""
    return f"{cell.band()}\n{cell.tolerance}" + (", corrected equations" if cell.reference == "corrected" else "")
