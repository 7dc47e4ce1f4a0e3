"""One self-contained HTML page on a navigation solution: opens from a disk, without a network, on a phone, on paper."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from html import escape
from importlib import metadata
from pathlib import Path
from typing import Any

from schuler.arrays import ArrayLike
from schuler.exceptions import MissingExtraError
from schuler.files import write_text
from schuler.filtering.result import NavigationResult
from schuler.filtering.states import BLOCK_TEXT
from schuler.recording.series import GnssSeries, Trajectory
from schuler.report import build, estimates, page, verdict
from schuler.report.content import Figure
from schuler.report.interactive import css_name, panel_data
from schuler.report.style import style
from schuler.report.subject import Subject

_GLYPHS = {"dot": "●", "cross": "×", "triangle": "▲", "ring": "○", "square": "■"}
_UNREPEATABLE = ("elapsed_s",)  # of the provenance: differs from run to run


def navigation_report(
    result: NavigationResult,
    path: Path | str,
    *,
    smoothed: NavigationResult | None = None,
    reference: Trajectory | None = None,
    at_antenna: bool = False,
    truth_parameters: ArrayLike | None = None,
    title: str | None = None,
    recording_summary: str | None = None,
    origin: float | None = None,
    gnss: GnssSeries | None = None,
) -> Path:
    """Write the report of a navigation solution.

    Parameters
    ----------
    result : NavigationResult
        Filtered, or smoothed if that is all there is.
    path : Path or str
        The HTML file.
    smoothed : NavigationResult, optional
        Smoothed solution of the same run.
    reference : Trajectory, optional
        Truth or a better solution; without it the claimed uncertainty is shown instead of errors.
    at_antenna : bool
        The reference is the antenna's, not the IMU's.
    truth_parameters : array_like, shape (m,) or (k, m), optional
        True parameters in the order of the layout, constant or at each record, SI.
    title : str, optional
        Default: the name of the recording.
    recording_summary : str, optional
        What was in the log, see :meth:`~schuler.recording.recording.Recording.summary`.
    origin : float, optional
        Time that is called zero; default the first time of the solution. [s]
    gnss : GnssSeries, optional
        The fixes, so that those withheld in outages are shown too.

    Returns
    -------
    Path
        The file; the same bytes for the same arguments.

    Raises
    ------
    MissingExtraError
        If plotly is not installed (extra ``report``).
    """
    script = _plotly()
    subject = Subject(result, smoothed, reference, at_antenna, truth_parameters, origin, gnss)
    text = _page(
        subject, script, title or str(result.provenance.get("recording", "Navigation solution")), recording_summary
    )
    return write_text(path, text)


def _plotly() -> str:
    try:
        from plotly.offline import get_plotlyjs
    except ImportError:
        raise MissingExtraError("plotly", "report", "the HTML report") from None
    source: str = get_plotlyjs()
    return source


def _page(subject: Subject, script: str, title: str, recording_summary: str | None) -> str:
    sections = [
        ("numbers", "Key numbers", _numbers(subject), []),
        ("track", "Track and motion", "", build.track_figures(subject)),
        ("errors", "Errors" if subject.errors else "Uncertainty", "", build.error_figures(subject)),
        ("outages", "Outages", _outage_table(subject), build.outage_figures(subject)),
        ("parameters", "Sensor parameters", _parameter_table(subject), build.parameter_figures(subject)),
        ("innovations", "Innovations", "", build.innovation_figures(subject)),
        ("notes", "Notes", _notes(subject), []),
        ("provenance", "Provenance", _provenance(subject, recording_summary), []),
    ]
    sections = [s for s in sections if s[2] or s[3]]
    links = "".join(f'<a href="#{name}">{escape(head)}</a>' for name, head, _, _ in sections)
    # figures stand before the table that lists every single one of the same numbers
    body = "\n".join(
        f'<section id="{name}">\n<h2>{escape(head)}</h2>\n'
        + "\n".join([text, *map(_figure, figures)] if name == "parameters" else [*map(_figure, figures), text])
        + "\n</section>"
        for name, head, text, figures in sections
    )
    data = {f.name: [panel_data(f, p) for p in f.panels] for _, _, _, figures in sections for f in figures}
    # "</" would end the script element, and is the same string with the stroke escaped
    packed = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("</", "<\\/")
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{page.POLICY}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="generator" content="schuler {escape(metadata.version("schuler"))}">
<title>{escape(title)}: navigation report</title>
<link rel="icon" href="data:,">
<style>
{page.style_sheet()}
</style>
</head>
<body>
<header>
<h1>{escape(title)}</h1>
<p class="sub">{escape(_subtitle(subject))}</p>
</header>
<main>
<section id="verdict" class="verdict" aria-label="Verdict">
{"".join(f"<p>{escape(s)}</p>" for s in verdict.verdict(subject))}
</section>
<noscript><p>The figures of this page are drawn by JavaScript, which is switched off here; the tables are
complete.</p></noscript>
<nav aria-label="Contents">{links}</nav>
<p class="small">{escape(_conventions(subject))}</p>
{body}
</main>
<script type="application/json" id="figures">{packed}</script>
<script>window.PlotlyConfig = {{MathJaxConfig: "local"}};</script>
<script>{script}</script>
<script>{page.SCRIPT}</script>
</body>
</html>
"""


def _subtitle(subject: Subject) -> str:
    r = subject.result
    start, stop = subject.span
    kind = " and ".join(role for role, _ in subject.solutions)
    text = f"Navigation report: {kind} solution, {stop - start:.0f} s, {r.epochs} IMU samples, {r.layout.size} states"
    return text if r.complete else text + "; the run was INTERRUPTED and ends early"


