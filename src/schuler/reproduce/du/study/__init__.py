"""Studies that only Du's thesis needs."""
