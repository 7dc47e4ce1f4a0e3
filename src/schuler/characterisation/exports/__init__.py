"""Configuration of other programs from an identified noise model; see docs/noise-exports.md for every conversion."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
