from .column import ColumnStatistics as ColumnStatistics
from .column import Consistency as Consistency
from .engine import campaign as campaign
from .error_scatter import Scatter as Scatter
from .error_scatter import scatter as scatter
from .functions import Traits as Traits
from .functions import run_seed as run_seed
from .functions import traits as traits
from .job import CampaignFile as CampaignFile
from .job import NavigationJob as NavigationJob
from .job import read_job as read_job
from .navigation import lane_runs as lane_runs
from .navigation import navigation_run as navigation_run
from .navigation import runner as runner
from .result import Campaign as Campaign
from .rows import Rows as Rows
from .statistics import Accumulator as Accumulator
from .statistics import Statistics as Statistics
from .store import read_manifest as read_manifest
from .store import read_rows as read_rows

__all__ = [
    "Accumulator",
    "Campaign",
    "CampaignFile",
    "ColumnStatistics",
    "Consistency",
    "NavigationJob",
    "Rows",
    "Scatter",
    "Statistics",
    "Traits",
    "campaign",
    "lane_runs",
    "navigation_run",
    "read_job",
    "read_manifest",
    "read_rows",
    "run_seed",
    "runner",
    "scatter",
    "traits",
]
