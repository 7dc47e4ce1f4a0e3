"""The page on the house names files and definitions that exist; its picture shows the layers that are enforced."""

import ast
import re

from places import DOCS, ROOT

PAGE = DOCS / "project" / "architecture.md"
# compiled files are no pages of the reference, so they have no link
ROW = re.compile(r"^\| .+ \| \[?`([\w/.]+)`(?:\]\([\w/.]+\))? \| `(\w+)` \|$", re.MULTILINE)


def test_every_equation_stands_in_the_file_the_table_names():
    rows = ROW.findall(PAGE.read_text(encoding="utf-8"))
    assert len(rows) >= 30
    for name, begin in rows:
        path = ROOT / "src" / "schuler" / name
        defined = {n.name for n in ast.parse(path.read_text(encoding="utf-8")).body if hasattr(n, "name")}
        assert begin in defined, f"{name}: {begin}"


def test_links_of_the_page_exist():
    links = re.findall(r"\]\(([^)#]+)\)", PAGE.read_text(encoding="utf-8"))
    assert [link for link in links if not (PAGE.parent / link).exists()] == []
