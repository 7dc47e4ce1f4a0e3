"""Recordings made ready for the filter."""
