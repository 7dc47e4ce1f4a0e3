"""The documentation as a site: complete, every link leads somewhere, renders in Chromium.

The folder ``SCHULER_SITE`` has the site, which `.ci/run` builds in a step of its own (a minute); without it the tests
of built pages are skipped.
"""

import inspect
import os
import pkgutil
import re
import zlib
from functools import cache
from html.parser import HTMLParser
from importlib import import_module
from pathlib import Path
from urllib.parse import unquote, urlsplit

import chromium
import pytest
from places import ROOT

import schuler


@pytest.fixture(scope="session")
def site() -> Path:
    """Folder of the built pages."""
    if "SCHULER_SITE" not in os.environ:
        pytest.skip("no site: sphinx-build -W -b html docs docs/_build/html, then SCHULER_SITE=docs/_build/html")
    return Path(os.environ["SCHULER_SITE"]).resolve()


def test_every_page_is_built(site):
    sources = {p.relative_to(ROOT / "docs").with_suffix(".html") for p in (ROOT / "docs").rglob("*.md")}
    missing = [str(p) for p in sources if "_build" not in p.parts and not (site / p).exists()]
    assert not missing


class _Links(HTMLParser):
    """Names that can be linked to, links, and what is loaded."""

    def __init__(self) -> None:
        super().__init__()
        self.ids: set[str] = set()
        self.links: list[str] = []
        self.loaded: list[str] = []

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        self.ids |= {values[key] for key in ("id", "name") if values.get(key)}
        if tag == "a" and values.get("href"):
            self.links.append(values["href"])
        elif tag in ("img", "script", "iframe", "source") and values.get("src"):
            self.loaded.append(values["src"])
        elif tag == "link" and values.get("rel") != "canonical":
            self.loaded.append(values["href"])


@cache
def links_of(path: Path) -> _Links:
    parser = _Links()
    parser.feed(path.read_text(encoding="utf-8"))
    return parser


def broken(page: Path) -> list[str]:
    """Links of a page within the site that lead nowhere, and what it would load from elsewhere."""
    problems = []
    here = links_of(page)
    for link in [*here.links, *here.loaded]:
        parts = urlsplit(link)
        if parts.scheme or parts.netloc:
            if link in here.loaded and parts.scheme != "data":
                problems.append(f"loads {link}")
            continue
        target = page if not parts.path else (page.parent / unquote(parts.path)).resolve()
        if not target.is_file():
            problems.append(f"no file: {link}")
        elif parts.fragment and target.suffix == ".html" and unquote(parts.fragment) not in links_of(target).ids:
            problems.append(f"no such place: {link}")
    return problems


def test_every_link_leads_somewhere(site):
    pages = [p for p in site.rglob("*.html") if "_static" not in p.parts]
    assert len(pages) > 80
    assert {str(p.relative_to(site)): b for p in pages if (b := broken(p))} == {}


def test_the_search_for_broken_links_finds_them(tmp_path):
    (tmp_path / "b.html").write_text('<h1 id="here">b</h1>')
    page = tmp_path / "a.html"
    page.write_text(
        '<a href="b.html#here"></a><a href="b.html#there"></a><a href="c.html"></a><a href="#top"></a>'
        '<a href="https://example.org/"></a><script src="https://example.org/x.js"></script>'
    )
    assert broken(page) == [
        "no such place: b.html#there", "no file: c.html", "no such place: #top", "loads https://example.org/x.js"
    ]  # fmt: skip


def test_links_to_code_lead_into_the_reference(site):
    """``[...](../src/schuler/reproduce/yaman/study/modes.py)`` on GitHub is the file, here the module's
    documentation.
    """
    assert any("api/schuler.reproduce.yaman.study.html#module-schuler.reproduce.yaman.study.modes" in link
               for link in links_of(site / "field-drives.html").links)  # fmt: skip


