"""Shares a simulated log."""

from __future__ import annotations

import filter_cases
import pytest


@pytest.fixture(scope="session")
def drive_case():
    return filter_cases.Case.of(filter_cases.drive(2.0), 120.0)
