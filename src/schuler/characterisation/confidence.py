"""How well an Allan variance is known: equivalent degrees of freedom and confidence bounds for every averaging time."""

from __future__ import annotations

from collections.abc import Sequence
from math import floor

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.characterisation.noise_type import with_doubt
from schuler.characterisation.structure import Differences, Mixture, autocovariance, dof, shape_quantiles
from schuler.exceptions import InputError
from schuler.sensors.noise import Process

#: Order of the differences of the integral, starts at every sample, integral averaged first.
KINDS: dict[str, tuple[int, bool, bool]] = {
    "overlapping": (2, True, False),
    "non-overlapping": (2, False, False),
    "modified": (2, True, True),
    "time": (2, True, True),
    "hadamard": (3, False, False),
    "overlapping hadamard": (3, True, False),
    "total": (2, True, False),
}
_CHI_SQUARE_FROM = 20.0  # degrees of freedom from which chi-square is close enough to the true distribution
# Greenhall, Howe and Percival (1999), tables I and II: total variance for alpha = 0, -1, -2
_TOTAL_ALPHA = np.array([-2.0, -1.0, 0.0])
_TOTAL_BIAS = np.array([0.75, 1.0 / (3.0 * np.log(2.0)), 0.0])
_TOTAL_B = np.array([0.927, 1.168, 1.5])
_TOTAL_C = np.array([0.358, 0.222, 0.0])


def differences(kind: str, m: int, n: int) -> Differences:
    """The differences a kind of variance is made of, at an averaging time of m of n samples.

    Raises
    ------
    InputError
        If the kind is unknown.
    """
    if kind not in KINDS:
        raise InputError(f"kind: expected one of {', '.join(KINDS)}, got {kind!r}")
    order, overlapping, modified = KINDS[kind]
    return Differences(order, m, n, overlapping, modified)


def power_law(alpha: float, d: Differences) -> Mixture:
    """Noise of exponent alpha as the differences ``d`` see it; between integers the two neighbours share the variance.

    Beyond what the differences can bear (-2 for Allan, -4 for Hadamard) it is the last exponent they can.
    """
    alpha = float(np.clip(alpha, -2.0 if d.order == 2 else -4.0, 2.0))
    below = min(floor(alpha), 1)
    parts = []
    for exponent, share in ((below, below + 1.0 - alpha), (below + 1, alpha - below)):
        if share > 0.0:
            variance = autocovariance(d, ((1.0, exponent),), 1.0, np.zeros(1))[0]
            parts.append((share / float(variance), exponent))
    return tuple(parts)


def equivalent_dof(kind: str, alpha: float, m: int, n: int) -> float:
    """Equivalent degrees of freedom of a variance for pure power-law noise.

    Parameters
    ----------
    kind : str
        As in :func:`~schuler.characterisation.allan.allan_deviation`.
    alpha : float
        Exponent of the spectrum of the rate-like signal: 2 quantisation, 0 white, -1 flicker, -2 random walk, down to
        -4 for the Hadamard variances.
    m : int
        Averaging time in samples.
    n : int
        Samples.

    Returns
    -------
    float
        At least 1. The variance of the variance is ``2 / dof`` of its square.

    Raises
    ------
    InputError
        If there is not one difference, or the kind is unknown.

    Notes
    -----
    Greenhall and Riley's algorithm, with the sum over lags carried out instead of fitted; flicker noise is summed over
    eight averaging times where they stop at three, which takes off up to 1 %. Total variance: their tables for alpha
    from 0 to -2; above 0, where none exist, the overlapping variance's.

    References
    ----------
    Greenhall and Riley (2003); Greenhall, Howe and Percival, "Total variance, an estimator of long-term frequency
    stability", IEEE Trans. UFFC 46 (1999) 1183.
    """
    d = differences(kind, m, n)
    if d.count < 1:
        raise InputError(f"m: expected an averaging time with at least one difference, got {m} of {n} samples")
    if kind == "total" and alpha < 0.5:
        return _total_dof(alpha, m, n)
    return dof(d, power_law(alpha, d), 1.0)


