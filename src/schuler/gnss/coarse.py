"""A rough idea of where the receiver is and what its clock shows: enough for elevations, atmosphere and clock jumps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray, as_floats
from schuler.exceptions import InputError
from schuler.frames import C_en, llh_from_ecef
from schuler.gnss.ranges import sagnac

OMEGA_IE = 7.2921151467e-5  # GPS and Galileo; BeiDou's and GLONASS's 7.292115e-5 changes a range by 1 um [rad/s]
SPACING_S = 10.0  # a track needs no more: 3 km at the speed of an airliner [s]
_EARLY = 1e-3  # of a spacing: an epoch at its beginning may be stamped so much before
MOST_FIXES = 500
_GROSS = 1_000.0  # residuals above this are not of orbits, clocks or atmosphere [m]
_PATIENCE = 10  # epochs in a row without a fix, before some are passed over
_LOWEST, _HIGHEST = -2e3, 5e4  # heights of receivers [m]
_ABOVE_CENTRE = 6.0e6  # [m]


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

    One of every ten seconds of the clock, so that they do not depend on where a log begins.

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
    Epochs that keep larger ones, or end up below the ground or above 50 km, are left out. From the tenth in a row on
    ever more of the following ones are passed over: a log with wrong times has none, and each is a search of its own.
    """
    starts = np.flatnonzero(np.append(True, np.diff(t) > 0.0)) if len(t) else np.zeros(0, dtype=np.int64)
    ends = np.append(starts[1:], len(t))
    rich = ends - starts >= 4
    starts, ends = starts[rich], ends[rich]
    if not len(starts):
        return np.zeros(0), np.zeros((0, 3))
    spacing = max(SPACING_S, (t[starts[-1]] - t[starts[0]]) / MOST_FIXES)
    part = np.floor(t[starts] / spacing + _EARLY)
    times, fixes = [], []
    done, failures, passed = -np.inf, 0, 0
    for a, b, number in zip(starts, ends, part, strict=True):
        if number == done:
            continue
        if passed < failures - _PATIENCE:
            passed += 1
            continue
        fix = _fix(pseudorange[a:b], r_sat_e[a:b])
        failures, passed = 0 if fix is not None else failures + 1, 0
        if fix is not None:
            times.append(t[a])
            fixes.append(fix)
            done = number
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


@dataclass(frozen=True)
class ReceiverPlace:
    """One row for each measurement.

    Attributes
    ----------
    r_e : ndarray, shape (n, 3)
        Good to about 1 km, which changes an elevation by 10 arcsec; NaN if ``located`` is false. [m]
    elevation, azimuth : ndarray, shape (n,)
        Direction of the satellite; NaN where its place is unknown. [rad]
    located : bool
    notes : tuple of str
    """

    r_e: FloatArray
    elevation: FloatArray
    azimuth: FloatArray
    located: bool
    notes: tuple[str, ...] = ()


def receiver_place(
    t: FloatArray,
    pseudorange: FloatArray,
    r_sat_e: FloatArray,
    usable: BoolArray,
    *,
    position_e: ArrayLike | tuple[ArrayLike, ArrayLike] | None = None,
    header_position_e: tuple[float, float, float] | None = None,
) -> ReceiverPlace:
    """Positions given by the user, else found from the pseudoranges, else those of a file's header.

    Parameters
    ----------
    t : ndarray, shape (n,)
        In order. [s]
    pseudorange : ndarray, shape (n,)
        With the satellites' clocks taken out. [m]
    r_sat_e : ndarray, shape (n, 3)
        [m]
    usable : ndarray of bool, shape (n,)
        Rows that a position is computed from.
    position_e, header_position_e
        See :func:`schuler.gnss.preparation.prepare_ranges`.

    Raises
    ------
    InputError
        For a position that is not Earth-fixed metres, or times that do not increase.

    Notes
    -----
    A position of its own is preferred to the header's, which stays where it is while the receiver moves and in many
    files is not filled in.
    """
    notes: list[str] = []
    if position_e is None:
        good = usable & np.isfinite(pseudorange)
        t_fix, r_fix = coarse_track(t[good], pseudorange[good], r_sat_e[good])
        if not len(t_fix) and header_position_e is not None and np.any(header_position_e):
            notes.append("no epoch has four good satellites: elevations are those at the position in the header")
            t_fix, r_fix = np.zeros(1), as_floats([header_position_e], "Observations.position_e", (1, 3))
        if not len(t_fix):
            notes.append(
                "no epoch has four good satellites and no position is known: no atmosphere taken out, no elevation mask"
            )
            nothing = np.full(len(t), np.nan)
            return ReceiverPlace(np.full((len(t), 3), np.nan), nothing, nothing, located=False, notes=tuple(notes))
    elif isinstance(position_e, tuple) and len(position_e) == 2:
        t_fix = as_floats(position_e[0], "position_e: times", (None,))
        r_fix = as_floats(position_e[1], "position_e: positions", (len(t_fix), 3))
        if not len(t_fix) or np.any(np.diff(t_fix) <= 0.0):
            raise InputError("position_e: expected at least one time, and times that increase")
    else:
        t_fix, r_fix = np.zeros(1), as_floats(position_e, "position_e", (3,))[None, :]
    if np.any(np.linalg.norm(r_fix, axis=1) < _ABOVE_CENTRE):
        raise InputError(
            f"position_e: expected Earth-fixed metres, more than 6000 km from the centre, got {r_fix[0].tolist()}; "
            "convert latitude and longitude with schuler.frames.ecef_from_llh"
        )
    r_e = along_track(t, t_fix, r_fix)
    elevation, azimuth = directions(r_e, r_sat_e)
    return ReceiverPlace(r_e, elevation, azimuth, located=True, notes=tuple(notes))
