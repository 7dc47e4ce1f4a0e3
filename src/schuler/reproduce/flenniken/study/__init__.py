"""Studies that only the thesis of Flenniken (2005) needs: heading filters, a rocket, sensors beside their models."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