def inventory(site: Path) -> set[str]:
    """Python names that the site documents (Sphinx's inventory: four lines of text, then compressed lines)."""
    packed = (site / "objects.inv").read_bytes().split(b"\n", 4)[4]
    lines = zlib.decompress(packed).decode().splitlines()
    return {line.split(" ", 1)[0] for line in lines if " py:" in line}


def public_modules() -> list[str]:
    walked = pkgutil.walk_packages(schuler.__path__, "schuler.")
    names = [m.name for m in walked if not any(p.startswith("_") or p.endswith("kernels") for p in m.name.split("."))]
    return ["schuler", *(name for name in names if not name.startswith("schuler.cli"))]


def test_every_name_of_every_list_is_in_the_reference(site):
    documented = inventory(site)
    packages = [import_module(name) for name in public_modules()]
    listed = [
        f"{m.__name__}.{n}" for m in packages if hasattr(m, "__path__") for n in getattr(m, "__all__", ())
        if not inspect.ismodule(getattr(m, n))
    ]  # fmt: skip
    assert len(listed) > 150
    # a name that a package passes on is there under the shorter one
    homes = {f"{m.__name__}.{n}": _home(getattr(m, n)) for m in packages for n in getattr(m, "__all__", ())}
    missing = [name for name in listed if name not in documented and homes[name] not in documented]
    assert not missing
    assert {f"schuler.{name}" for name in schuler.__all__} <= documented


def _home(value) -> str:
    return f"{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', '')}"


def defined() -> dict[str, object]:
    """Public functions and classes by the name of the module that defines them."""
    return {
        f"{module}.{name}": value
        for module in public_modules()
        for name, value in vars(import_module(module)).items()
        if not name.startswith("_") and callable(value) and _home(value) == f"{module}.{name}"
    }


def test_every_public_function_and_class_is_in_the_reference(site):
    """Under the name it is defined with, whatever shorter name it is shown by."""
    names = defined()
    assert len(names) > 1500
    assert not sorted(set(names) - inventory(site))


def test_every_public_function_and_class_says_what_it_is():
    silent = [name for name, value in defined().items() if len((inspect.getdoc(value) or "").split()) < 2]
    assert not silent


DOTTED = re.compile(r"`(schuler(?!\.(?:json|toml|yaml)`)(?:\.[A-Za-z_]\w*)+)(?:\([^`]*\))?`")
MARKDOWN = sorted(p for p in (ROOT / "docs").rglob("*.md") if "_build" not in p.parts)


def exists(name: str) -> bool:
    """Whether a dotted name is a module of ours or something in one."""
    parts = name.split(".")
    for k in range(len(parts), 0, -1):
        try:
            value = import_module(".".join(parts[:k]))
        except ModuleNotFoundError:
            continue
        for part in parts[k:]:
            fields = getattr(value, "model_fields", {}) | getattr(value, "__annotations__", {})
            value = getattr(value, part, fields.get(part))
        return value is not None
    return False


def test_names_on_pages_exist():
    """``schuler.navigation.evaluation.errors.trajectory_errors`` in backticks is a name of the package; the site
    links it.
    """
    names = {(page, name) for page in MARKDOWN for name in DOTTED.findall(page.read_text(encoding="utf-8"))}
    assert len(names) > 100
    assert [(page.name, name) for page, name in sorted(names) if not exists(name)] == []


@pytest.fixture(scope="module")
def mathml():
    pytest.importorskip("sphinx", reason="Sphinx is not installed: pip install 'schuler[docs]'")
    pytest.importorskip("latex2mathml", reason="latex2mathml is not installed: pip install 'schuler[docs]'")
    return import_module("mathml")


def test_equations_become_mathml(mathml):
    text = mathml.mathml(r"\begin{aligned} \hat a &= \sin L \\ b &= c \end{aligned}", "block")
    assert text.count("<mtr>") == 2
    assert '<mo stretchy="false">&#x002C6;</mo></mover>' in text
    assert '<mi>sin</mi><mspace width="0.17em"/><mi>L</mi>' in text
    assert not mathml.LEFT_OVER.search(text)


