"""Ranges ready for positioning: satellites' places, corrected pseudoranges and their uncertainty.

Models of a range and a range rate, with satellites as in :class:`Ranges` (axes of transmission)::

    range      = |r_s - r| + (omega / c) (x_s y - y_s x) + clock(group)
    range rate = u . (v_s - v) + (omega / c) (vx_s y + x_s vy - vy_s x - y_s vx) + drift

``u`` is the unit vector from receiver to satellite, ``v_s`` the satellite's velocity. A second of reception is not a
second of transmission: the rate a receiver measures is ``1 + u . v_s / c`` times smaller (3 mm/s at most), which
:func:`schuler.gnss.preparation.prepare_ranges` puts right, as do synthetic ranges, so that the model stays linear.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Any

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray
from schuler.earth import WGS84
from schuler.exceptions import InputError
from schuler.gnss.signals import SPEED_OF_LIGHT, SYSTEMS
from schuler.plotting.notebook import Abridged

#: Why a range is not used; 0 is used.
REASONS = MappingProxyType(
    {
        0: "used",
        1: "no ephemeris",
        2: "unhealthy",
        3: "below the elevation mask",
        4: "weak signal",
        5: "implausible pseudorange",
        6: "excluded by fault detection",
        7: "system not asked for",
        8: "left out on request",
    }
)
_TURN = WGS84.omega_ie / SPEED_OF_LIGHT


@dataclass(frozen=True, repr=False)
class Ranges(Abridged):
    """One row for each satellite at each epoch, in order of time.

    A pseudorange is modelled as ``|r_sat - r_antenna| + sagnac + clock(group) + error``: satellite clock, relativity,
    group delay and, where corrected, ionosphere and troposphere are taken out already.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Time of reception **corrected for the receiver clock where it is known to more than a microsecond**, on the axis
        of the recording. [s]
    sat : ndarray of int, shape (n,)
    group : ndarray of int, shape (n,)
        Receiver clock in the range: place in ``groups``.
    groups : tuple of str
        Names of the clocks, the first one being the reference, such as ``("G", "E")``.
    r_sat_e, v_sat_e : ndarray, shape (n, 3)
        Satellite at transmission in the Earth-fixed axes **of transmission** (Sagnac is left to the user, see
        :func:`sagnac`). [m], [m/s]
    pseudorange, range_rate : ndarray, shape (n,)
        Corrected. NaN where there is none. [m], [m/s]
    sigma_range, sigma_rate : ndarray, shape (n,)
        1-sigma. [m], [m/s]
    elevation, azimuth : ndarray, shape (n,)
        From the approximate position, azimuth from north over east. [rad]
    cn0 : ndarray, shape (n,)
        [dB-Hz]
    reason : ndarray of int, shape (n,)
        0 for a range to be used, else a key of :data:`REASONS`.
    notes : tuple of str
    carrier_range : ndarray, shape (n,)
        Carrier phase as a range, corrected as the pseudorange is (the ionosphere with its sign): the same but for a
        constant of each arc, and a hundred times less noise. NaN where there is none. [m]
    arc : ndarray of int, shape (n,)
        Carrier phases of a satellite with equal numbers share their constant: no cycle slip lies between.
    wavelength : ndarray, shape (n,)
        Of the carrier. NaN where it is not known, and where the constant is no whole number of cycles. [m]
    bands_apart : ndarray, shape (n,)
        Carrier phase as a range less that of another band: free of geometry and clocks, it changes with the ionosphere
        alone. NaN where there is none, or where the other band's lock is in doubt. [m]
    """

    t: FloatArray
    sat: IntArray
    group: IntArray
    groups: tuple[str, ...]
    r_sat_e: FloatArray
    v_sat_e: FloatArray
    pseudorange: FloatArray
    range_rate: FloatArray
    sigma_range: FloatArray
    sigma_rate: FloatArray
    elevation: FloatArray
    azimuth: FloatArray
    cn0: FloatArray
    reason: IntArray
    notes: tuple[str, ...] = ()
    carrier_range: FloatArray = field(default_factory=lambda: np.zeros(0))
    arc: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    wavelength: FloatArray = field(default_factory=lambda: np.zeros(0))
    bands_apart: FloatArray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        n = len(self.t)
        if n and not len(self.carrier_range):
            object.__setattr__(self, "carrier_range", np.full(n, np.nan))
        if n and not len(self.arc):
            object.__setattr__(self, "arc", np.zeros(n, dtype=np.int64))
        if n and not len(self.wavelength):
            object.__setattr__(self, "wavelength", np.full(n, np.nan))
        if n and not len(self.bands_apart):
            object.__setattr__(self, "bands_apart", np.full(n, np.nan))
        for f in fields(self):
            if f.name in ("groups", "notes"):
                continue
            integer = f.name in ("sat", "group", "reason", "arc")
            value = np.asarray(getattr(self, f.name)).astype(np.int64 if integer else np.float64)
            shape = (n, 3) if f.name.endswith("_e") else (n,)
            if value.shape != shape:
                raise InputError(f"Ranges.{f.name}: expected shape {shape}, got {value.shape}")
            object.__setattr__(self, f.name, value)
        if np.any(np.diff(self.t) < 0.0):
            raise InputError("Ranges.t: expected rows in order of time")

    def __len__(self) -> int:
        return len(self.t)

    @property
    def used(self) -> BoolArray:
        """Rows to be used. Shape (n,)."""
        return np.asarray(self.reason == 0)

    def where(self, keep: ArrayLike) -> Ranges:
        """The rows selected by a boolean or index array."""
        k = np.asarray(keep)
        k = k.astype(np.int64) if k.size == 0 else k
        return Ranges(
            **{
                f.name: getattr(self, f.name) if f.name in ("groups", "notes") else getattr(self, f.name)[k]
                for f in fields(self)
            }
        )


def joined_ranges(parts: Sequence[Ranges]) -> Ranges:
    """Consecutive ranges as one, with the clocks of all of them; without their notes.

    Parameters
    ----------
    parts : sequence of Ranges
        At least one, in order of time. Clocks that are not the same in all are in the order of their systems.
    """
    groups = tuple(dict.fromkeys(name for part in parts for name in part.groups))
    if any(part.groups != groups for part in parts) and all(name in SYSTEMS for name in groups):
        groups = tuple(sorted(groups, key=SYSTEMS.index))
    rows: dict[str, Any] = {
        f.name: np.concatenate([getattr(part, f.name) for part in parts])
        for f in fields(Ranges)
        if f.name not in ("group", "groups", "notes")
    }
    # rows of systems not asked for have the place of a clock without being of it, and may be all there are
    place = [np.array([groups.index(name) for name in part.groups] or [0])[part.group] for part in parts]
    return Ranges(group=np.concatenate(place), groups=groups, **rows)


def sagnac(r_sat_e: FloatArray, r_e: FloatArray, omega_ie: float) -> FloatArray:
    """Extra path while the signal travels and the Earth turns, ``omega / c (x_s y_r - y_s x_r)``. Shape (n,). [m]

    Parameters
    ----------
    r_sat_e, r_e : ndarray, shape (..., 3)
        Satellite at transmission in the axes of transmission, receiver at reception. [m]
    omega_ie : float
        [rad/s]

    Notes
    -----
    First order; the second is below 0.1 mm.
    """
    from schuler.gnss.signals import SPEED_OF_LIGHT

    x: FloatArray = r_sat_e[..., 0] * r_e[..., 1] - r_sat_e[..., 1] * r_e[..., 0]
    return np.asarray(omega_ie / SPEED_OF_LIGHT * x)


def predicted_ranges(r_sat_e: FloatArray, r_e: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Range without clock, and its derivative by the receiver's position. Shapes (..., 3) to (...), (..., 3).

    Source: Groves (2013), section 8.5.3, to first order in the travel time; see :func:`schuler.gnss.ranges.sagnac`.
    """
    d = r_sat_e - r_e
    distance = np.sqrt(np.sum(d * d, axis=-1))
    gradient = -d / distance[..., None]
    gradient[..., 0] -= _TURN * r_sat_e[..., 1]
    gradient[..., 1] += _TURN * r_sat_e[..., 0]
    return distance + _TURN * (r_sat_e[..., 0] * r_e[..., 1] - r_sat_e[..., 1] * r_e[..., 0]), gradient


def predicted_rates(
    r_sat_e: FloatArray, v_sat_e: FloatArray, r_e: FloatArray, v_e: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Range rate without drift, and its derivative by the receiver's velocity. Shapes (..., 3) to (...), (..., 3).

    It is the derivative of :func:`predicted_ranges` by time: the same gradient, and the satellite's part.
    """
    _, gradient = predicted_ranges(r_sat_e, r_e)
    d = r_sat_e - r_e
    u = d / np.sqrt(np.sum(d * d, axis=-1))[..., None]
    satellite = np.sum(u * v_sat_e, axis=-1)
    satellite = satellite + _TURN * (v_sat_e[..., 0] * r_e[..., 1] - v_sat_e[..., 1] * r_e[..., 0])
    return satellite + np.sum(gradient * v_e, axis=-1), gradient
