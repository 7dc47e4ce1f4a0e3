"""Satellites: raw measurements, broadcast orbits, atmosphere, single-point positions, and what tight coupling needs."""
