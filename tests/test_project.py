"""Rules of the project that the tools do not check: quick imports, docstrings, units at the edges, honest suppressions.

Everything is found by walking the tree, so a file that appears later is held to the same rules.
"""

from __future__ import annotations

import ast
import functools
import importlib
import io
import re
import subprocess
import sys
import tokenize
import tomllib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pytest
from places import ROOT

import schuler

PACKAGE = Path(schuler.__file__).resolve().parent  # the checkout's, or the installed one where a wheel is tested
MODULES = sorted(PACKAGE.rglob("*.py"))
ALL_PYTHON = MODULES + sorted(
    p for folder in ("tests", "benchmarks", "examples") for p in (ROOT / folder).rglob("*.py")
)
HEAVY = ("numba", "scipy", "matplotlib", "plotly", "pyarrow", "pandas", "polars", "xarray", "sympy", "h5py")


def is_kernel_file(path: Path) -> bool:
    return re.fullmatch(r"_?\w*kernels", path.stem) is not None or path.parent.name == "kernels"


EDGES = ("units.py", "sensors/sheets.py", "recording/io/", "recording/formats/", "cli")


def is_an_edge(path: Path) -> bool:
    """Where units other than SI may stand: the files named above, and the report of every domain."""
    name = path.relative_to(PACKAGE).as_posix()
    parts = name.split("/")
    return "report" in parts[:-1] or any(
        name == e or name == f"{e}.py" or name.startswith(e.rstrip("/") + "/") for e in EDGES
    )


def check_each(paths: Iterable[Path], check: Callable[[Path], Any], advice: str = "") -> None:
    """Fail with the name of every file in which ``check`` finds something, and with what it finds."""
    offenders = {
        path.relative_to(PACKAGE.parent if path.is_relative_to(PACKAGE) else ROOT).as_posix(): result
        for path in paths
        if (result := check(path))
    }
    assert not offenders, "\n".join([advice, *(f"{name}: {result}" for name, result in offenders.items())])


@functools.cache
def source(path: Path) -> str:
    return path.read_text(encoding="utf-8")


@functools.cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(source(path), str(path))


def tokens(text: str):
    return tokenize.generate_tokens(io.StringIO(text).readline)


def test_the_tree_is_where_this_file_thinks():
    assert (PACKAGE / "units.py") in MODULES
    assert Path(__file__).resolve() in ALL_PYTHON


# ---------------------------------------------------------------------------------------------- imports


def loaded_by(*names: str) -> set[str]:
    """Heavy libraries in ``sys.modules`` of a fresh interpreter after importing ``names``."""
    script = (
        f"import sys, {', '.join(names)}; print(*sorted({{m.partition('.')[0] for m in sys.modules}} & set({HEAVY!r})))"
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=120)
    assert run.returncode == 0, run.stderr
    return set(run.stdout.split())


def test_importing_the_package_imports_nothing_heavy():
    """Starting must stay quick: compilers, plotting and tables are loaded by the functions that need them."""
    assert loaded_by("schuler") == set()


def test_the_check_for_heavy_imports_can_fail():
    assert loaded_by("schuler.jit") >= {"numba"}


def test_the_bottom_layers_import_nothing_heavy():
    """Exceptions, arrays, units, files, time, rotation, Earth, frames, increments and motion need NumPy only."""
    names = ("exceptions", "arrays", "units", "files", "timebase", "rotation", "earth", "frames", "sensors.increments",
             "simulation.motion", "simulation.profiles")  # fmt: skip
    assert loaded_by(*(f"schuler.{name}" for name in names)) == set()


