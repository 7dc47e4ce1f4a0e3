"""Noise of a receiver's carriers as its satellites show it: from epoch to epoch, and what it weighs where it lasts."""

from __future__ import annotations

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.gnss.ranges import Ranges, predicted_ranges
from schuler.gnss.weighting import noise_scale

_FEWEST = 6  # satellites of a change: one displacement and one clock, and two over
_LONGEST_S = 3.0  # over which noise is taken to last; what drifts for longer is the walk
_ALIKE = 0.1  # correlation below which phases count as independent, and all beyond
_PAIRS = 300  # of epochs at each lag
_LAGS = 8
_LEAST_PAIRS = 30


def carrier_noise(ranges: Ranges, r_e: FloatArray, walk: float) -> tuple[float, float]:
    """1-sigma of the phase of a strong satellite overhead: of a change from epoch to epoch, and in averages.

    Parameters
    ----------
    ranges : Ranges
        With carrier phases.
    r_e : ndarray, shape (n, 3)
        Approximate antenna of each row, good to some ten metres. [m]
    walk : float
        Random walk of a phase within its arc, which is not counted. [m/sqrt(s)]

    Returns
    -------
    short, lasting : float
        White noise of ``short`` makes the changes from epoch to epoch that satellites show beside one displacement and
        one clock; white noise of ``lasting`` weighs in averages over many epochs what theirs does. [m]

    Raises
    ------
    InputError
        If fewer than thirty pairs of epochs have six satellites in common.

    Notes
    -----
    Reflections at a patch antenna or a hand last for a second or two. Of a phase whose covariance over k epochs is
    ``C(k)``, an average over many has the variance of white noise of ``C(0) + 2 sum C(k)``. Changes over k epochs have
    ``2 (C(0) - C(k))``, which levels out at ``2 C(0)`` within three seconds. Each is the median of pairs of epochs,
    which slips do not move; correlations count until the first below a tenth.
    """
    t, row = _by_epoch(ranges)
    dt = float(np.median(np.diff(t))) if len(t) > 1 else np.inf
    longest = max(1, int(_LONGEST_S / dt))
    lags = np.unique(np.round(np.geomspace(1.0, longest, _LAGS)).astype(np.int64))
    scale = noise_scale(ranges.elevation, ranges.cn0, "elevation+cn0")
    measured = {int(lag): _variance(ranges, r_e, scale, t, row, int(lag), lag * dt, walk) for lag in lags}
    finite = {lag: value for lag, value in measured.items() if np.isfinite(value)}
    if 1 not in finite:
        raise InputError(
            f'gnss.tight.carrier_sigma_m = "log" needs {_LEAST_PAIRS} pairs of epochs with carriers of {_FEWEST} '
            "satellites in common: give a number, 0.003 for a good antenna, 0.01 for a patch or a phone"
        )
    every = np.arange(1, max(finite) + 1)
    half = np.interp(every, list(finite), list(finite.values()))  # C(0) - C(k)
    level = float(np.mean(half[2 * len(half) // 3 :]))
    alike = (level - half) / level
    ends = np.flatnonzero(np.append(alike, 0.0) < _ALIKE)[0]
    short, lasting = half[0], level * (1.0 + 2.0 * np.sum(alike[:ends]))
    return float(np.sqrt(short)), float(np.sqrt(max(lasting, short)))


def _by_epoch(ranges: Ranges) -> tuple[FloatArray, IntArray]:
    """Epochs with carriers (m,), and the row of each satellite there, -1 where it has none (m, satellites)."""
    rows = np.flatnonzero(ranges.used & np.isfinite(ranges.carrier_range) & np.isfinite(ranges.r_sat_e).all(axis=1))
    t, epoch = np.unique(ranges.t[rows], return_inverse=True)
    sat, column = np.unique(ranges.sat[rows], return_inverse=True)
    table = np.full((len(t), len(sat)), -1, dtype=np.int64)
    table[epoch, column] = rows
    return t, table


def _variance(
    ranges: Ranges, r_e: FloatArray, scale: FloatArray, t: FloatArray, row: IntArray, lag: int, span: float, walk: float
) -> float:
    """Half the variance of changes over so many epochs, overhead, without the walk's; NaN of too few. [m^2]"""
    first = np.flatnonzero(np.abs(t[lag:] - t[:-lag] - span) < 0.3 * span / lag)
    values = []
    for k in first[:: max(1, len(first) // _PAIRS)]:
        a, b = row[k], row[k + lag]
        both = (a >= 0) & (b >= 0)
        a, b = a[both], b[both]
        a, b = a[ranges.arc[a] == ranges.arc[b]], b[ranges.arc[a] == ranges.arc[b]]
        if len(a) < _FEWEST:
            continue
        here = r_e[a[0]]
        before, _ = predicted_ranges(ranges.r_sat_e[a], np.tile(here, (len(a), 1)))
        now, gradient = predicted_ranges(ranges.r_sat_e[b], np.tile(here, (len(a), 1)))
        weight = 1.0 / np.hypot(scale[a], scale[b])
        y = (ranges.carrier_range[b] - now - ranges.carrier_range[a] + before) * weight
        Q, _ = np.linalg.qr(np.column_stack((gradient, np.ones(len(a)))) * weight[:, None])
        residual = y - Q @ (Q.T @ y)
        over = len(a) - 4
        middle = over * (1.0 - 2.0 / (9.0 * over)) ** 3  # median of a chi-square
        values.append(residual @ residual / middle - walk**2 * span * np.mean(weight**2))
    return max(float(np.median(values)), 1e-12) if len(values) >= _LEAST_PAIRS else np.nan
