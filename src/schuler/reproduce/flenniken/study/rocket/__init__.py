"""Flenniken's rocket: where 54 errors put its computed impact, and which of them count."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
