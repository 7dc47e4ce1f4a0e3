"""Ionosphere by Galileo's three broadcast coefficients: the model NeQuick-G, computed by the library nequick."""

from __future__ import annotations

import datetime as dt
import importlib
import importlib.util

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.frames import ecef_from_ned, llh_from_ecef, ned_from_ecef
from schuler.gnss.ionosphere import F_L1
from schuler.timebase import calendar, leap_second_notes, leap_seconds
from schuler.units import DEG

_DELAY = 40.3e16  # of a code by 1 TECU, times the inverse square of the frequency [m Hz^2]
_LOWEST = 1.0 * DEG  # the model's Earth is a sphere, whose horizon is up to 0.2 deg off
_SPACING_S = 60.0  # rays are integrated at both ends of this, linear in between [s]


def check_nequick() -> None:
    """Refuse the model where the library is not installed."""
    try:
        present = importlib.util.find_spec("nequick") is not None
    except (ImportError, ValueError):
        present = False
    if not present:
        raise InputError(
            'ionosphere: "nequick-g" needs the library nequick, which is not installed: pip install --no-deps nequick '
            "(a C compiler builds it; it asks for numpy below 2 and runs with 2), or take "
            '"galileo", NTCM-G with the same coefficients'
        )


def nequick_g(
    ai: tuple[float, float, float],
    r_e: ArrayLike,
    r_sat_e: ArrayLike,
    sat: IntArray,
    gps_s: ArrayLike,
    frequency_hz: ArrayLike = F_L1,
) -> FloatArray:
    """Ionospheric delay of a code measurement by an electron density that Galileo's coefficients scale.

    Parameters
    ----------
    ai : tuple of 3 floats
        ``ai0`` [sfu], ``ai1`` [sfu/deg], ``ai2`` [sfu/deg^2] as broadcast by Galileo; used for all systems. All zero
        counts as 63.7 sfu.
    r_e : array_like, shape (3,) or (n, 3)
        Receiver, Earth-fixed. [m]
    r_sat_e : array_like, shape (n, 3)
        Satellites, Earth-fixed; lower than 1 deg they count as at 1 deg. [m]
    sat : ndarray of int, shape (n,)
        Which satellite a row is of.
    gps_s : array_like, shape (n,)
        GPS time, counted from 1980-01-06; the month and the time of day matter. [s]
    frequency_hz : array_like, shape () or (n,)
        The delay grows with its inverse square. [Hz]

    Returns
    -------
    ndarray, shape (n,)
        Positive: the code comes late, so it is subtracted from the pseudorange. NaN where a place is. [m]

    Raises
    ------
    InputError
        Where the library is not installed.

    Notes
    -----
    A ray takes 0.1 to 0.4 ms. So of each satellite the first and the last row of every minute of the clock are
    integrated, and those between are linear in time: off by 0.015 TECU (2 mm on L1) as root mean square, by 0.3 TECU at
    most (5 cm; 0.5 TECU below 10 deg), which is what the library's own adaptive integration jumps by.

    References
    ----------
    European Union (2016), Galileo Open Service - Ionospheric Correction Algorithm for Galileo Single Frequency Users,
    issue 1.2; the library is that of the Joint Research Centre.
    """
    check_nequick()
    t, satellites = np.asarray(gps_s, dtype=np.float64), np.asarray(r_sat_e, dtype=np.float64)
    receivers = np.broadcast_to(np.asarray(r_e, dtype=np.float64), satellites.shape)
    content = np.full(len(t), np.nan)
    complete = np.isfinite(receivers).all(axis=1) & np.isfinite(satellites).all(axis=1)
    rows = np.flatnonzero(complete)
    rows = rows[np.lexsort((t[rows], sat[rows]))]
    if not len(rows):
        return content
    minute = np.floor(t[rows] / _SPACING_S)
    begins = np.append(True, (np.diff(sat[rows]) != 0) | (np.diff(minute) != 0.0))
    nodes = begins | np.append(begins[1:], True)
    at_nodes = _contents(ai, receivers[rows[nodes]], satellites[rows[nodes]], t[rows[nodes]])
    for s in np.unique(sat[rows]):
        own = sat[rows] == s
        content[rows[own]] = np.interp(t[rows[own]], t[rows[own & nodes]], at_nodes[own[nodes]])
    return np.asarray(_DELAY / np.asarray(frequency_hz, dtype=np.float64) ** 2 * content)


def _contents(ai: tuple[float, float, float], r_e: FloatArray, r_sat_e: FloatArray, t: FloatArray) -> FloatArray:
    """Slant electron contents between receivers and satellites. Shape (n,). [TECU]"""
    model = importlib.import_module("nequick").NeQuick(*ai)
    here = llh_from_ecef(r_e)
    ned = ned_from_ecef(r_sat_e, here)
    ned[:, 2] = np.minimum(ned[:, 2], -np.tan(_LOWEST) * np.hypot(ned[:, 0], ned[:, 1]))
    there = llh_from_ecef(ecef_from_ned(ned, here))
    scale = (1.0 / DEG, 1.0 / DEG, 1.0)
    places = np.hstack([here * scale, there * scale])[:, [1, 0, 2, 4, 3, 5]]  # longitudes first
    return np.array([
        model.compute_stec(_utc(s), *place) for s, place in zip(t.tolist(), places.tolist(), strict=True)
    ])  # fmt: skip


def _utc(gps_s: float) -> dt.datetime:
    moment = calendar(gps_s)
    with leap_second_notes():  # a second is nothing to the ionosphere
        return moment - dt.timedelta(seconds=leap_seconds(moment.date()))
