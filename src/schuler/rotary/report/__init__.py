"""Figures and page of rotary studies."""
