from .alignment import Alignment as Alignment
from .alignment import gyrocompass as gyrocompass
from .alignment import heading_from_course as heading_from_course
from .alignment import levelling as levelling
from .strapdown import NavState as NavState
from .strapdown import derivative_ecef as derivative_ecef
from .strapdown import derivative_ned as derivative_ned
from .strapdown import mechanize as mechanize

__all__ = [
    "Alignment",
    "NavState",
    "derivative_ecef",
    "derivative_ned",
    "gyrocompass",
    "heading_from_course",
    "levelling",
    "mechanize",
]