def _total_dof(alpha: float, m: int, n: int) -> float:
    """By the tables, which hold for averaging times of many samples; for few, less, as the overlapping variance has."""
    b = float(np.interp(alpha, _TOTAL_ALPHA, _TOTAL_B))
    c = float(np.interp(alpha, _TOTAL_ALPHA, _TOTAL_C))
    share = 1.0
    if m < 32:
        short, long = (Differences(2, k, 60 * k) for k in (m, 256))
        share = dof(short, power_law(alpha, short), 1.0) / dof(long, power_law(alpha, long), 1.0)
    return max(1.0, share * b * n / m - c)


def total_bias(alpha: float, m: int, n: int) -> float:
    """Expected total variance relative to the Allan variance: ``1 - a m / n``.

    ``a`` is 0 for white noise, 0.481 for flicker, 0.75 for random walk, in between linear in the exponent.
    """
    return 1.0 - float(np.interp(alpha, _TOTAL_ALPHA, _TOTAL_BIAS)) * m / n


def bounds(
    kind: str,
    ms: IntArray,
    ns: IntArray,
    noise: Mixture | FloatArray,
    alpha: FloatArray,
    dt: float,
    confidence: float,
    fitted: bool = False,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Degrees of freedom, and what to multiply the estimated variance by for the lower and upper bound of the true one.

    Parameters
    ----------
    kind : str
    ms, ns : ndarray of int, shape (k,)
        Averaging times in samples, and samples of a record without gaps that has as many differences.
    noise : mixture or ndarray
        The noise, or its exponent at each averaging time.
    alpha : ndarray, shape (k,)
        Exponents, for the total variance.
    dt : float
        Sampling interval. [s]
    confidence : float
        Between 0 and 1.
    fitted : bool
        The noise was fitted to this very record, see :func:`~schuler.characterisation.noise_type.with_doubt`.

    Returns
    -------
    dof, low, high : ndarray, shape (k,)

    Notes
    -----
    Below 20 degrees of freedom the bounds come from the true distribution of the mean square for that noise
    (:func:`~schuler.characterisation.structure.shape_quantiles`); above from chi-square, which is then within 0.5 % of
    probability. Lists denser than one averaging time per octave are interpolated.
    """
    from scipy.special import chdtri

    p = np.array([0.5 * (1.0 - confidence), 0.5 * (1.0 + confidence)])
    nodes = _nodes(ms, int(ns[-1]))
    table = np.empty((3, len(nodes)))
    for column, i in enumerate(nodes):
        m, n = int(ms[i]), int(ns[i])
        d = differences(kind, m, n)
        mixture = power_law(float(noise[i]), d) if isinstance(noise, np.ndarray) else noise
        if fitted:
            mixture = with_doubt(mixture, d, dt)
        if kind == "total" and alpha[i] < 0.5:
            freedom, chi_square = _total_dof(float(alpha[i]), m, n), True
        else:
            freedom = dof(d, mixture, dt)
            chi_square = freedom > _CHI_SQUARE_FROM
        q = chdtri(freedom, 1.0 - p) / freedom if chi_square else shape_quantiles(d, mixture, dt, p)
        table[:, column] = freedom, 1.0 / q[1], 1.0 / q[0]
    if len(nodes) == len(ms):
        return table[0], table[1], table[2]
    at, x = np.log(ms.astype(np.float64)), np.log(ms[nodes].astype(np.float64))
    return tuple(np.exp(np.interp(at, x, np.log(row))) for row in table)  # type: ignore[return-value]


def _nodes(ms: IntArray, n: int) -> Sequence[int]:
    """Which averaging times are computed: all of a sparse list, octaves of a dense one, more near its end."""
    chosen = [len(ms) - 1]
    for i in range(len(ms) - 2, -1, -1):
        m, next_m = int(ms[i]), int(ms[chosen[-1]])
        step = 1.1 if 6 * m > n else 1.3 if 40 * m > n else 1.9
        if next_m >= m * step or i == 0:
            chosen.append(i)
    return chosen[::-1]


def slopes(process: Process, tau: FloatArray) -> FloatArray:
    """Local exponents of a process's spectrum at the frequencies 1 / (2 tau)."""
    f, step = 0.5 / tau, 1.1
    return np.asarray(np.log(process.psd(f * step) / process.psd(f / step)) / (2.0 * np.log(step)))
