"""Recordings as tables of other libraries."""
