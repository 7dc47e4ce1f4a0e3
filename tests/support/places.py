"""Folders of the checkout that tests read, and test modules whose results other tests look at."""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
TESTS = ROOT / "tests"
DOCS = ROOT / "docs"
EXAMPLES = ROOT / "examples"
DATA = Path(os.environ.get("SCHULER_DATA", ROOT.parent / "shared" / "data"))


def module(path: str) -> Any:
    """A test module, by its path below the tests: for the results it makes."""
    file = TESTS / path
    name = f"shared_{file.stem}"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, file)
        sys.modules[name] = importlib.util.module_from_spec(spec)
        sys.path.insert(0, str(file.parent))  # test modules of a folder import each other by name
        try:
            spec.loader.exec_module(sys.modules[name])
        finally:
            sys.path.remove(str(file.parent))
    return sys.modules[name]
