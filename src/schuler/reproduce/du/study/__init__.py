"""Studies that only the thesis of Du (2015) needs: modulation, tests at rest and driving, turntable, GNSS."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
