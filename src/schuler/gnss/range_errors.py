"""What synthetic ranges suffer: an error budget, and parts of the sky that are blocked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.exceptions import InputError


@dataclass(frozen=True)
class RangeErrors:
    """Error budget of synthetic ranges; every part is 1-sigma at the zenith.

    Attributes
    ----------
    noise, rate_noise : float
        White, of ranges [m] and range rates [m/s]. Grows as ``sqrt((1 + 1 / sin^2 el) / 2)`` towards the horizon.
    multipath, multipath_tau : float
        First-order Gauss-Markov process of each satellite, growing likewise [m], and its correlation time [s].
    atmosphere, atmosphere_tau : float
        What correction models leave: Gauss-Markov, growing as ``1 / sin el`` with at least 5 degrees [m], [s].
    clock, drift : float
        Receiver clock at the start, of the first group [m], [m/s].
    clock_psd, drift_psd : float
        Power spectral densities of the clock's frequency noise [m^2/s] and of the random walk of its drift [m^2/s^3].
        0.04 and 0.04 are a temperature-compensated crystal oscillator's (Groves (2013), section 9.4.2).
    offsets : tuple of float
        Clock of each further group less that of the first. [m]
    """

    noise: float = 0.5
    rate_noise: float = 0.05
    multipath: float = 0.5
    multipath_tau: float = 30.0
    atmosphere: float = 0.5
    atmosphere_tau: float = 1800.0
    clock: float = 3e4
    drift: float = 30.0
    clock_psd: float = 0.04
    drift_psd: float = 0.04
    offsets: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name in ("noise", "rate_noise", "multipath", "atmosphere", "clock_psd", "drift_psd"):
            if not getattr(self, name) >= 0.0:
                raise InputError(f"{name}: expected 0 or more, got {getattr(self, name)}")
        for name in ("multipath_tau", "atmosphere_tau"):
            if not getattr(self, name) > 0.0:
                raise InputError(f"{name}: expected a positive time, got {getattr(self, name)}")


#: Ranges without any error and a clock that stands at zero.
EXACT = RangeErrors(0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Sector:
    """A part of the sky that is blocked.

    Attributes
    ----------
    azimuth_from, azimuth_to : float
        From north over east; from 5.5 to 0.5 goes through north. [rad]
    below : float
        Blocked up to this elevation. [rad]
    """

    azimuth_from: float
    azimuth_to: float
    below: float = 0.5 * np.pi

    def blocks(self, azimuth: FloatArray, elevation: FloatArray) -> BoolArray:
        """Whether directions are within it. Shape as given."""
        width = np.mod(self.azimuth_to - self.azimuth_from, 2.0 * np.pi)
        inside = np.mod(azimuth - self.azimuth_from, 2.0 * np.pi) <= width
        return np.asarray(inside & (elevation <= self.below))