@pytest.mark.parametrize("latex", [r"\unknown x", r"a & b", r"x_{\unknown}"])
def test_latex_that_is_not_understood_is_seen(mathml, latex):
    assert mathml.LEFT_OVER.search(mathml.mathml(latex, "inline"))


PAGES = ("index.html", "conventions.html", "commands.html", "calibration-conventions.html", "navigation-entries.html",
         "decisions/README.html", "project/changelog.html", "api/index.html", "api/schuler.html",
         "api/schuler.calibration.html")  # fmt: skip


@chromium.needed
@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("page", PAGES)
def test_page_renders(site, page, width):
    with chromium.opened(site / page, width) as opened:
        seen = chromium.seen(opened)
        title = chromium.run(opened, "document.querySelector('h1').getBoundingClientRect().height")
    assert seen.errors == ()
    assert seen.requests == ()
    assert seen.overflow <= 0.0
    assert title > 10.0
    assert len(seen.text) > 300


@chromium.needed
@pytest.mark.parametrize("width", [1280, 390])
def test_pages_with_equations_draw_them(site, width):
    pages = [p for p in sorted((site / "theory").glob("*.html")) if "<math" in p.read_text(encoding="utf-8")]
    for page in pages:
        with chromium.opened(page, width) as opened:
            seen = chromium.seen(opened)
            sizes = chromium.run(
                opened, "Array.from(document.querySelectorAll('math')).map(m => m.getBoundingClientRect().height)"
            )
        assert (seen.errors, seen.requests) == ((), ()), page
        assert seen.overflow <= 0.0, page
        assert min(sizes) > 5.0, page


@chromium.needed
def test_search_works_from_the_file_system(site):
    with chromium.opened(site / "index.html", 1280) as page:
        box = "document.querySelector('.sidebar-search')"
        chromium.run(page, f"{box}.value = 'gyrocompass', {box}.form.submit()")
        chromium.wait_for(page, "document.querySelector('#search-results li a')")
        problems = chromium.run(
            page, "Array.from(document.querySelectorAll('#search-results li')).map(x => x.innerText)"
        )
        assert any("gyrocompass" in text.lower() for text in problems)
        assert chromium.errors(page) == ()
        assert chromium.requests(page) == ()


@chromium.needed
def test_the_menu_opens_on_a_phone(site):
    with chromium.opened(site / "index.html", 390) as page:
        left = "document.querySelector('.sidebar-drawer').getBoundingClientRect().left"
        assert chromium.run(page, left) < 0.0
        chromium.click(page, "label.nav-overlay-icon")
        chromium.wait_for(page, f"{left} >= 0")
        assert chromium.errors(page) == ()


@chromium.needed
def test_chromium_tells_what_is_wrong_with_a_page(tmp_path):
    page = tmp_path / "bad.html"
    page.write_text(
        "<!DOCTYPE html><meta name=viewport content='width=device-width'><h1>bad</h1>"
        "<div style='width: 500px'>wide</div><img src='https://example.org/x.png'>"
        "<script>console.error('it said so'); undefined_function()</script>"
    )
    seen = chromium.visit(page, 390)
    assert seen.requests == ("https://example.org/x.png",)
    assert seen.overflow >= 110.0
    assert any("it said so" in e for e in seen.errors)
    assert any("undefined_function" in e for e in seen.errors)
    assert seen.screenshot.startswith(b"\x89PNG")
    assert "wide" in seen.text


@chromium.needed
def test_chromium_finds_nothing_on_a_good_page(tmp_path):
    page = tmp_path / "good.html"
    page.write_text("<!DOCTYPE html><meta name=viewport content='width=device-width'><p>good</p>")
    seen = chromium.visit(page, 390)
    assert (seen.errors, seen.requests, seen.overflow, seen.text) == ((), (), 0.0, "good")
