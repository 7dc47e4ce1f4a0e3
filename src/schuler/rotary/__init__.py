"""Rotating IMUs: schedules of rotation, encoders, mechanization, modulated errors, calibration, navigation, search."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
