"""Rests of a hand-rotated log as Tedaldi, Pretto and Menegatti (2014) look for them, beside the search of our own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.calibration.freepose.accel import magnitude_residuals, response, start_of
from schuler.calibration.freepose.gyro import pseudo_inverse
from schuler.calibration.freepose.rest import Rests, check_length, gaps_of, least_variance, rest_intervals, rests_of
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries

#: Multiples k of the variance magnitude at rest that are tried, those of imu_tk. The paper begins at 1, which half the
#: windows at rest exceed: rests fall apart or get lost, and the few that are left cost less. With 1 among them, it won
#: a quarter of 400 simulated logs, mostly with 12 to 19 of their 20 poses, once with too few to be solved.
MULTIPLES = tuple(float(k) for k in range(2, 11))
#: With fewer rests nine parameters fit them too well for a cost to tell anything.
ENOUGH = 12


def variance_magnitude(
    rates: ImuSeries, interval: float, initial_rest_s: float, window_s: float = 1.0
) -> tuple[FloatArray, FloatArray]:
    """Magnitude of the variances of specific force over a window around each sample, relative to that at rest.

    Parameters
    ----------
    rates : ImuSeries
        Rates in any unit.
    interval : float
        Of the samples. [s]
    initial_rest_s : float
        The log begins with so many seconds at rest. [s]
    window_s : float
        The window: the odd number of samples next to it, 101 at 100 Hz. [s]

    Returns
    -------
    ratio : ndarray, shape (n,)
        ``|(var f_x, var f_y, var f_z)|`` over that of the initial rest; infinite at both ends of the log, where no
        window has its centre. [-]
    at_rest : ndarray, shape (3,)
        Variances of the initial rest. [unit of the log^2]

    Raises
    ------
    InputError
        If the log is shorter than ten windows or the initial rest than one.

    References
    ----------
    Tedaldi, Pretto, Menegatti (2014), section on the static detector. Variances are over ``count - 1``. The variance
    at rest is never taken below what rounding makes, so that a log without noise has rests.
    """
    from schuler.calibration.freepose import _kernels as kernels

    n = len(rates)
    half = max(5, round(0.5 * window_s / interval)) if n > 1 else 5
    W = 2 * half + 1
    check_length(n, W, window_s)
    first = int(np.searchsorted(rates.t, rates.t[0] + initial_rest_s))
    if first < W:
        raise InputError(
            f"initial_rest_s: expected a window of {window_s:g} s or more, got {initial_rest_s:g} s ({first} samples)"
        )
    kernels.prepare_freepose()
    at_rest = np.maximum(rates.accel[:first].var(axis=0, ddof=1), least_variance(rates.accel, W))
    size = max(float(np.linalg.norm(at_rest)), 1e-300)
    parts = np.full((n, 3), np.inf)
    # the kernel divides sums of squares by 3 W sigma2; this makes it variances over count - 1
    kernels.moving_variance(rates.accel, W, np.full(3, (W - 1.0) / (3.0 * W) * size), parts)
    ratio = np.full(n, np.inf)
    ratio[half : n - half] = np.sqrt((parts[half : n - half] ** 2).sum(axis=1))
    return ratio, np.asarray(at_rest)


def tedaldi_rests(
    rates: ImuSeries,
    interval: float,
    gravity: float,
    initial_rest_s: float,
    *,
    factor: float | None = None,
    window_s: float = 1.0,
    min_s: float = 1.0,
) -> Rests:
    """Rests by the threshold, of nine, whose accelerometer calibration leaves the least cost.

    Parameters
    ----------
    rates : ImuSeries
        Rates in any unit.
    interval : float
        Of the samples. [s]
    gravity : float
        Local gravity. [m/s^2]
    initial_rest_s : float
        The log begins with so many seconds at rest. [s]
    factor : float, optional
        Of the accelerometers [m/s^2 per unit of the log]. None: found.
    window_s : float
        Of :func:`variance_magnitude`. [s]
    min_s : float
        Shortest rest, and what is used of each: so many seconds from its start. [s]

    Returns
    -------
    Rests
        ``index`` is whole rests, where turns begin and end; means, durations and noise are those of the samples used.
        ``margin`` is k, ``tried`` all that were tried; an infinite cost where nothing could be fitted.

    Raises
    ------
    InputError
        As :func:`variance_magnitude`.

    Notes
    -----
    A sample is at rest if its variance magnitude is below k times that of the initial rest, k = 2 ... 10. For each k
    nine parameters are fitted to all used samples alike, and the cost is half the sum of squares of what their
    calibrated magnitudes miss gravity by. The cost grows with the number of rests and says nothing with nine. So only
    k with twelve rests or more compete, and if there is none, k = 10 is taken, where rests do not fall apart; the
    source does not say so. Rests end at gaps of the log.

    Gyroscopes are not looked at: slow turns about the vertical pass for rests.

    References
    ----------
    Tedaldi, Pretto, Menegatti (2014), static detector and eq. (10). The multiple is one of the variance magnitude, not
    of its square or of a standard deviation: so the nine counts and costs that imu_tk prints for its own log come out.
    """
    ratio, _ = variance_magnitude(rates, interval, initial_rest_s, window_s)
    gaps = gaps_of(rates.t, interval)
    count = max(20, round(min_s / interval))
    spans: list[IntArray] = []
    tried: list[tuple[float, int, float]] = []
    for k in MULTIPLES:
        index = rest_intervals(rates.t, interval, gaps, ratio, k, 0.0)
        index = np.ascontiguousarray(index[np.diff(index, axis=1)[:, 0] >= count])
        spans.append(index)
        tried.append((k, len(index), _cost(rates.accel, index, count, gravity, factor)))
    enough = [i for i, (_, n, cost) in enumerate(tried) if n >= ENOUGH and np.isfinite(cost)]
    best = min(enough, key=lambda i: tried[i][2]) if enough else len(tried) - 1
    used = np.stack((spans[best][:, 0], spans[best][:, 0] + count), axis=1)
    rests = rests_of(rates, interval, np.ascontiguousarray(used), MULTIPLES[best])
    return replace(rests, index=spans[best], tried=tuple(tried))


def _cost(accel: FloatArray, index: IntArray, count: int, gravity: float, factor: float | None) -> float:
    """Half the sum of squares that the first ``count`` samples of each rest leave; infinite if nothing fits."""
    if len(index) < 9:
        return float("inf")
    y = np.stack([accel[a : a + count] for a in index[:, 0]])
    scale, p = start_of(y.mean(axis=1), gravity, factor)
    if p is None:
        return float("inf")
    y = scale * y.reshape(-1, 3)
    for _ in range(40):
        r, J, _ = magnitude_residuals(p, y, gravity)
        # einsum, not matrix products: a threaded library spends more on its threads at this size
        dp = -pseudo_inverse(np.einsum("ni,nj->ij", J, J)) @ np.einsum("ni,n->i", J, r)
        if not np.isfinite(p + dp).all() or abs(np.linalg.det(response(p + dp))) < 1e-9:
            break
        p = p + dp
        if float(np.abs(dp).max()) < 1e-9:
            return 0.5 * float((magnitude_residuals(p, y, gravity)[0] ** 2).sum())
    return float("inf")
