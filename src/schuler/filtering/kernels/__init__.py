"""Compiled text of the filter: propagation, updates, smoothing."""
