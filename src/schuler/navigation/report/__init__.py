"""Report and figures of navigation solutions.

:func:`navigation_report` writes one self-contained HTML page, :func:`save_figures` PNG and SVG files; each ``plot_``
function draws one figure.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
