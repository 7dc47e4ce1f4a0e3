"""Reports and figures of navigation solutions.

:func:`~schuler.report.document.navigation_report` writes one self-contained HTML page,
:func:`~schuler.report.figures.save_figures` PNG and SVG files, :mod:`schuler.report.figures` has one function for each.
"""

from __future__ import annotations

from schuler.report.document import navigation_report
from schuler.report.figures import overview, save_figures
from schuler.report.subject import Subject

__all__ = ["Subject", "navigation_report", "overview", "save_figures"]
