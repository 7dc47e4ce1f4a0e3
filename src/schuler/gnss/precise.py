"""Precise satellite orbits and clocks as tables over time, and their interpolation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.gnss.signals import SPEED_OF_LIGHT

POINTS = 11  # of an interpolating polynomial of degree 10; docs/gnss-files.md has the errors of others
_GAP = 1.5  # in steps, over which nothing is interpolated
_GM, _OMEGA = 3.986004418e14, 7.292115e-5  # of the ITRF [m^3/s^2], [rad/s]


@dataclass(frozen=True)
class PreciseOrbits:
    """Positions of satellites' centres of mass over time, and clocks if the file has them.

    Attributes
    ----------
    t : ndarray, shape (k,)
        GPS time since 1980-01-06, increasing. [s]
    sat : ndarray of int, shape (s,)
        Increasing.
    r_e : ndarray, shape (k, s, 3)
        Earth-fixed (ITRF); NaN where there is none. [m]
    clock : ndarray, shape (k, s)
        Satellite clock minus system time, for the combination of two frequencies without ionosphere, without the
        periodic relativistic term; NaN where there is none. [s]
    accuracy : ndarray, shape (s,)
        1-sigma as stated; NaN where it is not. [m]
    notes : tuple of str
    """

    t: FloatArray
    sat: IntArray
    r_e: FloatArray
    clock: FloatArray
    accuracy: FloatArray
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        k, s = len(self.t), len(self.sat)
        _check("PreciseOrbits", self.t, self.sat, {"r_e": (self.r_e, (k, s, 3)), "clock": (self.clock, (k, s)),
                                                   "accuracy": (self.accuracy, (s,))})  # fmt: skip

    def merged_with(self, other: PreciseOrbits) -> PreciseOrbits:
        """Epochs and satellites of both, such as two days; where both have a position this one's counts."""
        t, sat, rows = _axes(self, other)
        r_e = np.full((len(t), len(sat), 3), np.nan)
        clock, accuracy = np.full((len(t), len(sat)), np.nan), np.full(len(sat), np.nan)
        for part, (k, s) in zip((other, self), rows[::-1], strict=True):
            at = np.ix_(k, s)
            r_e[at] = np.where(np.isfinite(part.r_e), part.r_e, r_e[at])
            clock[at] = np.where(np.isfinite(part.clock), part.clock, clock[at])
            accuracy[s] = np.where(np.isfinite(part.accuracy), part.accuracy, accuracy[s])
        return PreciseOrbits(t, sat, r_e, clock, accuracy, self.notes + other.notes)


@dataclass(frozen=True)
class PreciseClocks:
    """Satellite clocks over time, denser than those of orbits.

    Attributes
    ----------
    t : ndarray, shape (k,)
        GPS time since 1980-01-06, increasing. [s]
    sat : ndarray of int, shape (s,)
        Increasing.
    clock : ndarray, shape (k, s)
        As in :class:`PreciseOrbits`. [s]
    notes : tuple of str
    """

    t: FloatArray
    sat: IntArray
    clock: FloatArray
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _check("PreciseClocks", self.t, self.sat, {"clock": (self.clock, (len(self.t), len(self.sat)))})

    def merged_with(self, other: PreciseClocks) -> PreciseClocks:
        """Epochs and satellites of both; where both have a clock this one's counts."""
        t, sat, rows = _axes(self, other)
        clock = np.full((len(t), len(sat)), np.nan)
        for part, (k, s) in zip((other, self), rows[::-1], strict=True):
            at = np.ix_(k, s)
            clock[at] = np.where(np.isfinite(part.clock), part.clock, clock[at])
        return PreciseClocks(t, sat, clock, self.notes + other.notes)


