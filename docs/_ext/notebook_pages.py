"""Notebooks as pages of the site, with the outputs they were saved with; nothing is executed by the build."""

from __future__ import annotations

import json
from typing import Any

from docutils import nodes
from myst_parser.sphinx_ import Parser as Markdown
from notebooks import markdown
from sphinx.application import Sphinx


class Notebook(Markdown):
    """Reads a notebook as the Markdown page that it amounts to."""

    supported = ("ipynb",)

    def parse(self, inputstring: str, document: nodes.document) -> None:
        """Parse the cells in their order."""
        super().parse(markdown(json.loads(inputstring)), document)


def setup(app: Sphinx) -> dict[str, Any]:
    """Take ``.ipynb`` files for pages."""
    app.add_source_suffix(".ipynb", "ipynb")
    app.add_source_parser(Notebook)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
