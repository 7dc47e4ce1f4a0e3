"""Numbers of the README: every one stands in docs/validation.md, and its row names a command that exists."""

from __future__ import annotations

import re

import pytest
from places import DOCS, ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
VALIDATION = (DOCS / "validation.md").read_text(encoding="utf-8")
NUMBER = re.compile(r"\d+(?: \d{3})+|\d+(?:\.\d+)?(?:e-?\d+)?")
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in README[README.index("## Beside others") : README.index("## What it does today")].splitlines()
    if line.startswith("| ") and not line.startswith("| |")
]


#: Where the numbers of a row stand, by the beginning of the row: the first line of the page that begins so.
PEERS = ("| rtklibexplorer, causal", "| ... velocity matching in both", "| python-ins (position", "| KF-GINS (position")
LINES = {
    "INS/GNSS filter": (
        "| filter, 15 states, position",
        "Their own programs, built",
        "| KF-GINS f39bc2e",
        "| NaveGo 550d906",
    ),
    "strapdown alone": ("| strapdown, Earth-fixed, with its", "| gnss-ins-sim 966ff27"),
    "a real car": ("| schuler, causal", "| schuler, smoothed", *PEERS),
    "... with wheels": ("| schuler, causal", "| schuler, smoothed", "| rtklibexplorer, causal"),
    "... with the clock": ("| schuler, causal", "| schuler, smoothed"),
    "Allan deviations": ("Allan deviation of 4.32 million",),
    "a hand-held calibration": ("| Xsens by hand",),
    "reading a CSV log": ("| CSV, 7 columns",),
    "RINEX 3": ("RINEX observations:",),
}


def in_validation(number: str, page: str = VALIDATION) -> bool:
    return re.search(rf"(?<![\d.]){re.escape(number)}(?![\d.]*\d)", page) is not None


def lines_of(row: list[str]) -> str:
    """What validation has on the subject of a row, so that a like number elsewhere does not count."""
    (starts,) = (starts for start, starts in LINES.items() if row[0].startswith(start))
    page = VALIDATION.splitlines()
    return "\n".join(next(line for line in page if line.startswith(start)) for start in starts)


def numbers_of(row: list[str]) -> list[str]:
    return [n for cell in row[1:3] for n in NUMBER.findall(cell) if n not in ("21", "3")]  # states, RINEX 3


def test_the_table_is_there():
    assert len(ROWS) == 9
    assert all(len(row) == 4 for row in ROWS)


@pytest.mark.parametrize("row", ROWS, ids=[row[0][:40] for row in ROWS])
def test_every_number_stands_in_validation(row):
    missing = [n for n in numbers_of(row) if not in_validation(n, lines_of(row))]
    assert not missing, f"{row[0]}: {missing} not in its lines of docs/validation.md"


@pytest.mark.parametrize("row", ROWS, ids=[row[0][:40] for row in ROWS])
def test_every_row_names_a_command_that_exists(row):
    command = row[3].strip("`")
    if command == "the same":
        return
    if command.startswith("pytest "):
        assert (ROOT / command.split()[1]).is_file()
    else:
        assert command.startswith("python -m ")
        assert (ROOT / f"{command.split()[2].replace('.', '/')}.py").is_file()


def test_a_digit_that_is_changed_is_seen():
    """The last one of every number in the table, to every other: fewer than one change in thirty stands there, too."""
    changes = [(row, n, n[:-1] + d) for row in ROWS for n in numbers_of(row) for d in "0123456789" if d != n[-1]]
    missed = [(n, other) for row, n, other in changes if in_validation(other, lines_of(row))]
    assert len(changes) > 250
    assert 30 * len(missed) < len(changes), missed


def test_a_number_that_validation_does_not_have_is_seen():
    assert in_validation("4.73")
    assert not in_validation("4.7")
    assert not in_validation("4.74")


def test_numbers_outside_of_the_table():
    """The prose has few, each with what holds it; a new one is to be added here with its check."""
    from schuler.cli import demo
    from schuler.filtering.limits import MAX_STATES

    prose = README[: README.index("## Beside others")] + README[README.index("## What it does today") :]
    prose = re.sub(r"(?s)```.*?```|\]\([^)]*\)|`[^`]*`", "", prose)
    prose = re.sub(r"(?m)^\|.*", "", prose)  # sizes of extras, which change with every release of others
    pyproject = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    start, stop = demo._OUTAGE_S
    stated = {
        "3.11": 'requires-python = ">=3.11"' in pyproject, "40": stop - start == 40.0, "9": True,
        "0.5": True, "0.55": True,  # sizes likewise
        "96": MAX_STATES == 96, "4": "PX4" in prose, "3": "BSD-3" in prose,
    }  # fmt: skip
    assert {n for n in NUMBER.findall(prose) if n} == set(stated)
    assert all(stated.values()), stated


def test_what_validation_names_exists():
    """Tests, benchmarks and modules, each with its path from the root."""
    files = set(re.findall(r"`?((?:tests|benchmarks)/[\w/]+\.py)", VALIDATION))
    assert len(files) > 15
    assert not [name for name in files if not (ROOT / name).is_file()]
    assert not re.findall(r"`test_\w+\.py`", VALIDATION)
    for module in re.findall(r"python -m (benchmarks\.\w+)", VALIDATION):
        assert (ROOT / f"{module.replace('.', '/')}.py").is_file()


def test_formats_are_as_many_as_are_listed(capsys):
    """README and tutorial count what ``schuler info --formats`` lists."""
    from schuler.cli.info import known_formats

    count = len(known_formats().splitlines())
    assert f"a folder: {count} formats" in README
    assert f"in any of {count} formats" in (DOCS / "tutorial.md").read_text(encoding="utf-8")


@pytest.mark.campaign
@pytest.mark.realdata
@pytest.mark.parametrize(
    ("clock", "wheels", "causal", "smoothed"), [("derived", False, 4.73, 0.32), ("board", True, 1.82, 0.17)]
)
def test_the_car_is_what_the_readme_says(shared_data, clock, wheels, causal, smoothed):
    """Printed digits, and what other processors round differently over nine minutes of a filter: 3 %."""
    from benchmarks import car

    row = car.row(car.recordings(shared_data)[clock], clock, wheels, car.PUBLISHED)
    assert row.causal == pytest.approx(causal, rel=0.03)
    assert row.smoothed == pytest.approx(smoothed, rel=0.04)
    assert f"{causal} m" in README
    assert f"{smoothed} m" in README
