"""A short drive with an outage, linearised once."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from schuler.analysis.budget import prepare_budget

EXAMPLES = Path(__file__).parents[3] / "examples"


@pytest.fixture(scope="session")
def town():
    """The example's drive with an outage of a minute."""
    with (EXAMPLES / "budget_town.toml").open("rb") as file:
        return tomllib.load(file)


@pytest.fixture(scope="session")
def mission(town):
    return prepare_budget(town)
