"""Variance of a corrected range: noise and multipath, orbits and clocks, remainder of the atmosphere's models."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.exceptions import InputError
from schuler.gnss.signals import SYSTEMS
from schuler.units import DEG

Scheme = Literal["elevation", "cn0", "elevation+cn0", "equal"]

#: What broadcast orbits and clocks leave, root mean square along the line of sight. [m]
SIGNAL_IN_SPACE = {"G": 0.6, "R": 2.0, "E": 0.3, "C": 0.8, "J": 0.8, "I": 2.0, "S": 5.0}
_LOWEST = 2.0 * DEG  # [rad]
_STRONG_DBHZ = 45.0
_ACCURACY_IS = 4.0  # broadcast accuracies are bounds; a message that claims this many times the usual is believed


@dataclass(frozen=True)
class Weighting:
    """Parameters of the range budget.

    Attributes
    ----------
    scheme : {"elevation+cn0", "elevation", "cn0", "equal"}
        Dependence of noise and multipath; ``equal`` leaves both out.
    code : float
        Noise and multipath of a code measurement of a strong satellite overhead. [m]
    rate : float
        The same of a range rate. [m/s]
    ionosphere_share : float
        Part of Klobuchar's delay that remains, 1-sigma.
    zenith_troposphere : float
        Remainder of the zenith delay; it grows as ``1 / sin(elevation)``. [m]
    """

    scheme: Scheme = "elevation+cn0"
    code: float = 0.5
    rate: float = 0.05
    ionosphere_share: float = 0.5
    zenith_troposphere: float = 0.1

    def __post_init__(self) -> None:
        if self.scheme not in ("elevation+cn0", "elevation", "cn0", "equal"):
            raise InputError(f"weighting: expected elevation, cn0, elevation+cn0 or equal, got {self.scheme!r}")
        if not (self.code > 0.0 and self.rate > 0.0):
            raise InputError(f"weighting: expected positive sigmas, got {self.code} m and {self.rate} m/s")
        if not (self.ionosphere_share >= 0.0 and self.zenith_troposphere >= 0.0):
            raise InputError("weighting: expected shares of the atmosphere of zero or more")


def noise_scale(elevation: ArrayLike, cn0: ArrayLike, scheme: Scheme) -> FloatArray:
    """Noise and multipath relative to a strong satellite overhead.

    Parameters
    ----------
    elevation : array_like, shape (n,)
        Below 2 deg it counts as 2 deg. [rad]
    cn0 : array_like, shape (n,)
        Carrier to noise density; NaN counts as 45 dB-Hz. [dB-Hz]
    scheme : str
        See :class:`Weighting`.

    Returns
    -------
    ndarray, shape (n,)
        Elevation: ``sqrt(0.5 + 0.5 / sin^2 E)``, the half that grows being multipath and antenna gain. C/N0:
        ``10^((45 - C/N0) / 20)``, at least 1, as the thermal noise of a delay lock loop. Both: the larger of the two,
        not their product, since low satellites are weak for the same reason.

    References
    ----------
    Groves (2013), section 9.3; Wieser, A., Brunner, F. K. (2000), Earth Planets Space 52, 777-782 (weights by C/N0).
    """
    sine = np.sin(np.maximum(np.asarray(elevation, dtype=np.float64), _LOWEST))
    low = np.sqrt(0.5 + 0.5 / sine**2)
    strength = np.nan_to_num(np.asarray(cn0, dtype=np.float64), nan=_STRONG_DBHZ)
    weak = np.maximum(10.0 ** ((_STRONG_DBHZ - strength) / 20.0), 1.0)
    if scheme == "equal":
        return np.ones(np.broadcast(low, weak).shape)
    if scheme == "elevation":
        return np.asarray(low + 0.0 * weak)
    return np.asarray(weak + 0.0 * low if scheme == "cn0" else np.maximum(low, weak))


def range_sigmas(
    weighting: Weighting,
    sat: ArrayLike,
    elevation: ArrayLike,
    cn0: ArrayLike,
    *,
    accuracy: ArrayLike = np.nan,
    ionosphere: ArrayLike = 0.0,
    troposphere: bool = True,
    noise_factor: ArrayLike = 1.0,
    unknown_delay: ArrayLike = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Standard deviation of each pseudorange and range rate.

    Parameters
    ----------
    weighting : Weighting
    sat : array_like of int, shape (n,)
    elevation, cn0 : array_like, shape (n,)
        [rad], [dB-Hz]; NaN where unknown (an unknown elevation counts as 90 deg).
    accuracy : array_like, shape () or (n,)
        Signal-in-space accuracy as broadcast; NaN where unknown. [m]
    ionosphere : array_like, shape () or (n,)
        1-sigma of what a model of its delay leaves; zero where none was taken out. [m]
    troposphere : bool
        A model of it was taken out.
    noise_factor : array_like, shape () or (n,)
        Growth of noise and multipath in a combination of frequencies.
    unknown_delay : array_like, shape () or (n,)
        1-sigma of a group delay that is not broadcast. [m]

    Returns
    -------
    sigma_range, sigma_rate : ndarray, shape (n,)
        [m], [m/s]

    Notes
    -----
    The variances of noise and multipath, signal in space, ionosphere, troposphere and group delay add. All but the
    noise persist for minutes: a filter that takes them as white will be too sure of itself.

    The signal-in-space part is the system's usual one (Montenbruck et al. 2018), larger if the broadcast accuracy is
    above four times that: broadcast accuracies are bounds with a wide margin (GPS says 2 m and has 0.6 m).

    References
    ----------
    Montenbruck, O., Steigenberger, P., Hauschild, A. (2018), GPS Solutions 22, 29; Groves (2013), section 9.3.
    """
    elevation = np.nan_to_num(np.asarray(elevation, dtype=np.float64), nan=0.5 * np.pi)
    scale = noise_scale(elevation, cn0, weighting.scheme)
    usual = np.array([SIGNAL_IN_SPACE[s] for s in SYSTEMS])[np.asarray(sat, dtype=np.int64) // 100]
    claimed = np.nan_to_num(np.asarray(accuracy, dtype=np.float64), nan=0.0) / _ACCURACY_IS
    variance = (weighting.code * scale * np.asarray(noise_factor)) ** 2 + np.maximum(usual, claimed) ** 2
    variance = variance + np.asarray(ionosphere) ** 2 + np.asarray(unknown_delay) ** 2
    if troposphere:
        variance = variance + (weighting.zenith_troposphere / np.sin(np.maximum(elevation, _LOWEST))) ** 2
    return np.sqrt(variance), np.asarray(weighting.rate * scale)
