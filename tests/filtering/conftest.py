"""Makes `cases` importable and shares its simulated log."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture(scope="session")
def drive_case():
    import cases

    return cases.Case.of(cases.drive(2.0), 120.0)