@functools.cache
def imports_when_loaded(tree: ast.Module) -> list[tuple[str, int]]:
    """Dotted names a module imports while it is being imported: anywhere but in functions and ``if TYPE_CHECKING``."""
    problems: list[tuple[str, int]] = []

    def visit(node: ast.AST) -> None:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            return
        if isinstance(node, ast.If) and ast.unparse(node.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING"):
            for child in node.orelse:
                visit(child)
            return
        if isinstance(node, ast.Import):
            problems.extend((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            problems.extend((f"{node.module or ''}.{alias.name}", node.lineno) for alias in node.names)
        for child in ast.iter_child_nodes(node):
            visit(child)

    visit(tree)
    return problems


def names_a_kernel_module(name: str) -> bool:
    return any(re.fullmatch(r"_\w*kernels|kernels", part) for part in name.split("."))


def test_compiled_kernels_are_imported_only_inside_functions():
    """A public module with kernels at its top would import numba with the package; kernels may import kernels."""

    def early(path):
        return [(name, line) for name, line in imports_when_loaded(parsed(path)) if names_a_kernel_module(name)]

    public = [p for p in MODULES if not is_kernel_file(p)]
    check_each(public, early, "move the imports into the functions that run the kernels")


def test_kernels_take_constants_only_from_files_that_outdate_the_machine_code():
    """Numbers and helpers of other files are compiled in: a change there must not leave old code on disk in use."""
    from schuler.jit import SOURCES

    outdating = {"schuler." + name.removesuffix(".py").replace("/", ".") for name in SOURCES}

    def unseen(path):
        ours = [(name, line) for name, line in imports_when_loaded(parsed(path)) if name.startswith("schuler.")]
        return [
            (name, line)
            for name, line in ours
            if not names_a_kernel_module(name) and name.rpartition(".")[0] not in outdating
        ]

    kernels = [p for p in MODULES if is_kernel_file(p)]
    assert len(kernels) > 10
    check_each(kernels, unseen, "add these modules to jit.SOURCES")


def test_heavy_libraries_are_imported_only_inside_functions():
    """The same for the libraries themselves; numba is for kernel files and for the module that compiles them."""

    def early(path):
        heavy = set(HEAVY) - ({"numba"} if is_kernel_file(path) or path.stem in ("jit", "jit_numba") else set())
        return [(n, line) for n, line in imports_when_loaded(parsed(path)) if n.partition(".")[0] in heavy]

    check_each(MODULES, early, "import them where they are used")


def test_the_scan_for_early_imports_sees_what_it_should():
    tree = ast.parse(
        "from a import _kernels\nfrom a._run_kernels import f\nimport a._x_kernels as k\n"
        "try:\n    from b import _kernels\nexcept ImportError:\n    pass\n"
        "class C:\n    from c import _kernels\n"
        "if TYPE_CHECKING:\n    from d import _kernels\n"
        "def f():\n    from e import _kernels\n"
        "from a import kernels_of_truth\n"
    )
    lines = [line for name, line in imports_when_loaded(tree) if names_a_kernel_module(name)]
    assert lines == [1, 2, 3, 5, 9]


def test_no_file_has_the_name_of_what_its_package_hands_out():
    """Once such a file is imported, its package's attribute is the module, and no longer the function."""
    for stub in PACKAGE.rglob("__init__.pyi"):
        handed = {
            alias.asname
            for node in parsed(stub).body
            if isinstance(node, ast.ImportFrom) and node.module is not None  # else it hands out the module itself
            for alias in node.names
        }
        files = {p.stem for p in stub.parent.glob("*.py")} | {p.name for p in stub.parent.iterdir() if p.is_dir()}
        assert not handed & files, f"{stub}: rename the file, {handed & files}"


def test_faces_hand_out_what_their_stubs_list():
    for stub in PACKAGE.rglob("__init__.pyi"):
        name = ".".join(stub.parent.relative_to(PACKAGE.parent).parts)
        package = importlib.import_module(name)
        for handed in package.__all__:
            assert getattr(package, handed) is not None


# ---------------------------------------------------------------------------------------------- privacy


def package_of(path: Path) -> str:
    return ".".join(path.relative_to(PACKAGE.parent).parent.parts)


def imports_of_private_names(tree: ast.Module, package: str) -> list[str]:
    """Imports, in a file of ``package``, of a name with a leading underscore from outside what holds it."""
    intruding = []
    for node in ast.walk(tree):
        names: list[str] = []
        if isinstance(node, ast.ImportFrom):
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        for name in names:
            holders = re.findall(r"^(.*?)\._(?!_)", name)  # what holds the first private part
            if name.startswith("schuler.") and holders and not f"{package}.".startswith(f"{holders[0]}."):
                intruding.append(f"line {node.lineno}: {name}")
    return intruding


def test_names_with_an_underscore_are_private_to_what_holds_them():
    """``a._kernels`` is imported inside the package ``a`` only, ``a.b._row`` inside ``a.b`` only."""
    check_each(MODULES, lambda path: imports_of_private_names(parsed(path), package_of(path)))


@pytest.mark.parametrize(
    ("line", "package", "allowed"),
    [
        ("from schuler.a import _kernels", "schuler.a", True),
        ("from schuler.a._kernels import f", "schuler.a.c", True),
        ("from schuler.a._kernels import f", "schuler.b", False),
        ("import schuler.a._kernels as k", "schuler.ab", False),
        ("from schuler.a.b import _row", "schuler.a", False),
        ("from schuler.a.b import row, __version__", "schuler.a", True),
        ("from os import _exit", "schuler.a", True),
    ],
)
def test_the_search_for_private_imports_tells_them_apart(line, package, allowed):
    assert (imports_of_private_names(ast.parse(line), package) == []) is allowed


# ------------------------------------------------------------------------------------------- docstrings


def test_every_module_says_what_it_is_for():
    """An ``__init__`` too: it is the public list."""

    def silent(path):
        return not (ast.get_docstring(parsed(path)) or "").strip()

    check_each(MODULES, silent)


# -------------------------------------------------------------------------------- units only at the edges

CONVERSION = re.compile(
    r"""\b(?:deg2rad|rad2deg)\b
      | \b(?:np|numpy|math|jnp|cmath)\.(?:radians|degrees)\b
      | \bfrom\s+math\s+import\b[^\n]*\b(?:radians|degrees)\b
      | \b9\.80665\b
      | \b180(?:\.0*)?\s*/\s*(?:(?:np|numpy|math)\.)?pi\b
      | \b(?:(?:np|numpy|math)\.)?pi\s*/\s*180(?:\.0*)?\b
    """,
    re.VERBOSE,
)


def code_only(text: str) -> str:
    """The text with comments and strings blanked, line by line; expressions inside f-strings count where tokenized."""
    lines = [list(line) for line in text.splitlines(keepends=True)]
    for token in tokens(text):
        if token.type not in (tokenize.COMMENT, tokenize.STRING):
            continue
        (row, column), (last_row, last_column) = token.start, token.end
        for k in range(row - 1, last_row):
            start = column if k == row - 1 else 0
            stop = last_column if k == last_row - 1 else len(lines[k])
            lines[k][start:stop] = [c if c == "\n" else " " for c in lines[k][start:stop]]
    return "".join("".join(line) for line in lines)


def conversions(text: str) -> list[str]:
    if not re.search(r"deg2rad|rad2deg|radians|degrees|9\.80665|180", text):
        return []
    code = code_only(text)
    return [f"line {code.count(chr(10), 0, m.start()) + 1}: {m.group().strip()}" for m in CONVERSION.finditer(code)]


def test_units_are_converted_only_at_the_edges():
    """Inside, every number is SI and every angle in radians: no degrees, no standard gravity."""
    inside = [p for p in MODULES if not is_an_edge(p)]
    check_each(inside, lambda path: conversions(source(path)))


@pytest.mark.parametrize(
    "line",
    ["x = np.deg2rad(y)", "x = np.radians(y)", "x = math.degrees(y)", "g = 9.80665", "x = y * np.pi / 180",
     "x = pi / 180.0", "x = y * 180.0 / np.pi", "x = 180 / math.pi", "from math import pi, radians",
     "from numpy import rad2deg", "x = y * 180./pi"],
)  # fmt: skip
def test_the_search_for_conversions_finds_them(line):
    assert conversions(f'"""np.radians is for the edges."""\n{line}  # 9.80665\n')


@pytest.mark.parametrize(
    "line", ["x = pi / 1800.0", "x = np.pi / 2", "x = 19.80665", "x = 'np.radians'", "# 180 / pi", "x = f(180) / 2"]
)
def test_the_search_for_conversions_finds_nothing_else(line):
    assert conversions(line + "\n") == []


@pytest.mark.parametrize(
    ("name", "edge"),
    [("units.py", True), ("sensors/sheets.py", True), ("recording/io/csv.py", True), ("recording/io/a/b.py", True),
     ("budget/report/html.py", True), ("recording/formats/csv.py", True), ("cli/__init__.py", True), ("cli.py", True),
     ("sensors/errors.py", False), ("recording/series.py", False), ("climate.py", False),
     ("earth.py", False), ("analysis/units.py", False)],
)  # fmt: skip
def test_the_edges_are_these_files(name, edge):
    assert is_an_edge(PACKAGE / name) is edge


# ----------------------------------------------------------------------------------------- suppressions


def bare_suppressions(text: str) -> list[str]:
    """Comments that switch off a checker without saying which of its findings."""
    if not re.search(r"type:\s*ignore|noqa|mypy:", text, re.IGNORECASE):
        return []
    problems = []
    for token in tokens(text):
        if token.type != tokenize.COMMENT:
            continue
        comment = token.string
        type_ignores = re.findall(r"#\s*type:\s*ignore(\S*)", comment)
        noqas = re.findall(r"#\s*noqa(.*)", comment, re.IGNORECASE)
        bad = any(not re.match(r"\[[\w-]+(?:,[\w-]+)*\]", rest) for rest in type_ignores)
        bad = bad or any(not re.match(r":\s*[A-Z]+\d+", rest) for rest in noqas)
        bad = bad or bool(re.search(r"#\s*(?:ruff|flake8):\s*noqa\s*$|#\s*mypy:\s*ignore-errors", comment))
        if bad:
            problems.append(f"line {token.start[0]}: {comment}")
    return problems


def test_every_suppression_names_what_it_suppresses():
    check_each(ALL_PYTHON, lambda path: bare_suppressions(source(path)))


@pytest.mark.parametrize(
    ("comment", "bad"),
    [
        ("# type: ignore", True),
        ("# type: ignore[arg-type]", False),
        ("# type: ignore[arg-type,misc]", False),
        ("# type: ignore []", True),
        ("# noqa", True),
        ("# NOQA", True),
        ("# noqa: E501", False),
        ("# noqa:E501,F401 because", False),
        ("# noqa: because", True),
        ("# ruff: noqa", True),
        ("# ruff: noqa: E501", False),
        ("# mypy: ignore-errors", True),
        ("# type: ignore[misc]  # noqa", True),
        ("# an ordinary remark", False),
    ],
)
def test_the_search_for_bare_suppressions_tells_them_apart(comment, bad):
    assert bool(bare_suppressions(f'x = "# noqa"  {comment}\n')) is bad


def test_settings_of_pytest_load_nothing_of_the_package():
    """A warning of a class of ours would: numpy then has threads on all cores before tests/conftest.py forbids it."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["pytest"]["ini_options"]
    assert not [line for line in settings["filterwarnings"] if "schuler" in line]
