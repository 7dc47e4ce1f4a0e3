"""Diagnosis of a log by physics: what is wrong with it, on what evidence, how sure, and which option mends it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
