"""Reports and figures of navigation solutions.

:func:`~schuler.navigation.report.document.navigation_report` writes one self-contained HTML page,
:func:`~schuler.navigation.report.figures.save_figures` PNG and SVG files, :mod:`schuler.plotting.drawing` has one
function for each.
"""

from __future__ import annotations

from schuler.navigation.report.document import navigation_report
from schuler.navigation.report.figures import overview, save_figures
from schuler.navigation.report.subject import Subject

__all__ = ["Subject", "navigation_report", "overview", "save_figures"]
