"""Series of a recording: what an IMU, a GNSS receiver, an odometer reported.

All are frozen data classes of SI arrays with time along axis 0, body axes forward-right-down, navigation axes
north-east-down. They are checked when made: times increase, values are finite, shapes agree.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray, as_floats
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged, Displayed
from schuler.timebase import SAME_TIME, check_times
from schuler.units import G0

Kind = Literal["rate", "increment"]
Sensor = Literal["accel", "gyro"]
SENSORS: tuple[Sensor, Sensor] = ("accel", "gyro")

#: GNSS solution quality, RTKLIB's numbers.
QUALITY = {1: "fixed", 2: "float", 3: "sbas", 4: "dgps", 5: "single", 6: "ppp", 7: "dead reckoning"}
_NO_DILUTION = 99.0  # receivers that know no dilution write 99.99, or zero [-]
_NEAR = 1e-6  # far above rounding [-]
_BLOCK = 8192  # rows whose temporaries stay in the cache


@dataclass(frozen=True, repr=False)
class Increments(Abridged):
    """Integrals of angular rate and specific force over consecutive intervals: what the mechanization takes.

    Attributes
    ----------
    t : ndarray, shape (n,)
        End of each interval. [s]
    dt : ndarray, shape (n,)
        Length of each interval; interval k is ``(t[k] - dt[k], t[k]]``. [s]
    dtheta_ib_b, dv_ib_b : ndarray, shape (n, 3)
        Integrals of angular rate [rad] and specific force [m/s], body axes.
    """

    t: FloatArray
    dt: FloatArray
    dtheta_ib_b: FloatArray
    dv_ib_b: FloatArray

    def __post_init__(self) -> None:
        n = len(self.t)
        object.__setattr__(self, "t", check_times(self.t, "Increments.t"))
        for name, shape in (("dt", (n,)), ("dtheta_ib_b", (n, 3)), ("dv_ib_b", (n, 3))):
            object.__setattr__(self, name, as_floats(getattr(self, name), f"Increments.{name}", shape))
        if np.any(self.dt <= 0.0):
            raise InputError(f"Increments.dt: expected positive intervals, got {self.dt.min()} s")

    def __len__(self) -> int:
        return len(self.t)

    @property
    def start(self) -> float:
        """Beginning of the first interval. [s]"""
        return float(self.t[0] - self.dt[0])

    def between(self, start: float, stop: float) -> Increments:
        """The whole intervals within ``[start, stop]``. [s]"""
        keep = _run((self.t - self.dt >= start - SAME_TIME) & (self.t <= stop + SAME_TIME))
        if keep.stop == keep.start:
            raise InputError(
                f"no IMU interval lies within {start:.3f}..{stop:.3f} s; "
                f"the log runs {self.start:.3f}..{self.t[-1]:.3f} s"
            )
        return self._part(keep)

    def arrays(self, rows: slice) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Integrals of angular rate [rad] and specific force [m/s], lengths and ends [s] of some intervals."""
        return self.dtheta_ib_b[rows], self.dv_ib_b[rows], self.dt[rows], self.t[rows]

    def shifted(self, seconds: float) -> Increments:
        """The same increments, their intervals ``seconds`` later."""
        return replace(self, t=self.t + seconds)

    def _part(self, rows: slice) -> Increments:
        dtheta, dv, dt, t = self.arrays(rows)
        return Increments(t, dt, dtheta, dv)


