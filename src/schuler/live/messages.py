"""Messages of a stream: what sensors send, what the navigator says.

Names, units and axes are those of the series of a recording (:mod:`schuler.recording.series`), one row of each.
Messages are not checked when made: a stream goes on whatever comes, and what is not used is said as an :class:`Event`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.gnss.ephemerides import Ephemerides
from schuler.gnss.observations import Observations
from schuler.gnss.ranges import Ranges
from schuler.plotting.notebook import Abridged

#: State of a live solution, from none to none any more.
Health = Literal["aligning", "ok", "coasting", "doubtful", "failed"]
#: Subject of an event: the start, samples of the IMU, a measurement, a late one, stamps that jump, the health
#: of the solution, the saved state, a source of messages, bytes that are no messages.
EventKind = Literal["start", "imu", "measurement", "late", "clock", "health", "state", "source", "decoder"]


@dataclass(frozen=True, slots=True, repr=False)
class ImuSample(Abridged):
    """One sample of an IMU, in the units and axes of the log as the configuration describes them.

    Attributes
    ----------
    t : float
        On the clock of the source: of validity for rates, of the end of the interval for increments. [s]
    gyro, accel : ndarray, shape (3,)
        Angular rate and specific force, or their integrals over the interval.
    temperature : float, optional
        [degC]
    """

    t: float
    gyro: FloatArray
    accel: FloatArray
    temperature: float | None = None


@dataclass(frozen=True, slots=True, repr=False)
class ImuBlock(Abridged):
    """Consecutive samples of an IMU that came together.

    Attributes
    ----------
    t : ndarray, shape (n,)
        As of :class:`ImuSample`. [s]
    gyro, accel : ndarray, shape (n, 3)
    temperature : ndarray, shape (n,), optional
        [degC]
    """

    t: FloatArray
    gyro: FloatArray
    accel: FloatArray
    temperature: FloatArray | None = None


def parted(block: ImuBlock, count: int) -> tuple[ImuBlock, ImuBlock]:
    """The first samples of a block, and the others."""
    first, others = (
        ImuBlock(
            block.t[rows], block.gyro[rows], block.accel[rows],
            None if block.temperature is None else block.temperature[rows],
        )
        for rows in (slice(count), slice(count, None))
    )  # fmt: skip
    return first, others


@dataclass(frozen=True, slots=True, repr=False)
class Fix(Abridged):
    """One solution of a GNSS receiver, of the antenna.

    Attributes
    ----------
    t : float
        Time of validity, not of arrival. [s]
    llh : ndarray, shape (3,)
        Latitude, longitude [rad], **ellipsoidal** height [m].
    cov_r_n : ndarray, shape (3, 3)
        Covariance of position north, east, down. [m^2]
    v_n : ndarray, shape (3,), optional
        Velocity north, east, down. [m/s]
    cov_v_n : ndarray, shape (3, 3), optional
        Its covariance. [m^2/s^2]
    quality : int, optional
        See :data:`schuler.recording.series.QUALITY`.
    n_satellites : int, optional
    """

    t: float
    llh: FloatArray
    cov_r_n: FloatArray
    v_n: FloatArray | None = None
    cov_v_n: FloatArray | None = None
    quality: int | None = None
    n_satellites: int | None = None

    @classmethod
    def from_sigmas(
        cls,
        t: float,
        llh: ArrayLike,
        sigma_r_n: ArrayLike,
        v_n: ArrayLike | None = None,
        sigma_v_n: ArrayLike | None = None,
        *,
        quality: int | None = None,
        n_satellites: int | None = None,
    ) -> Fix:
        """A fix whose errors are independent north, east and down.

        Parameters
        ----------
        t, llh, v_n, quality, n_satellites
            See the attributes.
        sigma_r_n, sigma_v_n : array_like, shape (3,)
            1-sigma north, east, down. [m], [m/s]
        """
        without = v_n is None or sigma_v_n is None
        return cls(
            float(t),
            np.asarray(llh, dtype=np.float64),
            np.diag(np.asarray(sigma_r_n, dtype=np.float64) ** 2),
            None if without else np.asarray(v_n, dtype=np.float64),
            None if without else np.diag(np.asarray(sigma_v_n, dtype=np.float64) ** 2),
            quality,
            n_satellites,
        )


@dataclass(frozen=True, slots=True)
class Speed:
    """One reading of an odometer.

    Attributes
    ----------
    t : float
        Time of validity. [s]
    speed : float
        Along the body's x axis, negative backwards. [m/s]
    sigma : float, optional
        1-sigma; needed unless the configuration states one. [m/s]
    """

    t: float
    speed: float
    sigma: float | None = None


@dataclass(frozen=True, slots=True)
class Heading:
    """One heading of a magnetometer or of two antennas.

    Attributes
    ----------
    t : float
        Time of validity. [s]
    value : float
        Of the body's x axis, from north over east. [rad]
    sigma : float, optional
        1-sigma; needed unless the configuration states one. [rad]
    """

    t: float
    value: float
    sigma: float | None = None


@dataclass(frozen=True, slots=True)
class Height:
    """One height of a barometer.

    Attributes
    ----------
    t : float
        Time of validity. [s]
    value : float
        Over the ellipsoid, or over a level of its own. [m]
    sigma : float, optional
        1-sigma; needed unless the configuration states one. [m]
    """

    t: float
    value: float
    sigma: float | None = None


@dataclass(frozen=True, slots=True)
class SatelliteEpoch:
    """Measurements of one epoch of a receiver, for tight coupling.

    Attributes
    ----------
    measured : Observations or Ranges
        Rows of one time. Raw measurements need :class:`Broadcast` messages that came before.
    """

    measured: Observations | Ranges

    @property
    def t(self) -> float:
        """Time of reception; NaN without rows. [s]"""
        return float(self.measured.t[0]) if len(self.measured) else math.nan


@dataclass(frozen=True, slots=True)
class Broadcast:
    """Navigation messages of satellites, received by the measuring receiver or from elsewhere.

    Attributes
    ----------
    t : float
        Time of reception, of no consequence. [s]
    ephemerides : Ephemerides
        Broadcast orbits, clocks and coefficients of GPS's ionosphere are used, precise products are not.
    """

    t: float
    ephemerides: Ephemerides


#: Measurements of a receiver or sensor, and what belongs to them.
Measurement = Fix | Speed | Heading | Height | SatelliteEpoch | Broadcast
#: What a navigator takes.
Message = ImuSample | ImuBlock | Measurement


@dataclass(frozen=True, slots=True)
class Event:
    """Something that a user of the live solution should know.

    Attributes
    ----------
    t : float
        Time on the clock of the IMU; NaN before there is one. [s]
    kind : str
        See :data:`EventKind`.
    text : str
        A sentence: what came, what was done.
    """

    t: float
    kind: EventKind
    text: str


@dataclass(frozen=True, slots=True, repr=False)
class Solution(Abridged):
    """Live solution at one time, of the IMU's position.

    Attributes
    ----------
    t : float
        [s]
    llh : ndarray, shape (3,)
        Latitude, longitude [rad], ellipsoidal height [m].
    v_eb_n : ndarray, shape (3,)
        Velocity north, east, down. [m/s]
    rpy_nb : ndarray, shape (3,)
        Roll, pitch, yaw. [rad]
    sigma_r_n, sigma_v_n, sigma_psi_n : ndarray, shape (3,)
        1-sigma of position [m], velocity [m/s] and attitude [rad], north, east, down (attitude: about these axes).
    health : str
        See :data:`Health`; of a smoothed one, that of the run when it was made.
    smoother_lag_s : float
        How much later data are in it; 0 of a filtered solution. [s]
    """

    t: float
    llh: FloatArray
    v_eb_n: FloatArray
    rpy_nb: FloatArray
    sigma_r_n: FloatArray
    sigma_v_n: FloatArray
    sigma_psi_n: FloatArray
    health: Health
    smoother_lag_s: float = 0.0
