from .grade_comparison import Overlay as Overlay
from .grade_comparison import overlay as overlay
from .tables import sensitivity_table as sensitivity_table

__all__ = [
    "Overlay",
    "overlay",
    "sensitivity_table",
]
