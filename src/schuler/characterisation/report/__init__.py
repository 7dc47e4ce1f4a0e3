"""Figures and pages of noise identification."""
