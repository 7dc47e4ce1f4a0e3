"""Raw measurements of a satellite receiver."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.gnss.signals import SYSTEM_NAMES, SYSTEMS
from schuler.plotting.notebook import Displayed


@dataclass(frozen=True, repr=False)
class Observations(Displayed):
    """Measurements of a receiver: one row for each signal of each satellite at each epoch, in order of time.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Time of reception by the receiver's clock, on the axis of the recording; rows of one epoch have equal times. [s]
    sat : ndarray of int, shape (n,)
        Satellites, see :func:`schuler.gnss.signals.satellite`.
    signal : ndarray of int, shape (n,)
        Places in ``signals``.
    signals : tuple of str
        RINEX 3 band and attribute, such as ``1C``.
    pseudorange : ndarray, shape (n,)
        NaN where there is none. [m]
    range_rate : ndarray, shape (n,)
        Rate of the pseudorange: minus Doppler shift times wavelength. NaN where there is none. [m/s]
    carrier : ndarray, shape (n,)
        Carrier phase. NaN where there is none. [cycles]
    cn0 : ndarray, shape (n,)
        Carrier to noise density. NaN where there is none. [dB-Hz]
    epoch_gps_s : float
        GPS time of zero seconds, in seconds since 1980-01-06. [s]
    glonass_channels : dict of int to int
        FDMA channel by satellite, as far as the file has them.
    position_e : tuple of float, optional
        Approximate Earth-fixed position in the file's header. [m]
    notes : tuple of str
        Repairs and assumptions of the reader.
    lock : ndarray of int, shape (n,)
        Loss of lock indicator of the carrier as in RINEX: 1, lock was lost since the epoch before; 2, it may be half a
        cycle off; 3, both. 0 where nothing is stated.
    station_e : tuple of float, optional
        Antenna of a base station as it states it, good to centimetres; Earth-fixed. [m]
    antenna : str
        Type and radome as the log states them, such as ``TRM59800.00     SCIT``; empty where it does not.
    eccentricity_n : tuple of float, optional
        Antenna reference point from the station's mark as the log states it: north, east, down. [m]
    """

    t: FloatArray
    sat: IntArray
    signal: IntArray
    signals: tuple[str, ...]
    pseudorange: FloatArray
    range_rate: FloatArray
    carrier: FloatArray
    cn0: FloatArray
    epoch_gps_s: float = 0.0
    glonass_channels: dict[int, int] = field(default_factory=dict)
    position_e: tuple[float, float, float] | None = None
    notes: tuple[str, ...] = ()
    lock: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    station_e: tuple[float, float, float] | None = None
    antenna: str = ""
    eccentricity_n: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        n = len(self.t)
        if n and not len(self.lock):
            object.__setattr__(self, "lock", np.zeros(n, dtype=np.int64))
        for name in ("t", "pseudorange", "range_rate", "carrier", "cn0"):
            value = np.asarray(getattr(self, name), dtype=np.float64)  # NaN means: not measured
            if value.shape != (n,):
                raise InputError(f"Observations.{name}: expected shape ({n},), got {value.shape}")
            object.__setattr__(self, name, value)
        if not np.isfinite(self.t).all():
            raise InputError("Observations.t: expected finite times")
        for name in ("sat", "signal", "lock"):
            value = np.asarray(getattr(self, name), dtype=np.int64)
            if value.shape != (n,):
                raise InputError(f"Observations.{name}: expected shape ({n},), got {value.shape}")
            object.__setattr__(self, name, value)
        if n and (self.signal.min() < 0 or self.signal.max() >= len(self.signals)):
            raise InputError("Observations.signal: expected places in signals")
        if np.any(np.diff(self.t) < 0.0):
            raise InputError("Observations.t: expected rows in order of time")

    def __len__(self) -> int:
        return len(self.t)

    @property
    def epochs(self) -> FloatArray:
        """Times of the epochs. Shape (k,). [s]"""
        return np.unique(self.t)

    def where(self, keep: ArrayLike) -> Observations:
        """The rows selected by a boolean or index array."""
        k = np.asarray(keep)
        k = k.astype(np.int64) if k.size == 0 else k
        return Observations(
            self.t[k], self.sat[k], self.signal[k], self.signals, self.pseudorange[k], self.range_rate[k],
            self.carrier[k], self.cn0[k], self.epoch_gps_s, self.glonass_channels, self.position_e, self.notes,
            self.lock[k], self.station_e, self.antenna, self.eccentricity_n,
        )  # fmt: skip

    def summary(self) -> str:
        """One sentence: epochs, satellites by system, signals."""
        epochs = self.epochs
        counts = [
            f"{len(np.unique(self.sat[self.sat // 100 == i]))} {SYSTEM_NAMES[letter]}"
            for i, letter in enumerate(SYSTEMS)
            if np.any(self.sat // 100 == i)
        ]
        span = f"{epochs[0]:.1f} to {epochs[-1]:.1f} s" if len(epochs) else "no time"
        return f"{len(epochs)} epochs, {span}; satellites: {', '.join(counts)}; signals: {', '.join(self.signals)}"


def joined_observations(parts: Sequence[Observations]) -> Observations:
    """Consecutive observations of one receiver and one time axis as one; without their notes.

    Parameters
    ----------
    parts : sequence of Observations
        At least one, in order of time.
    """
    signals = tuple(sorted({name for part in parts for name in part.signals}))
    rows: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("t", "sat", "pseudorange", "range_rate", "carrier", "cn0", "lock")
    }
    place = [np.array([signals.index(name) for name in part.signals], dtype=np.int64)[part.signal] for part in parts]
    channels = {sat: channel for part in parts for sat, channel in part.glonass_channels.items()}
    return Observations(
        signal=np.concatenate(place),
        signals=signals,
        epoch_gps_s=parts[0].epoch_gps_s,
        glonass_channels=channels,
        position_e=parts[-1].position_e,
        **rows,
    )
