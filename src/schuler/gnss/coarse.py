"""A rough idea of where the receiver is and what its clock shows: enough for elevations, atmosphere and clock jumps."""

from __future__ import annotations

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, IntArray
from schuler.frames import C_en, llh_from_ecef
from schuler.gnss.ranges import sagnac

OMEGA_IE = 7.2921151467e-5  # GPS and Galileo; BeiDou's and GLONASS's 7.292115e-5 changes a range by 1 um [rad/s]
SPACING_S = 10.0  # a track needs no more: 3 km at the speed of an airliner [s]
MOST_FIXES = 500
_GROSS = 1_000.0  # residuals above this are not of orbits, clocks or atmosphere [m]
_LOWEST, _HIGHEST = -2e3, 5e4  # heights of receivers [m]


def directions(r_e: ArrayLike, r_sat_e: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Elevation and azimuth of satellites.

    Parameters
    ----------
    r_e : array_like, shape (3,) or (n, 3)
        Receiver. [m]
    r_sat_e : array_like, shape (n, 3)
        Satellites. [m]

    Returns
    -------
    elevation, azimuth : ndarray, shape (n,)
        Above the ellipsoid's tangent plane; from north over east, in (-pi, pi]. [rad]
    """
    r = np.asarray(r_e, dtype=np.float64)
    d = np.asarray(r_sat_e, dtype=np.float64) - r
    north, east, down = np.moveaxis(np.einsum("...ji,...j->...i", C_en(llh_from_ecef(r)), d), -1, 0)
    return np.arctan2(-down, np.hypot(north, east)), np.arctan2(east, north)


def coarse_track(t: FloatArray, pseudorange: FloatArray, r_sat_e: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Positions every ten seconds or so, by unweighted least squares from the Earth's centre.

    Parameters
    ----------
    t : ndarray, shape (n,)
        In order; rows of one epoch have equal times. [s]
    pseudorange : ndarray, shape (n,)
        With the satellites' clocks taken out; all finite. One receiver clock is assumed for all systems, whose
        differences (100 m) do not matter here. [m]
    r_sat_e : ndarray, shape (n, 3)
        [m]

    Returns
    -------
    t_fix : ndarray, shape (k,)
        Possibly empty. [s]
    r_fix : ndarray, shape (k, 3)
        Good to some 100 m. [m]

    Notes
    -----
    Where there are six satellites, gross errors are found: the satellite without which the others agree best goes,
    until all residuals are below 1 km.
    Epochs that keep larger ones, or end up below the ground or above 50 km, are left out.
    """
    starts = np.flatnonzero(np.append(True, np.diff(t) > 0.0)) if len(t) else np.zeros(0, dtype=np.int64)
    ends = np.append(starts[1:], len(t))
    rich = ends - starts >= 4
    starts, ends = starts[rich], ends[rich]
    if not len(starts):
        return np.zeros(0), np.zeros((0, 3))
    spacing = max(SPACING_S, (t[starts[-1]] - t[starts[0]]) / MOST_FIXES)
    times, fixes = [], []
    done = -np.inf
    for a, b in zip(starts, ends, strict=True):
        if t[a] < done + spacing:
            continue
        fix = _fix(pseudorange[a:b], r_sat_e[a:b])
        if fix is not None:
            times.append(t[a])
            fixes.append(fix)
            done = t[a]
    return np.array(times), np.array(fixes).reshape(-1, 3)


def along_track(t: FloatArray, t_fix: FloatArray, r_fix: FloatArray) -> FloatArray:
    """Positions at given times, straight between the fixes and held outside. Shape (n, 3). [m]"""
    return np.stack([np.interp(t, t_fix, r_fix[:, i]) for i in range(3)], axis=-1)


def geometric_ranges(r_sat_e: FloatArray, r_e: FloatArray) -> FloatArray:
    """Distance plus Sagnac term. Shapes (n, 3) to (n,). [m]"""
    return np.asarray(np.linalg.norm(r_sat_e - r_e, axis=-1) + sagnac(r_sat_e, r_e, OMEGA_IE))


def epoch_medians(epoch: IntArray, value: FloatArray, epochs: int) -> FloatArray:
    """Median of the finite values of each epoch, NaN where there are none. Shapes (n,), (n,) to (epochs,)."""
    good = np.isfinite(value)
    epoch, value = epoch[good], value[good]
    order = np.lexsort((value, epoch))
    epoch, value = epoch[order], value[order]
    count = np.bincount(epoch, minlength=epochs)
    start = np.cumsum(count) - count
    medians = np.full(epochs, np.nan)
    some = count > 0
    low, high = start[some] + (count[some] - 1) // 2, start[some] + count[some] // 2
    medians[some] = 0.5 * (value[low] + value[high])
    return medians


def _fix(pseudorange: FloatArray, r_sat_e: FloatArray) -> FloatArray | None:
    x, residual = _least_squares(pseudorange, r_sat_e)
    while not residual < _GROSS:
        if len(pseudorange) < 6:
            return None
        # without which one does the rest agree best: a large error need not have the largest residual
        without = [np.arange(len(pseudorange)) != i for i in range(len(pseudorange))]
        fixes = [_least_squares(pseudorange[keep], r_sat_e[keep]) for keep in without]
        best = int(np.argmin([one[1] for one in fixes]))
        if not np.isfinite(fixes[best][1]):
            return None
        pseudorange, r_sat_e = pseudorange[without[best]], r_sat_e[without[best]]
        x, residual = fixes[best]
    return x if x is not None and _LOWEST < llh_from_ecef(x)[2] < _HIGHEST else None


def _least_squares(pseudorange: FloatArray, r_sat_e: FloatArray) -> tuple[FloatArray | None, float]:
    """Position and its largest residual; infinite if the steps do not settle."""
    x, clock = np.zeros(3), 0.0
    for _ in range(12):
        d = r_sat_e - x
        distance = np.linalg.norm(d, axis=1)
        residual = pseudorange - distance - sagnac(r_sat_e, x, OMEGA_IE) - clock
        H = np.column_stack((-d / distance[:, None], np.ones(len(d))))
        step, _, rank, _ = np.linalg.lstsq(H, residual, rcond=1e-9)
        if rank < 4 or not np.isfinite(step).all():
            return None, np.inf
        x, clock = x + step[:3], clock + step[3]
        if np.linalg.norm(step[:3]) < 1.0:
            left = pseudorange - geometric_ranges(r_sat_e, x[None, :]) - clock
            return x, float(np.max(np.abs(left)))
    return None, np.inf
