"""Figures and pages of calibrations."""
