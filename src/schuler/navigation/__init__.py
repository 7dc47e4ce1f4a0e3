"""Navigation of recordings: configuration, alignment, filter with aids, smoothing, evaluation and report.

:func:`navigate` runs a recording, :class:`Navigator` the same filter sample by sample, :func:`compare_architectures` a
recording with several couplings and aids. Foot-mounted runs: :mod:`schuler.navigation.foot`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
