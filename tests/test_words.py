"""The words of docs/project/words.md: no retired name in the code, and docstrings that begin with what the thing is."""

import ast
import re
from pathlib import Path

import pytest

import schuler

PACKAGE = Path(schuler.__file__).resolve().parent
ROOT = Path(__file__).resolve().parents[1]

#: Names that say nothing of the field, and parts of names that do so in any company.
RETIRED = {"found", "known", "said", "told", "heard", "moved_to", "Standing", "Ahead"}
RETIRED_PARTS = re.compile(r"soften|softness|foresee|foresight|(?<![a-z])digests?(?![a-z])")
#: Hash sums, and fields of results that users read.
KEPT = {"hexdigest", "digest", "digests", "sources_digest", "compare_digest"}
#: Entries of files that users write, by the file whose sections have them.
ENTRIES = {"observability/scenario.py": {"known"}}

#: Parts of the package whose names and docstrings are still to be gone through.
STILL: set[str] = set()


def identifiers(tree: ast.AST) -> list[tuple[str, int]]:
    """Names a file gives or uses, with lines: variables, parameters, attributes, functions, classes, aliases."""
    names: list[tuple[str, int]] = []
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name) | ast.arg(arg=name) | ast.Attribute(attr=name):
                names.append((name, node.lineno))
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
                names.append((name, node.lineno))
            case ast.keyword(arg=str(name)) | ast.alias(asname=str(name)):
                names.append((name, node.lineno))
    return names


def retired_names(tree: ast.AST, entries: frozenset[str] | set[str] = frozenset()) -> list[str]:
    return [
        f"line {line}: {name}"
        for name, line in identifiers(tree)
        if (name in RETIRED and name not in entries) or (RETIRED_PARTS.search(name.lower()) and name not in KEPT)
    ]


def docstrings(tree: ast.AST) -> list[tuple[str, int]]:
    """Docstrings of modules, classes and functions, and the strings that stand below a field."""
    return [
        (node.value.value, node.lineno)
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
    ]


def inverted_docstrings(tree: ast.AST) -> list[str]:
    return [f"line {line}: {text.splitlines()[0]}" for text, line in docstrings(tree) if re.match(r"\s*Of\s", text)]


@pytest.mark.campaign
def test_names_are_of_the_field_and_docstrings_begin_with_the_thing():
    offenders = []
    for path in sorted(PACKAGE.rglob("*.py")):
        name = path.relative_to(PACKAGE)
        if name.parts[0].removesuffix(".py") not in STILL:
            tree = ast.parse(path.read_text(encoding="utf-8"))
            offenders += [
                f"{name}, {problem}"
                for problem in retired_names(tree, ENTRIES.get(name.as_posix(), set())) + inverted_docstrings(tree)
            ]
    assert not offenders, "\n".join(["see docs/project/words.md", *offenders])


@pytest.mark.campaign
def test_names_of_tests_benchmarks_and_pages_are_of_the_field():
    entries = {"tests/observability/test_study.py": {"known"}}
    offenders = []
    for path in sorted(p for room in ("tests", "benchmarks", "docs", "examples") for p in (ROOT / room).rglob("*.py")):
        name = path.relative_to(ROOT).as_posix()
        if path.name != Path(__file__).name:
            tree = ast.parse(path.read_text(encoding="utf-8"))
            offenders += [f"{name}, {problem}" for problem in retired_names(tree, entries.get(name, set()))]
    assert not offenders, "\n".join(["see docs/project/words.md", *offenders])


def test_parts_still_to_be_gone_through_exist():
    assert {p.name.removesuffix(".py") for p in PACKAGE.iterdir()} >= STILL


@pytest.mark.parametrize(
    "code",
    ["found = 1", "x.known", "def f(said): pass", "def moved_to(): pass", "class Standing: pass", "f(softness=1)",
     "import a as told", "foreseen_P = 1", "def beside_the_digest(): pass", "P_softened = 2", "DIGEST = 'x'",
     "lambda heard: 1", "for found in x: pass"],
)  # fmt: skip
def test_the_search_for_retired_names_finds_them(code):
    assert len(retired_names(ast.parse(code))) == 1


@pytest.mark.parametrize(
    "code", ["unknown = 1", "'found'", "# known", "x.hexdigest()", "found_s = 1", "foundation = 1", "digesting = 1"]
)
def test_the_search_for_retired_names_finds_nothing_else(code):
    assert retired_names(ast.parse(code)) == []


def test_the_search_for_inverted_docstrings_finds_them():
    tree = ast.parse('''"""Of a module."""\nclass C:\n    """One."""\n    x: int\n    """Of x."""\n"""Offset."""\n''')
    assert inverted_docstrings(tree) == ["line 1: Of a module.", "line 5: Of x."]
