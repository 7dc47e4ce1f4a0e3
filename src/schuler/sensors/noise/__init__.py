"""Random errors of a sensor: exact discrete generators with their spectra and Allan variances.

Everything here is a *rate-like* signal x (angular rate in rad/s or specific force in m/s^2) sampled every ``dt``. Over
an interval ``dt`` it adds ``x * dt`` to an increment, so white noise of root density N has standard deviation
``N / sqrt(dt)`` on a rate sample and ``N * sqrt(dt)`` on an increment. Spectra are two-sided: ``S(f)`` is defined for
negative and positive f and integrates to the variance over both.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
