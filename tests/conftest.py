"""Fixtures shared by all tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from places import DATA

SHARED_DATA = DATA


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of real recordings; the test skips, with the reason, where it is absent."""
    if not SHARED_DATA.is_dir():
        pytest.skip(f"real recordings are not here ({SHARED_DATA}); set SCHULER_DATA to their folder")
    return SHARED_DATA


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20151)
