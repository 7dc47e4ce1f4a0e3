"""The register of features, docs/features.md: made of docs/register/*.toml by ``python tests/test_features.py``.

Every row of the five digests names what does it and the tests that prove it; every name is imported, every command is
asked for, every test is looked for. The numbers of rows are the digests'.
"""

import ast
import importlib
import tomllib
from pathlib import Path

import pytest
from places import ROOT

PAGE = ROOT / "docs" / "features.md"

#: Heading, and how many features the thesis has.
THESES = {
    "flenniken": ("Flenniken: IMU error models and error growth", 38),
    "yaman": ("Yaman: field calibration", 35),
    "du": ("Du: rotary INS", 32),
    "hayal": ("Hayal: static multi-position calibration", 28),
    "stefanisko": ("Štefanisko: INS/GNSS in the Earth frame", 36),
}

HEAD = """# Features

What the five theses ask for, where it is, and the tests that prove it. Names are to be imported, or commands to be
typed; `schuler reproduce` shows the items of the last column beside the printed numbers. Made from
`docs/register/*.toml` by `python tests/test_features.py`; a test imports every name, asks for every command and item,
and looks for every test.
"""


def rows_of(thesis: str) -> list[dict]:
    path = ROOT / "docs" / "register" / f"{thesis}.toml"
    return tomllib.loads(path.read_text(encoding="utf-8"))["features"]


def page() -> str:
    lines = [HEAD]
    for thesis, (heading, _) in THESES.items():
        lines += [f"## {heading}", "", "| Feature | What | Where | Tests | Reproduced |", "|---|---|---|---|---|"]
        for row in rows_of(thesis):
            where = ", ".join(f"`{name}`" for name in row.get("where", ())) or f"missing: {row['missing']}"
            tests = ", ".join(f"`{name.removeprefix('tests/')}`" for name in row.get("tests", ()))
            shows = ", ".join(row.get("shows", ()))
            lines.append(f"| {row['id']} | {row['what']} | {where} | {tests} | {shows} |")
        lines.append("")
    return "\n".join(lines)


def test_page_is_what_the_register_gives():
    assert PAGE.read_text(encoding="utf-8") == page(), "run python tests/test_features.py"


@pytest.mark.parametrize("thesis", THESES)
def test_every_feature_of_the_thesis_has_a_row(thesis):
    ids = [row["id"] for row in rows_of(thesis)]
    assert len(set(ids)) == len(ids) == THESES[thesis][1]
    assert [row["id"] for row in rows_of(thesis) if not row.get("where") or not row.get("tests")] == []


@pytest.mark.parametrize("thesis", THESES)
def test_every_name_is_there(thesis):
    commands = known_commands()
    for row in rows_of(thesis):
        for name in row["where"]:
            if name.startswith("schuler "):
                words = tuple(w for w in name.split()[1:] if not w.startswith("-"))
                assert words[:2] in commands or words[:1] in commands, f"{row['id']}: {name}"
            else:
                assert resolve(name) is not None, f"{row['id']}: {name}"


@pytest.mark.parametrize("thesis", THESES)
def test_every_test_is_there(thesis):
    for row in rows_of(thesis):
        for name in row["tests"]:
            file, _, function = name.partition("::")
            assert function.split("::")[-1] in functions_of(ROOT / file), f"{row['id']}: {name}"


@pytest.mark.parametrize("thesis", THESES)
def test_every_item_shown_is_reproduced(thesis):
    from schuler.reproduce.run import items_of

    names = {name for item in items_of(thesis) for name in (item.id, *item.also)}
    for row in rows_of(thesis):
        assert set(row.get("shows", ())) <= names, row["id"]


def known_commands() -> set[tuple[str, ...]]:
    from schuler.cli.app import COMMANDS, METHODS

    return {(name,) for name in COMMANDS} | {("calibrate", method) for method in METHODS}


def resolve(name: str) -> object:
    """A module, or something in one."""
    parts = name.split(".")
    for k in range(len(parts), 0, -1):
        try:
            thing: object = importlib.import_module(".".join(parts[:k]))
        except ModuleNotFoundError:
            continue
        for part in parts[k:]:
            thing = getattr(thing, part)
        return thing
    raise AssertionError(f"nothing is called {name}")


def functions_of(path: Path, _known: dict[Path, set[str]] = {}) -> set[str]:  # noqa: B006  read each file once
    if path not in _known:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        _known[path] = {node.name for node in ast.walk(tree) if isinstance(node, (ast.FunctionDef, ast.ClassDef))}
    return _known[path]


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    print(f"wrote {PAGE}")
