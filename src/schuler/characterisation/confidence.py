"""Confidence of Allan variances: noise around an averaging time, equivalent degrees of freedom, bounds."""

from __future__ import annotations

from collections.abc import Sequence
from math import floor, pi

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.characterisation.differences import Differences, Mixture, autocovariance, dof, shape_quantiles
from schuler.exceptions import InputError
from schuler.sensors.noise import GaussMarkov, Process, RandomWalk, White

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
_LEAST_POINTS = 30  # of the lag-1 autocorrelation


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


def total_dof(alpha: float, m: int, n: int) -> float:
    """Degrees of freedom of the total variance for an exponent from 0 to -2, by the tables.

    The tables hold for averaging times of many samples; below 32 they are scaled as the overlapping variance is.
    Greenhall, Howe and Percival, "Total variance, an estimator of long-term frequency stability", IEEE Trans. UFFC 46
    (1999) 1183.
    """
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
        The noise was fitted to this very record, see :func:`~schuler.characterisation.confidence.with_doubt`.

    Returns
    -------
    dof, low, high : ndarray, shape (k,)

    Notes
    -----
    Below 20 degrees of freedom the bounds come from the true distribution of the mean square for that noise
    (:func:`.differences.shape_quantiles`); above from chi-square, which is then within 0.9 % of probability (white
    noise; 0.5 % of flicker noise and random walk). Lists denser than one averaging time per octave are interpolated.
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
            freedom, chi_square = total_dof(float(alpha[i]), m, n), True
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


def fit_mixture(ms: IntArray, variance: FloatArray, n: int, dt: float) -> Mixture:
    """Non-negative mixture of noises whose Allan variance follows a measured one.

    Parts: quantisation, white noise, Gauss-Markov processes with correlation times in steps of a factor of 4, random
    walk. It is made to describe dependence between differences, not to be a sensor's model: several parts may stand for
    one physical process.

    Parameters
    ----------
    ms : ndarray of int, shape (k,)
        Averaging times in samples, about one per octave.
    variance : ndarray, shape (k,)
        Overlapping Allan variance. [x^2]
    n : int
        Samples.
    dt : float
        Sampling interval. [s]

    Returns
    -------
    sequence of (strength, exponent or process)
    """
    tau: FloatArray = ms.astype(np.float64) * dt
    times = 4.0 * dt * 4.0 ** np.arange(0, max(1.0, np.log(n / 8.0) / np.log(4.0)))
    parts: list[tuple[int | Process, FloatArray]] = [
        (2, np.asarray(6.0 / tau**2)),  # G of the power law is 2 at lag zero
        (White(1.0), np.asarray(1.0 / tau)),
        *((g := GaussMarkov(1.0, float(t)), g.allan_variance(tau)) for t in times),
        (RandomWalk(1.0), np.asarray(tau / 3.0)),
    ]
    columns = np.stack([c for _, c in parts], axis=1)
    scale = np.max(columns, axis=0)
    freedom = np.array([dof(Differences(2, int(m), n), ((1.0, 0),), dt) for m in ms])
    freedom = np.where(6 * ms > n, 1e-6, 1.0) * freedom  # the last values must not choose their own bounds
    unit = float(np.max(variance))
    if unit == 0.0:
        return ((1.0, White(1.0)),)
    variance = variance / unit
    model = np.maximum(variance, 1e-12)
    strength = np.zeros(len(parts))
    for _ in range(4):  # weights from the model, not the data: few degrees of freedom would pull it down
        w = np.sqrt(0.5 * freedom) / model
        a = columns / scale * w[:, None]
        strength = _non_negative(a, variance * w) / scale
        model = np.maximum(columns @ strength, np.maximum(1e-3 * variance, 1e-12))
    return tuple((float(s) * unit, part) for s, (part, _) in zip(strength, parts, strict=True) if s > 0.0)


def _non_negative(a: FloatArray, b: FloatArray) -> FloatArray:
    """Least squares with coefficients not below zero."""
    from scipy.optimize import lsq_linear, nnls

    try:
        return np.asarray(nnls(a, b)[0], dtype=np.float64)
    except RuntimeError:  # the active set goes round in circles where columns are nearly alike, in a pure random walk
        size = np.linalg.norm(a, axis=0)
        solution = lsq_linear(a / size, b, bounds=(0.0, np.inf), method="trf", tol=1e-12)
        return np.asarray(np.maximum(solution.x, 0.0) / size, dtype=np.float64)


