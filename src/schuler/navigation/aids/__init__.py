"""Measurements of the filter other than GNSS solutions, from recordings and configurations."""
