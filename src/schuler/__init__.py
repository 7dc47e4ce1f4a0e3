"""schuler: the Python workbench for inertial navigation.

Read a log, say what noise its sensors have, calibrate, navigate with and without GNSS, and get an honest answer with
its uncertainty. SI units and radians inside; conventions in docs/conventions.md.

The names below are the public surface, among them a function for every command; each is loaded when first used, so
importing the package costs nothing.
"""

from typing import Any

import lazy_loader

_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("schuler")
    return _public(name)
