"""Solutions to report on."""

from solutions import everything, full, make_run, wild

__all__ = ["everything", "full", "make_run", "wild"]