def precise_positions(
    orbits: PreciseOrbits, sat: IntArray, t: FloatArray, *, epoch_gps_s: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Positions and velocities of centres of mass by polynomials through the nearest eleven epochs.

    Parameters
    ----------
    orbits : PreciseOrbits
    sat : ndarray of int, shape (n,)
    t : ndarray, shape (n,)
        [s]
    epoch_gps_s : float
        GPS time of ``t = 0``; a double of seconds since 1980 resolves 1 mm of the orbit. [s]

    Returns
    -------
    r_e, v_e : ndarray, shape (n, 3)
        NaN outside of the file's times, over gaps, and for satellites that it does not have. [m], [m/s]

    Notes
    -----
    Positions are turned into the Earth's axes at ``t``, in which they are smooth over hours, interpolated by Neville's
    algorithm with its derivative, and the Earth's rotation is taken off the velocity.

    References
    ----------
    Press et al. (2007), Numerical Recipes, 3.2; Schenewerk (2003), A brief review of basic GPS orbit interpolation
    strategies, GPS Solutions 6, 265-267.
    """
    r_e, v_e = np.full((2, len(t), 3), np.nan)
    for one, rows in _by_satellite(orbits.sat, sat):
        good = np.flatnonzero(np.isfinite(orbits.r_e[:, one, 0]))
        if len(good) < POINTS:
            continue
        nodes, position = orbits.t[good] - epoch_gps_s, orbits.r_e[good, one]
        first = np.clip(np.searchsorted(nodes, t[rows]) - POINTS // 2, 0, len(nodes) - POINTS)
        window = first[:, None] + np.arange(POINTS)
        step = float(np.median(np.diff(nodes)))
        inside = (t[rows] >= nodes[0]) & (t[rows] <= nodes[-1])
        inside &= nodes[window[:, -1]] - nodes[first] < (POINTS - 2 + _GAP) * step
        rows, window = rows[inside], window[inside]
        tau = nodes[window] - t[rows, None]
        c, s = np.cos(_OMEGA * tau), np.sin(_OMEGA * tau)
        x, y, z = np.moveaxis(position[window], -1, 0)
        value = np.stack((c * x - s * y, s * x + c * y, z), axis=-1)
        r_e[rows], v = neville(tau, value)
        v_e[rows] = v - _OMEGA * np.stack((-r_e[rows, 1], r_e[rows, 0], np.zeros(len(rows))), axis=-1)
    return r_e, v_e


def neville(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Polynomials through points, and their derivatives, at x = 0. Shapes (n, p), (n, p, d) to (n, d), (n, d)."""
    p, slope = y, np.zeros_like(y)
    for m in range(1, x.shape[1]):
        low, high = x[:, :-m, None], x[:, m:, None]
        width = low - high
        slope = (p[:, :-1] - p[:, 1:] - high * slope[:, :-1] + low * slope[:, 1:]) / width
        p = (low * p[:, 1:] - high * p[:, :-1]) / width
    return p[:, 0], slope[:, 0]


def precise_clocks(
    orbits: PreciseOrbits, clocks: PreciseClocks | None, sat: IntArray, t: FloatArray, *, epoch_gps_s: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Clocks, straight between the two nearest epochs, and their rates, without the relativistic term.

    Parameters
    ----------
    orbits : PreciseOrbits
        Its clocks are used where ``clocks`` is None.
    clocks : PreciseClocks, optional
    sat, t, epoch_gps_s
        See :func:`precise_positions`.

    Returns
    -------
    clock, rate : ndarray, shape (n,)
        NaN outside of the times, over gaps, and for satellites that there are not. [s], [1]
    """
    table = orbits if clocks is None else clocks
    clock, rate = np.full((2, len(t)), np.nan)
    for one, rows in _by_satellite(table.sat, sat):
        good = np.flatnonzero(np.isfinite(table.clock[:, one]))
        if len(good) < 2:
            continue
        nodes, value = table.t[good] - epoch_gps_s, table.clock[good, one]
        k = np.clip(np.searchsorted(nodes, t[rows]) - 1, 0, len(nodes) - 2)
        width = nodes[k + 1] - nodes[k]
        inside = (t[rows] >= nodes[0]) & (t[rows] <= nodes[-1]) & (width < _GAP * float(np.median(np.diff(nodes))))
        rows, k, width = rows[inside], k[inside], width[inside]
        rate[rows] = (value[k + 1] - value[k]) / width
        clock[rows] = value[k] + rate[rows] * (t[rows] - nodes[k])
    return clock, rate


def relativistic_clock(r_e: FloatArray, v_e: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Periodic relativistic term ``-2 r . v / c^2`` of a clock in orbit, and its rate on a two-body orbit.

    Shapes (n, 3), (n, 3) to (n,), (n,). [s], [1]
    """
    c2 = SPEED_OF_LIGHT**2
    v_i = v_e + _OMEGA * np.stack((-r_e[:, 1], r_e[:, 0], np.zeros(len(r_e))), axis=-1)
    rate = -2.0 * (np.sum(v_i * v_i, axis=1) - _GM / np.linalg.norm(r_e, axis=1)) / c2
    return -2.0 * np.sum(r_e * v_e, axis=1) / c2, rate


def _by_satellite(own: IntArray, sat: IntArray) -> list[tuple[int, IntArray]]:
    """Columns of satellites that are asked for, with the rows that ask."""
    return [(k, np.flatnonzero(sat == one)) for k, one in enumerate(own.tolist()) if np.any(sat == one)]


def _axes(
    a: PreciseOrbits | PreciseClocks, b: PreciseOrbits | PreciseClocks
) -> tuple[FloatArray, IntArray, list[tuple[IntArray, IntArray]]]:
    t, sat = np.union1d(a.t, b.t), np.union1d(a.sat, b.sat)
    return t, sat, [(np.searchsorted(t, x.t), np.searchsorted(sat, x.sat)) for x in (a, b)]


def _check(name: str, t: FloatArray, sat: IntArray, arrays: dict[str, tuple[FloatArray, tuple[int, ...]]]) -> None:
    if np.any(np.diff(t) <= 0.0) or np.any(np.diff(sat) <= 0):
        raise InputError(f"{name}: expected increasing times and satellites")
    for field, (values, shape) in arrays.items():
        if values.shape != shape:
            raise InputError(f"{name}.{field}: expected shape {shape}, got {values.shape}")
