"""Growth of the errors of an unaided IMU: closed forms, and dead reckoning in the plane and in space."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
