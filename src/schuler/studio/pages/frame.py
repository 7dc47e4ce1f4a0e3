"""The frame that all pages share: style, links, and the parts that more than one page has."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from html import escape
from typing import Any
from urllib.parse import quote

from nicegui import ui

from schuler.exceptions import printable
from schuler.files import package_version
from schuler.plotting.page import style_sheet
from schuler.proposal import UndecidedError
from schuler.studio.signals import Views
from schuler.studio.workspace import Workspace

_LINKS = (
    ("/", "Look"), ("/navigate", "Navigate"), ("/noise", "Noise"), ("/calibrate", "Calibrate"), ("/coach", "Coach"),
    ("/plan", "Plan"), ("/runs", "Runs"),
)  # fmt: skip


def add_pages(workspace: Workspace, views: Views) -> None:
    """Register all pages for a folder."""
    from schuler.studio.pages.calibrate import calibrate_page
    from schuler.studio.pages.coach import coach_page
    from schuler.studio.pages.look import look_page
    from schuler.studio.pages.navigate import navigate_page
    from schuler.studio.pages.noise import noise_page
    from schuler.studio.pages.plan import plan_page
    from schuler.studio.pages.runs import runs_page

    @ui.page("/", title="Look: schuler studio")
    def look(log: str = "") -> None:
        with frame("Look", workspace):
            look_page(workspace, views, log)

    @ui.page("/navigate", title="Navigate: schuler studio")
    def navigate(log: str = "", config: str = "") -> None:
        with frame("Navigate", workspace):
            navigate_page(workspace, views, log, config)

    @ui.page("/noise", title="Noise: schuler studio")
    def noise(log: str = "", config: str = "") -> None:
        with frame("Noise", workspace):
            noise_page(workspace, views, log, config)

    @ui.page("/calibrate", title="Calibrate: schuler studio")
    def calibrate(log: str = "", config: str = "") -> None:
        with frame("Calibrate", workspace):
            calibrate_page(workspace, views, log, config)

    @ui.page("/coach", title="Coach: schuler studio")
    def coach(log: str = "", config: str = "") -> None:
        with frame("Coach", workspace):
            coach_page(workspace, log, config)

    @ui.page("/plan", title="Plan: schuler studio")
    def plan(mission: str = "") -> None:
        with frame("Plan", workspace):
            plan_page(workspace, mission)

    @ui.page("/runs", title="Runs: schuler studio")
    def runs() -> None:
        with frame("Runs", workspace):
            runs_page(workspace)


@contextmanager
def frame(name: str, workspace: Workspace) -> Iterator[None]:
    """Head of a page with the links to the others."""
    version = package_version()
    ui.add_head_html(
        f"<style>{style_sheet()}</style>"
        f'<link rel="stylesheet" href="/studio/assets/studio.css?{version}">'
        '<script>window.PlotlyConfig = {MathJaxConfig: "local"};</script>'
        f'<script defer src="/studio/assets/plotly.js?{version}"></script>'
        f'<script defer src="/studio/assets/studio.js?{version}"></script>'
    )
    links = "".join(
        f'<a href="{place}"{" aria-current=page" if title == name else ""}>{title}</a>' for place, title in _LINKS
    )
    html(
        f'<header class="bar"><h1>schuler studio</h1><nav aria-label="Pages">{links}</nav>'
        f'<span class="where">{escape(str(workspace.root))}</span></header>'
    )
    yield


def html(text: str) -> ui.html:
    """HTML of ours, in which everything foreign is escaped already."""
    return ui.html(text, sanitize=False).style("width: 100%")


def heading(text: str) -> None:
    """Heading of a part of a page."""
    html(f"<h2>{escape(text)}</h2>")


def name_menu(label: str, names: Sequence[str], value: str, choose: Callable[[str], Any]) -> ui.select:
    """Menu of files or folders, searched by typing."""
    return ui.select(
        list(names), value=value if value in names else None, label=label, with_input=True,
        on_change=lambda e: choose(e.value or ""),
    ).props(f'outlined dense aria-label="{label}"')  # fmt: skip


def hint(text: str, *, bad: bool = False) -> ui.html:
    """A sentence in small letters; red where something is wrong."""
    return html(f'<p class="hint{" bad" if bad else ""}">{escape(text)}</p>')


@contextmanager
def block(names: str) -> Iterator[ui.element]:
    """Element with these classes, to be filled."""
    with ui.element("div").classes(names) as element:
        yield element


@contextmanager
def fold(title: str, *, opened: bool = False) -> Iterator[None]:
    """Part of a page that is folded and opened by a click on its title."""
    with ui.element("details").props("open" if opened else "").style("width: 100%"):
        with ui.element("summary"):  # a child of its own: what stands within another element is no summary
            html(escape(title)).style("display: inline")
        yield


def button(text: str, action: Any, kind: str = "") -> ui.button:
    """Button in the look of the reports; kind ``main`` of what a page is for, ``grave`` of what cannot be undone."""
    return ui.button(text, on_click=action, color=None).props("unelevated no-caps").classes(kind)


def chart(kind: str, *, without: str = "", label: str = "") -> ui.element:
    """Place of a chart that ``assets/studio.js`` draws from a source: signals, timeline, plan or figure."""
    element = ui.element("div").classes(f"chart {kind}")
    element.props["data-chart"] = kind
    element.props["data-source"] = ""
    element.props["data-without"] = without
    element.props["aria-label"] = label
    return element


def place() -> ui.element:
    """Element over all of the width, to be filled later."""
    return ui.element("div").style("width: 100%")


def show(
    element: ui.element,
    *,
    source: str | None = None,
    windows: Sequence[tuple[float, float, str]] | None = None,
    map_name: str | None = None,
) -> None:
    """Give a chart another source, other windows (start, stop, role of the colour) or map; it draws itself anew."""
    if map_name is not None:
        element.props["data-map"] = map_name
    if source is not None:
        element.props["data-source"] = source
    if windows is not None:
        element.props["data-windows"] = json.dumps(windows)
    element.update()


def command_box(text: str) -> None:
    """The command that does the same, with a button that copies it."""

    def copy() -> None:
        ui.clipboard.write(text)
        ui.notify("copied")

    with block("command"):
        html(f"<pre>{escape(text)}</pre>")
        button("copy", copy).props('aria-label="copy the command"')


def table(head: Sequence[str], rows: Sequence[Sequence[Any]], caption: str = "") -> None:
    """Table of texts and numbers, numbers to the right; all their digits are shown when pointed at."""
    cells = "".join(f"<th>{escape(text)}</th>" for text in head)
    body = "".join("<tr>" + "".join(_cell(value) for value in row) + "</tr>" for row in rows)
    above = f"<caption>{escape(caption)}</caption>" if caption else ""
    html(f"<table>{above}<thead><tr>{cells}</tr></thead><tbody>{body}</tbody></table>")


def _cell(value: Any) -> str:
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return f'<td class="n"><data value="{value!r}" title="{value!r}">{value:.6g}</data></td>'
    return f"<td>{escape('' if value is None else str(value))}</td>"


def report_frame(folder: str, title: str) -> None:
    """The report of a folder, and a link that opens it by itself."""
    report = f"/studio/files/{quote(folder)}/report.html"
    html(
        f'<p><a href="{report}" target="_blank">open the report</a></p>'
        f'<iframe class="report" title="{escape(title)}" src="{report}"></iframe>'
    )


def question_box(question: UndecidedError, answer: Callable[[dict[str, Any]], Any]) -> None:
    """A question that a log leaves open, with a button for each answer it allows."""
    with block("finding warning"):
        html(f"<p>{escape(printable(question.text))}</p>")
        with block("line"):
            for words, entries in question.choices:
                button(words, lambda e=entries: answer(e), "main")


def problem(error: Exception) -> None:
    """Say what a command would have said."""
    ui.notify(printable(str(error)), type="negative", multi_line=True, timeout=12000, close_button="close")
