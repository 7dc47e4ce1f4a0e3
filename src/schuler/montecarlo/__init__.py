"""Monte Carlo campaigns of any size: on all processors, on a cluster, interrupted and taken up again.

``campaign(function, scenario, runs)`` runs any function of a scenario and a seed; ``navigation_run`` is one that
simulates, navigates, and compares with the truth, for a job read by ``read_job``. See docs/monte-carlo.md.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
