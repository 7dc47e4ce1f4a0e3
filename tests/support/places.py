"""Folders of the checkout that tests read, and test modules whose results other tests look at."""

import importlib
import os
import sys
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[2]
TESTS = ROOT / "tests"
DOCS = ROOT / "docs"
EXAMPLES = ROOT / "examples"
DATA = Path(os.environ.get("SCHULER_DATA", ROOT.parent / "shared" / "data"))


def module(path: str) -> ModuleType:
    """A test module, by its path below the tests: for the cases and logs it makes."""
    if str(ROOT) not in sys.path:  # in a script; pytest has it
        sys.path.append(str(ROOT))
    return importlib.import_module(".".join(Path("tests", path).with_suffix("").parts))
