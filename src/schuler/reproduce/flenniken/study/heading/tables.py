"""Numbers of Flenniken's chapter 4 and of the checks made for its digest, which ours stand beside."""

from __future__ import annotations

#: Times after the start of the outage at which errors are compared. [s]
AFTER_S = (30.0, 60.0, 120.0, 240.0)
#: RMS heading error [deg] after these times by (truth, filter), from an independent Monte Carlo of 4000 runs.
OUTAGE_DEG = {
    ("wandering", "constant, asleep"): (2.05, 4.04, 8.40, 18.2),
    ("wandering", "constant, walking"): (1.09, 2.55, 6.36, 15.9),
    ("wandering", "Gauss-Markov"): (1.07, 2.47, 5.93, 13.8),
    ("wandering", "both"): (1.09, 2.52, 6.23, 15.4),
    ("constant", "constant, asleep"): (0.31, 0.46, 0.72, 1.19),
    ("constant", "constant, walking"): (0.58, 1.04, 1.95, 3.76),
    ("constant", "Gauss-Markov"): (2.41, 7.33, 24.1, 79.7),
    ("constant", "both"): (0.56, 0.98, 1.75, 3.13),
    ("constant and wandering", "constant, asleep"): (2.04, 4.06, 8.5, 18.6),
    ("constant and wandering", "constant, walking"): (1.14, 2.63, 6.4, 15.9),
    ("constant and wandering", "Gauss-Markov"): (2.63, 7.74, 24.8, 80.9),
    ("constant and wandering", "both"): (1.13, 2.61, 6.3, 15.6),
}
#: 1-sigma of the filters themselves 240 s into the outage. [deg]
SIGMA_240_DEG = {"constant, asleep": 1.2, "constant, walking": 18.5, "Gauss-Markov": 13.9, "both": 15.6}
#: Steady bound of the Gauss-Markov filter with fixes of 0.2 deg each second: source's range, then after and before an
#: update as checked. [deg]
BOUND_DEG = {"consumer": ((0.1, 0.2), 0.112, 0.135), "tactical": ((0.015, 0.02), 0.0197, None)}
