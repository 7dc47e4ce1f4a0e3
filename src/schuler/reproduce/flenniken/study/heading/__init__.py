"""Heading and position filters of two to six states: what a bias model is worth while GNSS is away."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
