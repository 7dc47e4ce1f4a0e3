"""Detection of rest: test statistics of a moving window, their thresholds, and the intervals at rest of a log.

:func:`static_intervals` finds the rests of a log in SI units, :func:`field_rests` those of a log that was turned by
hand, :func:`unscaled_rests` those of a log in unknown units, :class:`LiveRests` those of a growing log.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
