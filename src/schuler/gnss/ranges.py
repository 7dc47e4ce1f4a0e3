"""Ranges ready for positioning: satellites' places, corrected pseudoranges and their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, fields
from types import MappingProxyType

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray
from schuler.exceptions import InputError

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


@dataclass(frozen=True)
class Ranges:
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
        Which receiver clock the range contains: place in ``groups``.
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

    def __post_init__(self) -> None:
        n = len(self.t)
        for f in fields(self):
            if f.name in ("groups", "notes"):
                continue
            integer = f.name in ("sat", "group", "reason")
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
        """Which rows are to be used. Shape (n,)."""
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
