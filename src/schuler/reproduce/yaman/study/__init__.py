"""Studies that only Yaman's thesis needs."""
