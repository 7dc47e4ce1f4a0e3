"""Studies that only Štefanisko's thesis needs."""
