"""Studies that only Flenniken's thesis needs."""