def _conventions(subject: Subject) -> str:
    zero = "the solution's first sample" if subject.origin is None else "the start of the recording"
    against = "reference" if subject.reference is not None else "truth"
    return (
        f"Conventions: errors are estimate minus {against}, along north, east and down (attitude: rotations about "
        "them); body axes are forward, right, down; heights are above the ellipsoid; times are seconds since "
        f"{zero}; sigma is one standard deviation as the filter states it."
    )


def _figure(figure: Figure) -> str:
    title_id = f"title-{figure.name}"
    panels = []
    for k, panel in enumerate(figure.panels):
        label = f"{figure.title}: {panel.y_label} against {panel.x_label}. {panel.title}".strip()
        size = "plan" if panel.equal else "tall" if len(figure.panels) == 1 or figure.columns == 2 else ""
        says = f'<p class="says">{escape(panel.title)}</p>' if panel.title else ""
        linked = ' data-linked="yes"' if figure.linked and len(figure.panels) > 1 else ""
        panels.append(
            f'<div>{says}<div class="plot {size}" role="img" aria-label="{escape(label)}" '
            f'data-figure="{escape(figure.name)}" data-panel="{k}"{linked}></div></div>'
        )
    return (
        f'<figure aria-labelledby="{title_id}">\n<h3 id="{title_id}">{escape(figure.title)}</h3>\n{_keys(figure)}\n'
        f'<div class="panels c{figure.columns}">\n' + "\n".join(panels) + "\n</div>\n"
        f"<figcaption>{escape(figure.caption)}</figcaption>\n</figure>"
    )


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


def _table(caption: str, heads: Sequence[str], rows: Sequence[Sequence[str]], *, numbers: bool = True) -> str:
    """A table whose first column names the row; the others are numbers, set to the right."""
    cell = ' class="n"' if numbers else ""
    head = f'<th scope="col">{escape(heads[0])}</th>' + "".join(
        f'<th scope="col"{cell}>{escape(h)}</th>' for h in heads[1:]
    )
    body = "\n".join(
        f'<tr><th scope="row">{escape(row[0])}</th>' + "".join(f"<td{cell}>{escape(v)}</td>" for v in row[1:]) + "</tr>"
        for row in rows
    )
    kind = "" if numbers else ' class="texts"'
    return (
        f"<table{kind}>\n<caption>{escape(caption)}</caption>\n<thead><tr>{head}</tr></thead>\n"
        f"<tbody>\n{body}\n</tbody>\n</table>"
    )


def _numbers(subject: Subject) -> str:
    heads, rows = verdict.key_numbers(subject)
    against = f" against {subject.reference_name}" if subject.errors else ""
    text = _table(
        f"Accuracy{against}, and what the filter claims", ("quantity", *heads), [(r.name, *r.values) for r in rows]
    )
    counts = verdict.measurement_rows(subject)
    if counts:
        heads = ("measurement", "used", "rejected", "after lock-out", "outside the run")
        text += "\n" + _table(
            "Measurements offered to the filter; those taken after lock-out are among the used", heads, counts
        )
    return text


def _outage_table(subject: Subject) -> str:
    rows = verdict.outage_rows(subject)
    if not rows:
        return ""
    heads = ["no.", "from [s]", "to [s]"]
    heads += [f"{role} [m]" for role in subject.errors]
    table = _table("Largest horizontal error in each outage, in brackets that at its end", heads, rows)
    return table if len(rows) <= 30 else f"<details><summary>All {len(rows)} outages</summary>\n{table}\n</details>"


def _parameter_table(subject: Subject) -> str:
    rows = estimates.parameter_rows(subject)
    if not rows:
        return ""
    true = subject.truth is not None
    heads = ["parameter", "estimate ± 1 sigma", *(["true"] if true else []), "sigma left"]
    caption = "Estimates at the end of the run; the last column is what is left of the uncertainty stated beforehand"
    return _table(caption, heads, [r if true else (r[0], r[1], r[3]) for r in rows])


def _notes(subject: Subject) -> str:
    notes = subject.result.notes
    if not notes:
        return "<p>Nothing was assumed, repaired or left out beyond the options below.</p>"
    items = "".join(f"<li>{escape(note)}</li>" for note in notes)
    return f'<p>What was assumed, repaired or left out.</p>\n<ul class="notes">{items}</ul>'


def _provenance(subject: Subject, recording_summary: str | None) -> str:
    r = subject.result
    rows = [(k, v) for k, v in _flat(r.provenance) if k.rsplit(".", 1)[-1] not in _UNREPEATABLE]
    if "schuler" not in r.provenance:
        rows.insert(0, ("schuler", metadata.version("schuler")))
    rows.append(("states", f"{r.layout.size}: {', '.join(r.layout.blocks)}"))
    rows += [
        (f"model of {b}", f"{BLOCK_TEXT[b][0]} [{BLOCK_TEXT[b][1]}]: {m.describe()}")
        for b, m in r.layout.models.items()
    ]
    rows.append(("lever arm [m]", ", ".join(f"{v:g}" for v in r.lever_arm_b)))
    rows.append(("covariance propagations", str(r.propagations)))
    text = _table("What this result was made from", ("item", "value"), rows, numbers=False)
    if recording_summary:
        # its notes are among those of the result, and stand above
        said = {f"- {note}" for note in r.notes}
        lines = [line for line in recording_summary.splitlines() if line.strip() not in said]
        text += "\n<h3>The recording</h3>\n<pre>" + escape("\n".join(lines)) + "</pre>"
    return text


def _flat(value: Any, key: str = "") -> Iterator[tuple[str, str]]:
    """Rows of nested options: path and text."""
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _flat(inner, f"{key}.{name}" if key else str(name))
    elif isinstance(value, list | tuple):
        yield key, ", ".join(str(v) for v in value) or "none"
    else:
        yield key, str(value)
