from .attitudes import scenario as scenario
from .attitudes import study_attitudes as study_attitudes
from .multiposition import StudyCase as StudyCase
from .multiposition import StudyResult as StudyResult
from .multiposition import run_case as run_case
from .multiposition import scenario_grid as scenario_grid
from .multiposition import simulated_readings as simulated_readings
from .multiposition import sweep as sweep
from .outages import OutageGrid as OutageGrid
from .outages import outage_grid as outage_grid
from .tables import TableRow as TableRow
from .tables import table_rows as table_rows
from .walk import CartWalk as CartWalk
from .walk import cart_recording as cart_recording
from .walk import seeded_start as seeded_start

__all__ = [
    "CartWalk",
    "OutageGrid",
    "StudyCase",
    "StudyResult",
    "TableRow",
    "cart_recording",
    "outage_grid",
    "run_case",
    "scenario",
    "scenario_grid",
    "seeded_start",
    "simulated_readings",
    "study_attitudes",
    "sweep",
    "table_rows",
]
