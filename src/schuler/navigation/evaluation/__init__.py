"""Errors, consistency and outages of navigation solutions."""
