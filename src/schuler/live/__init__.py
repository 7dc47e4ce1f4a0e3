"""Live navigation of a stream: the filter of a configuration, fed message by message as they come.

Messages of sensors and of the navigator: :mod:`schuler.live.messages`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
