from .correlator import Correlator as Correlator
from .loops import ScalarLoops as ScalarLoops
from .loops import track as track
from .runs import ArchitectureRun as ArchitectureRun
from .runs import DeepOptions as DeepOptions
from .runs import deep_run as deep_run
from .runs import tight_run as tight_run
from .scene import DeepScene as DeepScene
from .scene import agile as agile
from .scene import calm as calm
from .scene import deep_scene as deep_scene
from .study import DeepStudy as DeepStudy
from .study import deep_study as deep_study
from .study import loop_shares as loop_shares

__all__ = [
    "ArchitectureRun",
    "Correlator",
    "DeepOptions",
    "DeepScene",
    "DeepStudy",
    "ScalarLoops",
    "agile",
    "calm",
    "deep_run",
    "deep_scene",
    "deep_study",
    "loop_shares",
    "tight_run",
    "track",
]
