"""How uncertain a mission will be, which error is to blame, which IMU is good enough: linear covariance, no data."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
