"""Studies of the theses are marked ``reproduce``; what always runs is listed here."""

from pathlib import Path

import pytest

HERE = Path(__file__).parent
#: Files that always run: the frame, some items of every thesis, and studies that take less than a second.
ALWAYS = {
    "test_frame.py", "test_verdicts.py", "test_seeds.py", "du/test_accuracy.py", "du/test_analytic_tables.py",
    "du/test_rates.py",
    "flenniken/heading/test_linear.py", "flenniken/rocket/test_errors.py", "flenniken/rocket/test_trajectory.py",
    "stefanisko/test_generator.py", "stefanisko/test_sign_sets.py",
}  # fmt: skip
#: Tests of the files that run all items of a thesis, which do not run them.
COMPLETENESS = (
    "test_ids_are",
    "test_every_table_and_figure",
    "test_nothing_the",
    "test_everything_the",
    "test_printed",
)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    for item in items:
        if not item.path.is_relative_to(HERE) or item.path.relative_to(HERE).as_posix() in ALWAYS:
            continue
        if not (item.path.name == "test_items.py" and item.name.startswith(COMPLETENESS)):
            item.add_marker(pytest.mark.reproduce)
