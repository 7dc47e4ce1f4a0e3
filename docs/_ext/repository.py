"""Links of the pages to other files of the repository, which GitHub follows: what the site has instead.

The texts at its top are pages here, a module of the package is a place in the API reference, and so is a dotted name
in backticks such as ``schuler.reproduce.du.study.analytic_tables.cycle_rate``. Anything else (examples, tests,
compiled code) is copied beside the site as a download, as Sphinx does with files.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

DOTTED = re.compile(r"(schuler(?:\.[A-Za-z_]\w*)+)(?:\(\))?")
PAGES = {"README": "index", "CONTRIBUTING": "project/contributing", "CHANGELOG": "project/changelog"}


def module_of(path: Path, root: Path) -> str | None:
    """Name of the public module in a file; None if it is no such file."""
    if path.suffix != ".py" or not path.is_relative_to(root / "src"):
        return None
    parts = path.relative_to(root / "src").with_suffix("").parts
    parts = parts[:-1] if parts[-1] == "__init__" else parts
    return None if any(part.startswith("_") for part in parts) or "cli" in parts else ".".join(parts)


def follow(app: Sphinx, doctree: nodes.document) -> None:
    """Point the links of a page to what the site has."""
    root = Path(app.srcdir).parent
    for link in list(doctree.findall(addnodes.pending_xref)):
        target = Path(link["reftarget"])
        if link.get("refdomain") == "doc" and target.parent == root and target.name in PAGES:
            link["reftarget"] = PAGES[target.name]
    for link in list(doctree.findall(addnodes.download_reference)):
        name = module_of((Path(app.srcdir) / link["refdoc"]).parent.joinpath(link["reftarget"]).resolve(), root)
        if name is not None:
            reference = addnodes.pending_xref(
                "", *link.children, refdomain="py", reftype="mod", reftarget=name, refexplicit=True,
                refdoc=link["refdoc"], refwarn=True,
            )  # fmt: skip
            link.replace_self(reference)
    for literal in list(doctree.findall(nodes.literal)):
        name = DOTTED.fullmatch(literal.astext())
        if name is not None and not isinstance(literal.parent, nodes.reference | addnodes.pending_xref):
            reference = addnodes.pending_xref(
                "", refdomain="py", reftype="obj", reftarget=name[1], refexplicit=True, refdoc=app.env.docname
            )
            literal.replace_self(reference)
            reference.append(literal)


def setup(app: Sphinx) -> dict[str, Any]:
    """Look at the links of every page after it was read, before files are copied."""
    app.connect("doctree-read", follow, priority=400)  # Sphinx notes the downloads at 500
    return {"parallel_read_safe": True, "parallel_write_safe": True}
