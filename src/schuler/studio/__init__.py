"""The workbench in the browser: a local server whose pages call what the commands call.

``schuler studio`` starts it; see docs/studio.md. Pages hold no numerics, and all state is files of the folder.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
