"""The tables and figures of five theses, each beside ours: what was printed, what comes out here, and why they differ.

One module a thesis, each a tuple ``ITEMS``; all computing is in the library below.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
