"""Foot-mounted inertial navigation: rests of the shoe, zero velocities, strides."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