@dataclass(frozen=True, repr=False)
class ImuSeries(Displayed):
    """Gyroscope and accelerometer output in body axes.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Time of each sample: of validity for rates, of the end of the interval for increments. [s]
    gyro, accel : ndarray, shape (n, 3)
        Angular rate [rad/s] and specific force [m/s^2] if ``kind`` is "rate", their integrals over
        ``(t[k - 1], t[k]]`` [rad], [m/s] if it is "increment".
    kind : {"rate", "increment"}
    temperature : ndarray, shape (n,), optional
        [degC]
    magnetometer : ndarray, shape (n, 3), optional
        Magnetic flux density in the same axes; one that is sampled more slowly is held. [T]
    """

    t: FloatArray
    gyro: FloatArray
    accel: FloatArray
    kind: Kind = "rate"
    temperature: FloatArray | None = None
    magnetometer: FloatArray | None = None

    def __post_init__(self) -> None:
        if self.kind not in ("rate", "increment"):
            raise InputError(f"kind: expected 'rate' or 'increment', got {self.kind!r}")
        object.__setattr__(self, "t", check_times(self.t, "ImuSeries.t"))
        n = len(self.t)
        object.__setattr__(self, "gyro", as_floats(self.gyro, "ImuSeries.gyro", (n, 3)))
        object.__setattr__(self, "accel", as_floats(self.accel, "ImuSeries.accel", (n, 3)))
        if self.temperature is not None:
            object.__setattr__(self, "temperature", as_floats(self.temperature, "ImuSeries.temperature", (n,)))
        if self.magnetometer is not None:
            object.__setattr__(self, "magnetometer", as_floats(self.magnetometer, "ImuSeries.magnetometer", (n, 3)))

    def __len__(self) -> int:
        return len(self.t)

    def _headline(self) -> str:
        rate = f" at {self.rate_hz:.4g} Hz" if len(self) > 1 else ""
        return f"{len(self)} samples{rate} ({self.kind}){_extent(self.t)}"

    @cached_property
    def interval(self) -> float:
        """Median spacing of the samples. [s]"""
        return float(np.median(np.diff(self.t), overwrite_input=True)) if len(self.t) > 1 else float("nan")

    @property
    def rate_hz(self) -> float:
        """Sampling rate, from the median spacing."""
        return 1.0 / self.interval

    def gaps(self, factor: float = 1.5) -> FloatArray:
        """Start and length of the pauses longer than ``factor`` sample intervals. Shape (k, 2). [s]"""
        step = np.diff(self.t)
        where = np.flatnonzero(step > factor * self.interval) if len(step) else np.empty(0, dtype=int)
        return np.stack((self.t[where], step[where]), axis=-1)

    def increments(self, *, order: int = 2) -> Increments:
        """The log as increments, see :func:`schuler.sensors.increments.increments_from_rates` for rates.

        Parameters
        ----------
        order : {1, 2, 3}
            Integration of rates: held from the sample before (1), trapezoid (2), parabola through three (3).

        Returns
        -------
        Increments
            Of n samples of rates, n - 1 intervals between them; of n increments, n intervals, the first taken as long
            as the median.

        Notes
        -----
        An increment after a pause is either that of all the pause (a sensor that goes on integrating) or of the last
        interval only (samples that were lost). Which one, its size beside gravity's says; in the second case it is
        stretched over the pause, as a rate would be held.
        """
        if self.kind == "increment":
            first = self.interval if len(self.t) > 1 else 1.0
            dt = np.diff(self.t, prepend=self.t[0] - first)
            stretch = _lost(dt, first, self.accel)
            if stretch is None:
                return Increments(self.t, dt, self.gyro, self.accel)
            return Increments(self.t, dt, self.gyro * stretch[:, None], self.accel * stretch[:, None])
        from schuler.recording.integrated_rates import integrated

        return integrated(self, order)

    def rates(self) -> ImuSeries:
        """The log as mean rates over the sample intervals; itself if it already holds rates."""
        if self.kind == "rate":
            return self
        return replace(self, gyro=self.mean_rates("gyro"), accel=self.mean_rates("accel"), kind="rate")

    def mean_rates(self, sensor: Sensor) -> FloatArray:
        """One sensor's part of :meth:`rates`: of a day of increments at 200 Hz that of both is 830 MB. Shape (n, 3)."""
        if self.kind == "rate":
            return self.gyro if sensor == "gyro" else self.accel
        inc = self.increments()
        return np.asarray((inc.dtheta_ib_b if sensor == "gyro" else inc.dv_ib_b) / inc.dt[:, None])

    def magnitudes(self) -> tuple[FloatArray, FloatArray]:
        """Sizes of specific force [m/s^2] and angular rate [rad/s], of increments mean ones. Shapes (n,)."""
        inc = self.increments() if self.kind == "increment" else None
        f, w = np.empty(len(self)), np.empty(len(self))
        for start in range(0, len(self), _BLOCK):
            k = slice(start, start + _BLOCK)
            accel, gyro = self.accel[k], self.gyro[k]
            if inc is not None:
                accel, gyro = inc.dv_ib_b[k] / inc.dt[k, None], inc.dtheta_ib_b[k] / inc.dt[k, None]
            f[k], w[k] = np.linalg.norm(accel, axis=1), np.linalg.norm(gyro, axis=1)
        return f, w

    def rotated(self, C_bs: ArrayLike) -> ImuSeries:
        """The log in other axes.

        Parameters
        ----------
        C_bs : array_like, shape (3, 3)
            Maps the present axes to the wanted ones, ``v_b = C_bs @ v_s``; a rotation, or a signed permutation.
        """
        C = as_floats(C_bs, "C_bs", (3, 3))
        if not np.allclose(C @ C.T, np.eye(3), atol=1e-6) or np.linalg.det(C) < 0.0:
            raise InputError("C_bs: expected a rotation matrix (orthonormal, determinant +1)")
        magnetometer = None if self.magnetometer is None else self.magnetometer @ C.T
        return replace(self, gyro=self.gyro @ C.T, accel=self.accel @ C.T, magnetometer=magnetometer)

    def shifted(self, seconds: float) -> ImuSeries:
        """The log with ``seconds`` added to every time stamp."""
        return replace(self, t=self.t + float(seconds))

    def between(self, start: float, stop: float) -> ImuSeries:
        """The samples with ``start <= t <= stop``. [s]"""
        keep = _run((self.t >= start - SAME_TIME) & (self.t <= stop + SAME_TIME))
        if keep.stop == keep.start:
            raise InputError(
                f"no IMU sample lies within {start:.3f}..{stop:.3f} s; the log runs {self.t[0]:.3f}..{self.t[-1]:.3f} s"
            )
        temperature, magnetometer = (None if x is None else x[keep] for x in (self.temperature, self.magnetometer))
        return ImuSeries(self.t[keep], self.gyro[keep], self.accel[keep], self.kind, temperature, magnetometer)


