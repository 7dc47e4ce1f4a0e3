"""A self-contained HTML page: its frame, sections, style sheet and script. Nothing is ever fetched.

The rules of the style sheet and the script are the files ``page.css`` and ``page.js`` in the folder ``assets``;
``plotly-basic.min.js.gz`` there is plotly.js of its authors, packed (``tests/plotting/test_library.py`` says which).
"""

from __future__ import annotations

import gzip
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib import resources
from typing import Literal, TypeAlias

from schuler.files import package_version
from schuler.plotting.figure import Figure
from schuler.plotting.interactive import css_name, packed, panel_data
from schuler.plotting.parts import figure_html
from schuler.plotting.style import PAGE_DARK, PAGE_LIGHT, STYLES

#: The browser itself is told to load nothing from anywhere; pictures only from the page's own "save as PNG".
POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"

#: HTML, already escaped, or a figure to draw there.
Block: TypeAlias = str | Figure


@dataclass(frozen=True, eq=False)
class Section:
    """A part of the page with a heading and a link to it; empty blocks are left out, and a section without any too.

    Attributes
    ----------
    name : str
        Name of the link: letters, digits, underscores.
    title : str
    blocks : tuple of str or Figure
        In the order in which they stand.
    folded : bool
        Opened by a click on its heading.
    """

    name: str
    title: str
    blocks: tuple[Block, ...]
    folded: bool = False


def plotly_script() -> str:
    """The drawing library, to be put into the page: plotly.js without what no page of ours draws."""
    packed = (resources.files("schuler.plotting") / "assets" / "plotly-basic.min.js.gz").read_bytes()
    return gzip.decompress(packed).decode("utf-8")


def whole_page(
    title: str,
    kind: str,
    subtitle: str,
    sentences: Sequence[str],
    conventions: str,
    sections: Sequence[Section],
    script: str,
    contents: frozenset[str] | None = None,
    tone: Literal["", "doubtful", "failed"] = "",
    leading: Figure | None = None,
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
    tone : str, optional
        The box of the verdict is amber (doubtful) or red (failed) instead of blue.
    leading : Figure, optional
        Beside the verdict, before everything else.

    Returns
    -------
    str
        HTML that loads nothing from anywhere; the same text for the same arguments.
    """
    filled = [(s, [b for b in s.blocks if b]) for s in sections]
    filled = [(s, blocks) for s, blocks in filled if blocks]
    linked = [s for s, _ in filled if contents is None or s.name in contents]
    links = "".join(f'<a href="#{s.name}">{escape(s.title)}</a>' for s in linked)
    body = "\n".join(_section(s, blocks) for s, blocks in filled)
    figures = [block for _, blocks in filled for block in blocks if isinstance(block, Figure)]
    judged = (
        f'<section id="verdict" class="{f"verdict {tone}".strip()}" aria-label="Verdict">\n'
        + "".join(f"<p>{escape(s)}</p>" for s in sentences)
        + "\n</section>"
    )
    if leading is not None:
        figures.insert(0, leading)
        judged = f'<div class="lead">\n{judged}\n{figure_html(leading)}\n</div>'
    data = {f.name: [panel_data(f, p) for p in f.panels] for f in figures}
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    # packed they are a third to a tenth as long, and no "</script" can be in them
    library = f'<script type="text/plain" id="library">{packed(script.encode())}</script>\n' if script else ""
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{POLICY}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="generator" content="schuler {escape(package_version())}">
<title>{escape(title)}: {escape(kind)}</title>
<link rel="icon" href="data:,">
<style>
{style_sheet()}
</style>
</head>
<body>
<header>
<h1>{escape(title)}</h1>
<p class="sub">{escape(subtitle)}</p>
</header>
<main>
{judged}
<noscript><p>The figures of this page are drawn by JavaScript, which is switched off here; the tables are
complete.</p></noscript>
<nav aria-label="Contents">{links}</nav>
<p class="small">{escape(conventions)}</p>
{body}
</main>
<script type="text/plain" id="figures">{packed(text.encode())}</script>
{library}<script>window.PlotlyConfig = {{MathJaxConfig: "local"}};</script>
<script>
{_asset("page.js")}</script>
</body>
</html>
"""


def _section(section: Section, blocks: Sequence[Block]) -> str:
    content = "\n".join(figure_html(block) if isinstance(block, Figure) else block for block in blocks)
    heading = f"<h2>{escape(section.title)}</h2>"
    if section.folded:
        content, heading = f"<details><summary>{heading}</summary>\n{content}\n</details>", ""
    return f'<section id="{section.name}">\n{heading}\n{content}\n</section>'


def style_sheet() -> str:
    """Style sheet of a page: colours on light and dark ground, then ``assets/page.css``."""
    dark = _variables(PAGE_DARK, "dark")
    return (
        f":root {{ color-scheme: light; {_variables(PAGE_LIGHT, 'light')} }}\n"
        f"@media (prefers-color-scheme: dark) {{ :root:not([data-theme=light]) {{ color-scheme: dark; {dark} }} }}\n"
        + _asset("page.css").strip()
    )


def _variables(ground: Mapping[str, str], which: str) -> str:
    pairs = [f"--{name}: {colour};" for name, colour in ground.items()]
    for role, look in STYLES.items():
        colour = look.light if which == "light" else look.dark
        r, g, b = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
        # bands are a little stronger on dark ground, where they would drown
        alpha = look.alpha if which == "light" or look.alpha == 1.0 else min(look.alpha * 1.3, 1.0)
        pairs.append(f"{css_name(role)}: {colour};")
        pairs.append(f"{css_name(role, area=True)}: rgba({r}, {g}, {b}, {alpha:.2f});")
    return " ".join(pairs)


def _asset(name: str) -> str:
    """Text of a file in the folder ``assets``."""
    return (resources.files("schuler.plotting") / "assets" / name).read_text(encoding="utf-8")
