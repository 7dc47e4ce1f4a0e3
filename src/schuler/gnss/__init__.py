"""Satellites: raw measurements, broadcast orbits, atmosphere, single-point positions, and what tight coupling needs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
