"""What a record of finite length makes of a Gauss-Markov bias: how far off the numbers read from it are."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite, log, sqrt

import numpy as np

from schuler.characterisation.correlation import expected_variance, mean_sigma
from schuler.exceptions import InputError
from schuler.sensors.noise import GaussMarkov

#: 20 000 (from T/tau = 200 on 6000) simulated records each of a Gauss-Markov process, mean removed, biased estimator of
#: the autocorrelation: T/tau; 5, 50 and 95 % of tau found over T; 5, 50 and 95 % of the standard deviation found over
#: sigma. Below the first row the process is a random walk, tau found / T does not depend on tau any more.
_RECORDS = np.array(
    [
        [0.1, 0.05111, 0.1249, 0.2166, 0.08499, 0.1529, 0.2984],
        [0.3, 0.04998, 0.1234, 0.2155, 0.1453, 0.2590, 0.5034],
        [1.0, 0.04835, 0.1166, 0.2106, 0.2612, 0.4493, 0.8172],
        [2.0, 0.04583, 0.1072, 0.2036, 0.3553, 0.5870, 1.0180],
        [3.0, 0.04286, 0.09886, 0.1954, 0.4214, 0.6715, 1.1090],
        [5.0, 0.03845, 0.0841, 0.1770, 0.5072, 0.7670, 1.1970],
        [7.0, 0.03548, 0.07342, 0.1597, 0.5660, 0.8202, 1.2130],
        [10.0, 0.03071, 0.06043, 0.1320, 0.6246, 0.8665, 1.2220],
        [15.0, 0.02547, 0.0467, 0.09983, 0.6850, 0.9068, 1.2050],
        [20.0, 0.02174, 0.03785, 0.07928, 0.7269, 0.9280, 1.1950],
        [30.0, 0.01696, 0.02776, 0.05225, 0.7754, 0.9520, 1.1720],
        [50.0, 0.01199, 0.01796, 0.0302, 0.8278, 0.9713, 1.1440],
        [100.0, 0.006972, 0.009435, 0.01379, 0.8780, 0.9846, 1.1060],
        [200.0, 0.003866, 0.004845, 0.006313, 0.9148, 0.9919, 1.0760],
        [500.0, 0.00171, 0.001977, 0.002319, 0.9463, 0.9967, 1.0490],
        [1000.0, 0.0008944, 0.0009936, 0.001115, 0.9618, 0.9981, 1.0360],
    ]
)
Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class FiniteRecord:
    """What a record of finite length makes of a Gauss-Markov bias, relative to the truth.

    Attributes
    ----------
    variance_ratio : float
        Expected sample variance over sigma^2.
    mean_sigma : float
        Standard deviation of the record's mean over sigma.
    sigma_ratio : (float, float, float)
        5, 50 and 95 % of the sample standard deviation over sigma.
    tau_ratio : (float, float, float)
        5, 50 and 95 % of the correlation time found over tau.
    """

    variance_ratio: float
    mean_sigma: float
    sigma_ratio: Triple
    tau_ratio: Triple


def finite_record(duration: float, tau: float) -> FiniteRecord:
    """Bias and spread of sample variance, mean and 1/e correlation time of a Gauss-Markov process.

    Parameters
    ----------
    duration : float
        Length of the record T. [s]
    tau : float
        True correlation time. [s]

    Returns
    -------
    FiniteRecord

    Raises
    ------
    InputError
        If one is not positive and finite.

    Notes
    -----
    With z = T/tau the mean has variance ``sigma^2 (2/z) (1 - (1 - exp(-z)) / z)``, and the sample variance about that
    mean is short of sigma^2 by as much. Both are exact. The percentiles have no closed form: they were simulated, good
    to 2 % between the simulated points, and are continued beyond them by the random-walk limit and by 1/sqrt(z).

    References
    ----------
    Flenniken (2005), sections 2.3 to 2.5 and appendix D, where neither is mentioned.
    """
    for name, value in (("duration", duration), ("tau", tau)):
        if not (isfinite(value) and value > 0.0):
            raise InputError(f"{name}: expected a positive time in seconds, got {value!r}")
    process, z = GaussMarkov(1.0, tau), duration / tau
    return FiniteRecord(
        expected_variance(process, duration),
        mean_sigma(process, duration),
        _percentiles(z, "sigma"),
        _percentiles(z, "tau"),
    )


def tau_interval(tau: float, duration: float) -> Triple:
    """True correlation times that go with a found one.

    Parameters
    ----------
    tau : float
        1/e of the autocorrelation. [s]
    duration : float
        Length of the record. [s]

    Returns
    -------
    (float, float, float)
        Those for which what was found is the 95, 50 and 5 % point: lower end of a 90 % interval, median, upper end.
        The latter two are infinite where a bias that never settles would give such a number too. [s]
    """
    z = np.geomspace(_RECORDS[0, 0], 1e6, 600)
    found = np.array([_percentiles(value, "tau") for value in z]) / z[:, None]  # over T; falls with z
    limits = []
    for share in found.T[::-1]:
        unbounded = tau / duration >= share[0]
        at = inf if unbounded else np.exp(np.interp(log(tau / duration), np.log(share[::-1]), np.log(z[::-1])))
        limits.append(inf if unbounded else duration / float(at))
    low, median, high = limits
    return min(low, duration), median, high


def sigma_interval(s: float, tau_low: float, tau_high: float, duration: float) -> tuple[float, float]:
    """True standard deviations that go with a found one, for every correlation time that is still possible.

    Parameters
    ----------
    s : float
        Standard deviation of the record. [x]
    tau_low, tau_high, duration : float
        [s]

    Returns
    -------
    (float, float)
        90 %, conservative; infinite above if tau_high is. [x]
    """
    # the 95 % point of the ratio is largest at T/tau = 10, the 5 % point grows throughout
    longest, shortest = duration / tau_high, duration / tau_low
    low = s / _percentiles(min(max(10.0, longest), shortest), "sigma")[2]
    return low, inf if longest == 0.0 else s / _percentiles(longest, "sigma")[0]


def _percentiles(z: float, which: str) -> Triple:
    """5, 50 and 95 % of the number found over the true one, at T/tau = z."""
    columns = slice(1, 4) if which == "tau" else slice(4, 7)
    grid, table = _RECORDS[:, 0], _RECORDS[:, columns]
    if which == "tau":
        table = table * grid[:, None]  # over tau instead of over T
    if z > grid[-1]:
        found = 1.0 + (table[-1] - 1.0) * sqrt(grid[-1] / z)
    elif z < grid[0]:
        found = table[0] * (z / grid[0] if which == "tau" else sqrt(z / grid[0]))
    else:
        found = np.exp([np.interp(log(z), np.log(grid), np.log(column)) for column in table.T])
    return float(found[0]), float(found[1]), float(found[2])
