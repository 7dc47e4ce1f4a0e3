"""Reading and writing recordings: the only place where units, axes, heights and time scales of others are converted."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
