"""Uncertainty of a mission, the errors to blame, the IMUs that are good enough: linear covariance, no data."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
