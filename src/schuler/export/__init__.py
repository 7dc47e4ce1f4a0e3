"""The filter of a configuration as source text for other computers.

:func:`filter_design` is the filter that a configuration describes, :func:`write_filter` writes it as C99 with a test
vector, :func:`simulated_run` makes a run to take one from.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
