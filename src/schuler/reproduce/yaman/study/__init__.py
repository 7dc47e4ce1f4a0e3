"""Studies that only the thesis of Yaman (2017) needs: campaigns of the field calibration, units at rest, drives."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
