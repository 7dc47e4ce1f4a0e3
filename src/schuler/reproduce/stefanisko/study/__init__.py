"""Studies that only the thesis of Štefanisko (2015) needs: figure-eight, bias removal, tuning, signs of the filter."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