@dataclass(frozen=True, repr=False)
class GnssSeries(Displayed):
    """Position, and if there is one velocity, solutions of a GNSS receiver's antenna.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Time of validity. [s]
    llh : ndarray, shape (n, 3)
        Latitude, longitude [rad], **ellipsoidal** height [m].
    cov_r_n : ndarray, shape (n, 3, 3)
        Covariance of position north, east, down. [m^2]
    v_n : ndarray, shape (n, 3), optional
        Velocity north, east, down. [m/s]
    cov_v_n : ndarray, shape (n, 3, 3), optional
        Its covariance. [m^2/s^2]
    quality : ndarray of int, shape (n,), optional
        See :data:`QUALITY`.
    n_satellites : ndarray of int, shape (n,), optional
    received : ndarray, shape (n,), optional
        When the solution was delivered, for live replay. [s]
    dop : ndarray, shape (n, 2), optional
        Dilution of precision, horizontal and vertical, above 0 and below 99; NaN where it is not known, ``None`` if it
        never is. See :func:`stated_dilution`.
    """

    t: FloatArray
    llh: FloatArray
    cov_r_n: FloatArray
    v_n: FloatArray | None = None
    cov_v_n: FloatArray | None = None
    quality: IntArray | None = None
    n_satellites: IntArray | None = None
    received: FloatArray | None = None
    dop: FloatArray | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "t", check_times(self.t, "GnssSeries.t"))
        n = len(self.t)
        object.__setattr__(self, "llh", as_floats(self.llh, "GnssSeries.llh", (n, 3)))
        object.__setattr__(self, "cov_r_n", _covariances(self.cov_r_n, "GnssSeries.cov_r_n", n))
        if np.any(np.abs(self.llh[:, 0]) > 0.5 * np.pi + 1e-12):
            raise InputError(
                "GnssSeries.llh: a latitude is beyond +-90 deg; angles are radians, order lat, lon, height"
            )
        if (self.v_n is None) != (self.cov_v_n is None):
            raise InputError("GnssSeries: a velocity and its covariance are given together or not at all")
        if self.v_n is not None and self.cov_v_n is not None:
            object.__setattr__(self, "v_n", as_floats(self.v_n, "GnssSeries.v_n", (n, 3)))
            object.__setattr__(self, "cov_v_n", _covariances(self.cov_v_n, "GnssSeries.cov_v_n", n))
        if self.received is not None:
            object.__setattr__(self, "received", as_floats(self.received, "GnssSeries.received", (n,)))
        for name in ("quality", "n_satellites"):
            value = getattr(self, name)
            if value is not None:
                value = np.ascontiguousarray(value, dtype=np.int64)
                if value.shape != (n,):
                    raise InputError(f"GnssSeries.{name}: expected shape ({n},), got {value.shape}")
                object.__setattr__(self, name, value)
        if self.dop is not None:
            dop = np.ascontiguousarray(self.dop, dtype=np.float64)
            if dop.shape != (n, 2):
                raise InputError(f"GnssSeries.dop: expected shape ({n}, 2), horizontal and vertical, got {dop.shape}")
            if len(bad := dop[(dop <= 0.0) | (dop >= _NO_DILUTION)]):
                raise InputError(
                    f"GnssSeries.dop: expected numbers above 0 and below {_NO_DILUTION:g}, NaN where it is not known, "
                    f"got {bad[0]:g}; stated_dilution makes them of what receivers write"
                )
            object.__setattr__(self, "dop", dop if np.isfinite(dop).any() else None)

    def __len__(self) -> int:
        return len(self.t)

    def _headline(self) -> str:
        return f"{len(self)} epochs, {'no' if self.v_n is None else 'with'} velocity{_extent(self.t)}"

    def need_velocity(self) -> tuple[FloatArray, FloatArray]:
        """Velocities and their covariances, or an error that says they are missing. Shapes (n, 3), (n, 3, 3)."""
        if self.v_n is None or self.cov_v_n is None:
            raise InputError("this GNSS series has no velocity, which is needed here")
        return self.v_n, self.cov_v_n

    def median_dop(self) -> dict[str, float]:
        """Medians of the dilutions of precision that are known, by ``"HDOP"`` and ``"VDOP"``."""
        columns = zip(("HDOP", "VDOP"), () if self.dop is None else self.dop.T, strict=False)
        return {name: float(np.nanmedian(x)) for name, x in columns if np.isfinite(x).any()}

    def where(self, keep: ArrayLike) -> GnssSeries:
        """The epochs selected by a boolean array or an index array."""
        k = np.asarray(keep)
        pick = {
            name: None if getattr(self, name) is None else getattr(self, name)[k]
            for name in ("v_n", "cov_v_n", "quality", "n_satellites", "received", "dop")
        }
        return GnssSeries(self.t[k], self.llh[k], self.cov_r_n[k], **pick)

    def between(self, start: float, stop: float) -> GnssSeries:
        """The epochs with ``start <= t <= stop``. [s]"""
        return self.where((self.t >= start - SAME_TIME) & (self.t <= stop + SAME_TIME))


