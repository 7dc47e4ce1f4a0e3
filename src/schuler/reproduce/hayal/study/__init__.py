"""Studies that only the thesis of Hayal (2010) needs: simulated attitudes, calibrations, and a walk with outages."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
