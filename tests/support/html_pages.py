"""HTML reports as a browser would see them, and the laws that hold for each of them."""

import base64
import gzip
import json
import re
from html.parser import HTMLParser

import pytest

VOID = {"meta", "link", "br", "hr", "img", "input", "wbr"}


class Page(HTMLParser):
    """Elements and their text, and whether they nest."""

    def __init__(self, source: str) -> None:
        super().__init__(convert_charrefs=True)
        self.source = source
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.text: dict[str, list[str]] = {}
        self.feed(source)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        self.text.setdefault(tag, []).append("")
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        for tag in set(self.open):
            self.text[tag][-1] += data

    def all(self, tag):
        return [a for t, a in self.elements if t == tag]

    @property
    def figures(self) -> dict:
        """Data of the figures, as the script of the page gets it."""
        return json.loads(self.unpacked("figures"))

    @property
    def plain(self) -> str:
        """The page with what its script unpacks written out."""
        text = self.source
        for name in ("figures", "library"):
            if any(a.get("id") == name for a in self.all("script")):
                text = re.sub(rf'(id="{name}">)[^<]*', lambda m, name=name: m.group(1) + self.unpacked(name), text)
        return text

    def unpacked(self, name: str) -> str:
        """Text that the script of the page unpacks: ``figures`` or ``library``."""
        scripts = zip(self.text["script"], self.all("script"), strict=True)
        return gzip.decompress(base64.b64decode(next(t for t, a in scripts if a.get("id") == name))).decode()


def check_page(page: Page, title: str, sections: list[str]) -> None:
    """Elements nest, identifiers are unique, links lead to them, sections stand in order, and nothing is fetched."""
    assert page.source.startswith("<!DOCTYPE html>")
    assert page.open == []
    assert page.text["title"] == [title]
    assert page.text["h2"] == sections
    ids = [a["id"] for _, a in page.elements if "id" in a]
    assert len(ids) == len(set(ids))
    assert all(a["href"][1:] in ids for a in page.all("a"))
    policy = next(m["content"] for m in page.all("meta") if m.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'")
    assert not re.search(r"https?://|url\(|@import|\bfetch\(|XMLHttpRequest", page.source)


def check_figures(page: Page, names: list[str]) -> None:
    """Every plot has data, every figure a caption, every colour a definition; plotly accepts the first of each."""
    data = page.figures
    assert list(data) == names
    for panels in data.values():
        for panel in panels:
            assert any(v is not None for trace in panel["data"] for v in trace["y"])
    assert len(page.all("figure")) == len(page.all("figcaption")) == len(data)
    assert all(len(t) > 40 and t.strip().endswith(".") for t in page.text["figcaption"])
    used = set(re.findall(r'"(--[a-z-]+)"', json.dumps(data))) | set(re.findall(r"var\((--[a-z-]+)\)", page.source))
    assert used <= set(re.findall(r"(--[a-z-]+):", page.text["style"][0]))
    go = pytest.importorskip("plotly.graph_objects")
    for name, panels in data.items():
        assert len(go.Figure(coloured(panels[0])).data) == len(panels[0]["data"]), name


def coloured(v):
    """With a colour in place of each name of one, which the page puts in."""
    if isinstance(v, str):
        return "#123456" if v.startswith("--") else v
    if isinstance(v, list):
        return [coloured(x) for x in v]
    return {k: coloured(x) for k, x in v.items()} if isinstance(v, dict) else v
