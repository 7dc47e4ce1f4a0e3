"""Detection thresholds that follow the motion: what counts as a resting foot depends on how fast the person walks.

A foot on the ground is never quite at rest: the sole gives and rolls, the more the faster the walk. A threshold that
finds every stance of a run takes slow swings for rest, one made for a slow walk finds no stance of a run. Both
functions here work on any statistic of :mod:`schuler.standstill.detectors`.
"""

from __future__ import annotations

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray, as_floats
from schuler.exceptions import InputError
from schuler.standstill.detectors import moving_moments
from schuler.timebase import check_times


def by_motion(
    t: ArrayLike,
    statistic: ArrayLike,
    *,
    ratio: float = 0.01,
    cycle_s: float = 1.5,
    floor: float = 0.0,
    ceiling: float = np.inf,
) -> FloatArray:
    """Threshold as a share of the mean statistic over about one gait cycle around each sample.

    Parameters
    ----------
    t : array_like, shape (n,)
        [s]
    statistic : array_like, shape (n,)
        Dimensionless.
    ratio : float
        Share of the mean that a resting foot stays below.
    cycle_s : float
        Length of the centred window of the mean; one stride or a little more. [s]
    floor, ceiling : float
        Limits of the threshold. Without a floor a person who stands still for a cycle is never at rest: the
        statistic would be compared with itself.

    Returns
    -------
    ndarray, shape (n,)

    Raises
    ------
    InputError
        If a setting is out of range.

    Notes
    -----
    The statistics are mean squares, so a ratio ``rho`` says that rates (or accelerations) during stance stay below
    ``sqrt(rho)`` of their root mean square over a stride: a tenth for the default. Scaling the noise that the
    statistic is relative to changes nothing but the meaning of the floor. The mean statistic grows with speed and
    stride frequency, and the threshold with it. It needs half a cycle of data to come: near real time means a delay of
    that.

    References
    ----------
    Own formula; the dependence of the best threshold on gait speed is reviewed by Wahlstrom and Skog (2020), Fifteen
    years of progress at zero velocity, and is linear in the energy of the signals on the walks of docs/foot-mounted.md.
    """
    t, value = _checked(t, statistic)
    for name, number in (("ratio", ratio), ("cycle_s", cycle_s)):
        if not (np.isfinite(number) and number > 0.0):
            raise InputError(f"{name}: expected a positive number, got {number}")
    if not ratio < 1.0:
        raise InputError(f"ratio: expected a share below 1, got {ratio}; above it everything is rest")
    if not 0.0 <= floor <= ceiling:
        raise InputError(f"expected 0 <= floor <= ceiling, got {floor} and {ceiling}")
    step = float(np.median(np.diff(t))) if len(t) > 1 else cycle_s
    window = int(np.clip(round(cycle_s / step), 1, len(t)))
    return np.clip(ratio * moving_moments(value, window)[0], floor, ceiling)


def by_time_since_rest(
    t: ArrayLike, statistic: ArrayLike, *, growth: float, delay_s: float = 0.0, floor: float = 0.0
) -> tuple[FloatArray, BoolArray]:
    """Threshold that rises with the time since the last rest, and the rests found with it.

    Parameters
    ----------
    t : array_like, shape (n,)
        [s]
    statistic : array_like, shape (n,)
        Dimensionless.
    growth : float
        Rise of the threshold. [1/s]
    delay_s : float
        Time after a rest during which it does not rise yet. [s]
    floor : float
        Smallest threshold.

    Returns
    -------
    threshold : ndarray, shape (n,)
        ``max(floor, growth (t - t_rest - delay))``, t_rest the last sample found at rest before.
    rest : ndarray of bool, shape (n,)

    Raises
    ------
    InputError
        If a setting is out of range.

    Notes
    -----
    Decide for rest if the likelihood ratio exceeds ``eta = cost(false alarm) / cost(missed rest)``. With
    ``T = -(2/W) log(ratio)`` that is ``T < -(2/W) log(eta)``. A missed rest costs more the longer the errors have been
    growing: with ``eta = alpha exp(-theta dt)`` the threshold is linear in the time dt since the last rest,
    ``(2/W) (theta dt - log(alpha))``. ``growth`` is ``2 theta / W``, ``delay_s`` is ``log(alpha) / theta``. It is
    causal. Every stance gives only its quietest samples, since each one found lowers the threshold again.

    References
    ----------
    Wahlstrom, Skog, Gustafsson, Markham, Trigoni (2019), Zero-velocity detection - a Bayesian approach to adaptive
    thresholding: exponential cost of a missed detection. Departure: no prior from the velocity of the filter, so that
    detection does not depend on navigation.
    """
    t, value = _checked(t, statistic)
    if not (np.isfinite(growth) and growth > 0.0):
        raise InputError(f"growth: expected a positive rise per second, got {growth}")
    if not (delay_s >= 0.0 and floor >= 0.0):
        raise InputError(f"expected delay_s and floor of at least 0, got {delay_s} and {floor}")
    threshold, rest = np.empty(len(t)), np.zeros(len(t), dtype=bool)
    last = t[0] if len(t) else 0.0
    for k, (now, v) in enumerate(zip(t.tolist(), value.tolist(), strict=True)):
        limit = max(floor, growth * (now - last - delay_s))
        threshold[k] = limit
        if v < limit:
            rest[k] = True
            last = now
    return threshold, rest


def _checked(t: ArrayLike, statistic: ArrayLike) -> tuple[FloatArray, FloatArray]:
    t = check_times(t, "t")
    return t, as_floats(statistic, "statistic", (len(t),))
