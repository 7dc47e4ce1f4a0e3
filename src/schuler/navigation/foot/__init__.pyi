from .config import FootConfig as FootConfig
from .errors import WalkErrors as WalkErrors
from .errors import walk_errors as walk_errors
from .figures import save_foot_figures as save_foot_figures
from .rests import detect_rests as detect_rests
from .result import FootResult as FootResult
from .run import navigate_foot as navigate_foot
from .strides import Strides as Strides
from .strides import segment as segment

__all__ = [
    "FootConfig",
    "FootResult",
    "Strides",
    "WalkErrors",
    "detect_rests",
    "navigate_foot",
    "save_foot_figures",
    "segment",
    "walk_errors",
]
