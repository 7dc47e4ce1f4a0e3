"""Deep coupling of GNSS and INS, simulated, beside tight coupling over conventional loops."""
