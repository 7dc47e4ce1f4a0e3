"""Equations as MathML, which browsers draw by themselves: no script, no font, nothing fetched (decision 19)."""

from __future__ import annotations

import re
from typing import Any

import latex2mathml.converter
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.writers.html5 import HTML5Translator

#: What the converter writes, and what is drawn well: accents of their own letter close above it, bars that do not grow.
MENDS = (
    ('<mover accent="true">', "<mover>"),
    (r'<mo(?: stretchy="\w+")?>&#x0005E;</mo></mover>', '<mo stretchy="false">&#x002C6;</mo></mover>'),
    (r'<mo(?: stretchy="\w+")?>&#x0007E;</mo></mover>', '<mo stretchy="false">&#x002DC;</mo></mover>'),
    (r"<mi>([a-z]{2,})</mi><mi>", r'<mi>\1</mi><mspace width="0.17em"/><mi>'),  # sin L, not sinL
    (r"<mo>(&#x0007C;|&#x02016;)</mo>", r'<mo stretchy="false">\1</mo>'),
)
#: Command or alignment mark that the converter does not know and leaves as it is.
LEFT_OVER = re.compile(r">[^<]*(?:\\|&(?!#?\w+;))[^<]*<")


def mathml(latex: str, display: str) -> str:
    """One equation; ``display`` is ``inline`` or ``block``."""
    # GitHub wants "aligned" between dollars, the converter knows the same by another name
    text = re.sub(r"\\(begin|end)\{aligned\}", r"\\\1{split}", latex)
    drawn = latex2mathml.converter.convert(text, display=display)
    for written, better in MENDS:
        drawn = re.sub(written, better, drawn)
    return str(drawn)


def converted(node: nodes.Element, display: str) -> str:
    """The equation of a node, with a warning if something of it is not understood."""
    drawn = mathml(node.astext(), display)
    if LEFT_OVER.search(drawn):
        log = logging.getLogger(__name__)
        log.warning("equation with LaTeX that latex2mathml does not know: %s", node.astext(), location=node)
    return drawn


def inline(self: HTML5Translator, node: nodes.math) -> None:
    """An equation within a line."""
    self.body.append(converted(node, "inline"))
    raise nodes.SkipNode


def block(self: HTML5Translator, node: nodes.math_block) -> None:
    """An equation by itself, with its number if it has one."""
    number = f'<span class="eqno">({node["number"]})</span>' if node["number"] else ""
    self.body.append(self.starttag(node, "div", CLASS="math") + number + converted(node, "block") + "</div>\n")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Tell Sphinx that there is a renderer called ``mathml``."""
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
