"""Which noise is it around an averaging time: a fitted mixture, or the lag-1 autocorrelation.

Confidence bounds need to know it, because it decides how much the differences depend on each other. A mixture serves
every averaging time including the longest, where too few values are left for the autocorrelation.
"""

from __future__ import annotations

from math import pi

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.characterisation.structure import Differences, Mixture, dof
from schuler.sensors.noise import GaussMarkov, Process, RandomWalk, White

_LEAST_POINTS = 30  # of the lag-1 autocorrelation


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
    from scipy.optimize import nnls

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
        strength = nnls(a, variance * w)[0] / scale
        model = np.maximum(columns @ strength, np.maximum(1e-3 * variance, 1e-12))
    return tuple((float(s) * unit, part) for s, (part, _) in zip(strength, parts, strict=True) if s > 0.0)


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


def exponents(noise: Mixture, tau: FloatArray) -> FloatArray:
    """Local exponents ``d ln S / d ln f`` of a mixture at the frequencies 1 / (2 tau).

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
                total += strength * 2.0 * (2.0 * pi * g) ** 2 if kind == 2 else strength * g**kind
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
        found = lag1_exponent(X, int(m))
        if found is not None:
            last = float(np.clip(np.round(found), -4.0, 2.0))
        out[i] = last
    return out