@dataclass(frozen=True, repr=False)
class OdometerSeries(Displayed):
    """Forward speed of the vehicle.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Time of validity. [s]
    speed : ndarray, shape (n,)
        Along the body's x axis, negative backwards. [m/s]
    sigma : ndarray, shape (n,)
        1-sigma error. [m/s]
    """

    t: FloatArray
    speed: FloatArray
    sigma: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "t", check_times(self.t, "OdometerSeries.t"))
        n = len(self.t)
        object.__setattr__(self, "speed", as_floats(self.speed, "OdometerSeries.speed", (n,)))
        object.__setattr__(self, "sigma", as_floats(self.sigma, "OdometerSeries.sigma", (n,)))
        if np.any(self.sigma < 0.0):
            raise InputError(f"OdometerSeries.sigma: expected no negative values, got {self.sigma.min()}")

    def __len__(self) -> int:
        return len(self.t)

    def _headline(self) -> str:
        return f"{len(self)} samples{_extent(self.t)}"


def _extent(t: FloatArray) -> str:
    return f", {t[0]:.3f}..{t[-1]:.3f} s" if len(t) else ""


def _run(keep: BoolArray) -> slice:
    """From the first to the last row of a condition that holds between two times: nothing is copied."""
    rows = np.flatnonzero(keep)
    return slice(int(rows[0]), int(rows[-1]) + 1) if len(rows) else slice(0, 0)


def _lost(dt: FloatArray, interval: float, dv: FloatArray) -> FloatArray | None:
    """Factors that stretch increments over pauses in which samples were lost; None if there are none. Shape (n,)."""
    pause = np.flatnonzero(dt > 1.5 * interval)
    size = np.linalg.norm(dv[pause], axis=1)
    lost = pause[np.abs(size - G0 * interval) < np.abs(size - G0 * dt[pause])]
    if not len(lost):
        return None
    stretch = np.ones(len(dt))
    stretch[lost] = dt[lost] / interval
    return stretch


