"""A short drive with an outage, linearised once."""

import tomllib

import pytest
from places import EXAMPLES

from schuler.budget import prepare_budget


@pytest.fixture(scope="session")
def town():
    """The example's drive with an outage of a minute."""
    with (EXAMPLES / "budget_town.toml").open("rb") as file:
        return tomllib.load(file)


@pytest.fixture(scope="session")
def mission(town):
    return prepare_budget(town)
