"""Monte Carlo campaigns of any size: on all processors, on a cluster, interrupted and taken up again.

``campaign(function, scenario, runs)`` runs any function of a scenario and a seed; ``navigation_run`` is one that
simulates, navigates, and compares with the truth, for a job read by ``read_job``. See docs/monte-carlo.md.
"""

from schuler.analysis.montecarlo.campaign import campaign
from schuler.analysis.montecarlo.column import ColumnStatistics, Consistency
from schuler.analysis.montecarlo.functions import Traits, run_seed, traits
from schuler.analysis.montecarlo.result import Campaign
from schuler.analysis.montecarlo.rows import Rows
from schuler.analysis.montecarlo.statistics import Accumulator, Statistics
from schuler.analysis.montecarlo.store import read_manifest, read_rows

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
