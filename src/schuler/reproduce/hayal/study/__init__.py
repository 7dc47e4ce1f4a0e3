"""Studies that only Hayal's thesis needs."""
