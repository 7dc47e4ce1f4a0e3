"""Runs that other processes can import too, and count."""

import sys
from collections import Counter

import pytest
from places import TESTS

SUPPORT = TESTS / "support"


@pytest.fixture(autouse=True)
def importable(monkeypatch):
    """Processes that are started look for ``montecarlo_runs`` there; those that start afresh copy ``sys.path``."""
    monkeypatch.syspath_prepend(str(SUPPORT))
    monkeypatch.setenv("PYTHONPATH", str(SUPPORT))
    yield
    sys.modules.pop("montecarlo_runs", None)


@pytest.fixture
def executions(tmp_path):
    """File to which every run appends its number, and a function that counts them."""
    path = tmp_path / "executed.txt"
    path.touch()
    return path, lambda: Counter(int(line) for line in path.read_text().split())