def _covariances(value: ArrayLike, name: str, n: int) -> FloatArray:
    C = as_floats(value, name, (n, 3, 3))
    limit = 1e-9 * max(1.0, float(C.max(initial=0.0)), -float(C.min(initial=0.0)))
    if np.abs(C - C.transpose(0, 2, 1)).max(initial=0.0) > limit:
        raise InputError(f"{name}: expected symmetric matrices")
    if np.any(np.einsum("nii->ni", C) <= 0.0):
        raise InputError(
            f"{name}: expected positive variances, got {np.einsum('nii->ni', C).min()}; a receiver that reports no "
            "accuracy needs one given (option sigma)"
        )
    if not C[:, (0, 0, 1), (1, 2, 2)].any():
        return C
    doubtful = np.flatnonzero(~positive_definite(C))
    if len(doubtful):
        values = np.linalg.eigvalsh(C[doubtful])
        bad = np.flatnonzero(values[:, 0] < -_NEAR * values[:, 2])
        if len(bad):
            raise InputError(
                f"{name}: expected positive semidefinite matrices, got an eigenvalue {values[bad[0], 0]:.3g} first at "
                f"index {doubtful[bad[0]]}: a correlation is beyond +-1; leave the cross terms out (zero)"
            )
    return C


def positive_definite(cov: FloatArray) -> BoolArray:
    """Whether symmetric matrices of positive variances are positive definite, by their smallest eigenvalue.

    Parameters
    ----------
    cov : ndarray, shape (n, 3, 3)

    Returns
    -------
    ndarray of bool, shape (n,)

    Notes
    -----
    Eigenvalues are computed only where a correlation, or the determinant of the correlations, comes near to its limit.
    """
    safe = np.empty(len(cov), dtype=np.bool_)
    for start in range(0, len(cov), _BLOCK):
        block = cov[start : start + _BLOCK]
        a, b, c = (block[:, k, k] for k in range(3))
        ab, ac, bc = block[:, 0, 1], block[:, 0, 2], block[:, 1, 2]
        # squares of correlations; their determinant is 1 + 2 r_ab r_ac r_bc - the sum of the squares
        with np.errstate(all="ignore"):  # what is not a number is not safe
            squares = ab * ab / (a * b), ac * ac / (a * c), bc * bc / (b * c)
            determinant = 1.0 + 2.0 * ab * ac * bc / (a * b * c) - sum(squares)
        safe[start : start + _BLOCK] = (determinant > _NEAR) & (np.maximum.reduce(squares) < 1.0 - _NEAR)
    doubtful = np.flatnonzero(~safe)
    safe[doubtful] = np.linalg.eigvalsh(cov[doubtful]).min(axis=1) > 0.0
    return safe


@dataclass(frozen=True, repr=False)
class ScalarSeries(Displayed):
    """Measurements of one number.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Time of validity. [s]
    value : ndarray, shape (n,)
        Heading: of the body's x axis, from true north over east [rad]. Height: over the ellipsoid, or of a barometer
        over a level of its own [m].
    sigma : ndarray, shape (n,)
        1-sigma error, positive. [unit of the value]
    """

    t: FloatArray
    value: FloatArray
    sigma: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "t", check_times(self.t, "ScalarSeries.t"))
        n = len(self.t)
        object.__setattr__(self, "value", as_floats(self.value, "ScalarSeries.value", (n,)))
        object.__setattr__(self, "sigma", as_floats(self.sigma, "ScalarSeries.sigma", (n,)))
        if np.any(self.sigma <= 0.0):
            raise InputError(f"ScalarSeries.sigma: expected positive values, got {self.sigma.min()}")

    def __len__(self) -> int:
        return len(self.t)

    def _headline(self) -> str:
        return f"{len(self)} samples{_extent(self.t)}"


def stated_dilution(horizontal: ArrayLike | None, vertical: ArrayLike | None) -> FloatArray | None:
    """Dilution of precision as receivers state it, for :attr:`GnssSeries.dop`.

    Parameters
    ----------
    horizontal, vertical : array_like, shape (n,), optional
        HDOP and VDOP; zero, 99 and more (99.99 of u-blox, 655.35) and what is no number stand for one not known.

    Returns
    -------
    ndarray, shape (n, 2), or None
        NaN where one is not known; ``None`` if none is, ever.
    """
    given = [None if x is None else np.asarray(x, dtype=np.float64) for x in (horizontal, vertical)]
    shape = next((x.shape for x in given if x is not None), (0,))
    dop = np.stack([np.full(shape, np.nan) if x is None else x for x in given], axis=-1)
    stated = (dop > 0.0) & (dop < _NO_DILUTION)
    return np.where(stated, dop, np.nan) if stated.any() else None
