"""Solutions to report on, and pages without the megabyte of plotly."""

import pytest
from solutions import everything, full, make_run, wild

from schuler.calibration.report import document

__all__ = ["everything", "full", "make_run", "wild"]


@pytest.fixture(scope="module")
def small_script():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(document, "plotly_script", lambda: "/* plotly */")
        yield
