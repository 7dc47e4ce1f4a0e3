"""Proposals: from files as people have them to a configuration that runs, each decision with its evidence.

:func:`propose` reads what is there, mends what physics proves to be wrong, and chooses IMU model, lever arm and aids.
What cannot be decided is an :class:`UndecidedError`. See docs/howto/from-a-folder-to-a-track.md.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
