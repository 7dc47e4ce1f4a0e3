"""Monte Carlo campaigns of any size: on all processors, on a cluster, interrupted and taken up again.

``campaign(function, scenario, runs)`` runs any function of a scenario and a seed; ``navigation_run`` is one that
simulates, navigates, and compares with the truth, for a job read by ``read_job``. See docs/monte-carlo.md.
"""

from schuler.montecarlo.campaign import campaign
from schuler.montecarlo.column import ColumnStatistics, Consistency
from schuler.montecarlo.functions import Traits, run_seed, traits
from schuler.montecarlo.result import Campaign
from schuler.montecarlo.rows import Rows
from schuler.montecarlo.statistics import Accumulator, Statistics
from schuler.montecarlo.store import read_manifest, read_rows

__all__ = [
    "Accumulator",
    "Campaign",
    "ColumnStatistics",
    "Consistency",
    "Rows",
    "Statistics",
    "Traits",
    "campaign",
    "read_manifest",
    "read_rows",
    "run_seed",
    "traits",
]
