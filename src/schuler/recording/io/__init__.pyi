from .dispatch import left_out as left_out
from .dispatch import read as read
from .dispatch import write as write
from .hints import ReadHints as ReadHints

__all__ = [
    "ReadHints",
    "left_out",
    "read",
    "write",
]
