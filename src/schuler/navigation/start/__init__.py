"""Initial state of a run: alignment in the log, and what a calibration of the unit gives."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