def with_doubt(noise: Mixture, d: Differences, dt: float) -> Mixture:
    """A fitted mixture with the random walk that a record of this length cannot exclude.

    With few degrees of freedom the fit is as uncertain as the curve. If random walk takes over at a tenth of the record
    and happens to be weak in it, bounds from the fit alone contain the truth at a quarter of the record in 90 % of
    cases instead of 95 %. One part in ``dof`` of the variance is therefore added as random walk, at most a half; it
    costs 5 % in the width of the bounds of white noise there, and nothing where there are many degrees of freedom.
    """
    if d.n > 200 * d.m:
        return noise
    tau = d.m * dt
    variance = sum(
        s * float(kind.allan_variance(tau)) if isinstance(kind, Process) else s * 6.0 / tau**2 for s, kind in noise
    )
    walk = RandomWalk(1.0)
    share = min(0.5, 1.0 / dof(d, noise, dt))
    return (*noise, (share * variance / float(walk.allan_variance(tau)), walk))


def exponents(noise: Mixture, tau: FloatArray, dt: float) -> FloatArray:
    """Local exponents ``d ln S / d ln f`` of a mixture at the frequencies 1 / (2 tau).

    Quantisation, exponent 2, is that of samples ``dt`` apart [s]: an integral with white errors of variance 2 each.

    Returns
    -------
    ndarray
        Between 2 and -2.
    """
    f = 0.5 / tau
    step = 1.1

    def density(g: FloatArray) -> FloatArray:
        total = np.zeros_like(g)
        for strength, kind in noise:
            if isinstance(kind, int):
                total += strength * 2.0 * dt * (2.0 * pi * g) ** 2 if kind == 2 else strength * g**kind
            else:
                total += strength * kind.psd(g)
        return total

    return np.asarray(np.log(density(f * step) / density(f / step)) / (2.0 * np.log(step)))


def lag1_exponent(X: FloatArray, m: int) -> float | None:
    """Exponent of the dominant power law around m samples, from the lag-1 autocorrelation of the thinned integral.

    Parameters
    ----------
    X : ndarray, shape (n + 1,)
        Integral of the signal.
    m : int
        Averaging time in samples.

    Returns
    -------
    float or None
        Not rounded; about 2 to -4. None with fewer than 30 values or a constant signal.

    Notes
    -----
    The thinned integral, less its parabola (a drift is no noise), is differenced until its lag-1 autocorrelation
    r belongs to a stationary process; ``delta = r / (1 + r)`` is then half of minus the exponent that is left.

    References
    ----------
    Riley and Greenhall, "Power law noise identification using the lag 1 autocorrelation", EFTF 2004.
    """
    z = X[::m]
    if len(z) < _LEAST_POINTS:
        return None
    u = np.linspace(-1.0, 1.0, len(z))
    z = z - np.polynomial.polynomial.polyval(u, np.polynomial.polynomial.polyfit(u, z, 2))
    for differenced in range(4):
        z = z - np.mean(z)
        power = float(z @ z)
        if power <= 0.0:
            return None
        r = float(z[1:] @ z[:-1]) / power
        delta = r / (1.0 + r)
        if delta < 0.25 or differenced == 3:
            break
        z = np.diff(z)
    return 2.0 - 2.0 * (delta + differenced)


def lag1_exponents(X: FloatArray, ms: IntArray) -> FloatArray:
    """:func:`lag1_exponent` at several averaging times, rounded; where it cannot tell, the last one before.

    Returns
    -------
    ndarray
        Integers as floats, 2 to -4; 0 (white) as long as none could be told.
    """
    out = np.zeros(len(ms))
    last = 0.0
    for i, m in enumerate(ms):
        exponent = lag1_exponent(X, int(m))
        if exponent is not None:
            last = float(np.clip(np.round(exponent), -4.0, 2.0))
        out[i] = last
    return out
