"""Toolkit of figures, tables and pages; it knows nothing of navigation."""
