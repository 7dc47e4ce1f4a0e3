"""The errors of one particular IMU: what the simulator adds to ideal output and calibration takes out again.

Sensor model, for rates and mean rates alike (increments are their integrals over an interval)::

    omega_meas = b_g + (I + M_g) omega + G_g f + w_g
    f_meas     = b_a + (I + M_a) f + w_a

then clipping to the range and rounding. M holds scale-factor errors on its diagonal and cross-coupling off it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from math import sqrt
from typing import Literal, TypeAlias

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, IntArray, as_floats, readonly
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged, Displayed
from schuler.sensors.noise import NoiseModel, Start, noise_model
from schuler.sensors.response import (
    as_interval,
    as_pair,
    at_temperature,
    biases,
    clipped,
    draw_M,
    inverse_response,
    rounded,
    scaled,
)
from schuler.sensors.spec import ImuSpec

Gauge: TypeAlias = Literal["full", "lower", "upper"]

_VECTORS = (
    "b_g", "b_a", "gyro_bias_temperature", "accel_bias_temperature",
    "gyro_scale_temperature", "accel_scale_temperature",
)  # fmt: skip
_MATRICES = ("M_g", "M_a", "G_g")


def _zeros3() -> FloatArray:
    return np.zeros(3)


def _zeros33() -> FloatArray:
    return np.zeros((3, 3))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ApplyReport(Displayed):
    """True biases and clipping of :meth:`ImuErrors.apply_rates` and :meth:`ImuErrors.apply_increments`.

    Attributes
    ----------
    b_g, b_a : ndarray, shape (n, 3)
        True bias during each sample: turn-on, temperature and in-run parts, all but white noise; what a filter's bias
        state should be. [rad/s], [m/s^2]
    gyro_clipped, accel_clipped : ndarray of int, shape (3,)
        Samples cut off at the range, per axis.
    """

    b_g: FloatArray
    b_a: FloatArray
    gyro_clipped: IntArray
    accel_clipped: IntArray

    def summary(self) -> str:
        """One sentence on clipping."""
        n = len(self.b_g)
        cut = [
            f"{name} {axis}: {count} of {n}"
            for name, counts in (("gyro", self.gyro_clipped), ("accel", self.accel_clipped))
            for axis, count in zip("xyz", counts, strict=True)
            if count
        ]
        return "samples beyond the range: " + (", ".join(cut) if cut else "none")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class ImuErrors(Abridged):
    """One realisation of the errors of one IMU, in SI; the defaults are a perfect sensor.

    Attributes
    ----------
    b_g, b_a : ndarray, shape (3,)
        Turn-on bias. [rad/s], [m/s^2]
    M_g, M_a : ndarray, shape (3, 3)
        Deviation of the response from identity: rows are sensing axes, columns body axes. [-]
    G_g : ndarray, shape (3, 3)
        Sensitivity of the gyroscopes to specific force. [(rad/s)/(m/s^2)]
    gyro_bias_temperature, accel_bias_temperature : ndarray, shape (3,)
        Bias per kelvin above ``temperature_0``. [(rad/s)/K], [(m/s^2)/K]
    gyro_scale_temperature, accel_scale_temperature : ndarray, shape (3,)
        Change of the diagonal of M per kelvin above ``temperature_0``. [1/K]
    temperature_0 : float
        Temperature at which b and M hold. [degC]
    gyro_noise, accel_noise : NoiseModel
        White noise and in-run bias, the same terms on the three axes, drawn independently. [rad/s], [m/s^2]
    gyro_range, accel_range : float or None
        Largest magnitude reported. [rad/s], [m/s^2]
    gyro_resolution, accel_resolution : float or None
        Least significant bit of a rate sample. [rad/s], [m/s^2]
    gyro_quantum, accel_quantum : float or None
        Pulse size of an increment. [rad], [m/s]

    Notes
    -----
    Gauge: M is relative to the body axes in which the true omega and f are given, so all nine elements count. A
    calibration that knows its references only by magnitude finds M up to a rotation of those axes and has to fix three
    of the nine: lower triangular M_a puts x along the x accelerometer and y into the plane of x and y (Hayal 3.17),
    upper triangular puts z along the z accelerometer (Yaman 2-114, whose text says x although the matrix says z).
    Bring both to one gauge before comparing.

    References
    ----------
    Groves (2013), section 4.4.6; Yaman (2017), eqs. (2-113) to (2-119).
    """

    b_g: FloatArray = field(default_factory=_zeros3)
    b_a: FloatArray = field(default_factory=_zeros3)
    M_g: FloatArray = field(default_factory=_zeros33)
    M_a: FloatArray = field(default_factory=_zeros33)
    G_g: FloatArray = field(default_factory=_zeros33)
    gyro_bias_temperature: FloatArray = field(default_factory=_zeros3)
    accel_bias_temperature: FloatArray = field(default_factory=_zeros3)
    gyro_scale_temperature: FloatArray = field(default_factory=_zeros3)
    accel_scale_temperature: FloatArray = field(default_factory=_zeros3)
    temperature_0: float = 25.0
    gyro_noise: NoiseModel = field(default_factory=NoiseModel)
    accel_noise: NoiseModel = field(default_factory=NoiseModel)
    gyro_range: float | None = None
    accel_range: float | None = None
    gyro_resolution: float | None = None
    accel_resolution: float | None = None
    gyro_quantum: float | None = None
    accel_quantum: float | None = None

    def __post_init__(self) -> None:
        for name, shape in [(v, (3,)) for v in _VECTORS] + [(m, (3, 3)) for m in _MATRICES]:
            # a copy, so that freezing it does not freeze the caller's array
            object.__setattr__(self, name, readonly(as_floats(getattr(self, name), name, shape).copy()))
        for entry in fields(self):
            value = getattr(self, entry.name)
            if entry.name.endswith(("_range", "_resolution", "_quantum")) and value is not None and not value > 0.0:
                raise InputError(f"{entry.name}: expected a positive number or None, got {value!r}")

    @classmethod
    def none(cls) -> ImuErrors:
        """A perfect IMU."""
        return cls()

    @classmethod
    def draw(
        cls,
        spec: ImuSpec,
        rng: np.random.Generator,
        *,
        gauge: Gauge = "full",
        start: Start = "stationary",
        temperature_0: float = 25.0,
    ) -> ImuErrors:
        """One IMU of the kind that ``spec`` describes, switched on once.

        Parameters
        ----------
        spec : ImuSpec
        rng : numpy.random.Generator
            The number and order of draws do not depend on ``spec``: the same seed gives the same normalised errors for
            every IMU, so that comparisons of IMUs share their luck.
        gauge : {"full", "lower", "upper"}
            Which elements of M_a exist: all, or those on and below (above) the diagonal because the accelerometers
            define the body axes. M_g is always full.
        start : {"stationary", "zero"}
            Start of the in-run Gauss-Markov biases.
        temperature_0 : float
            [degC]

        Returns
        -------
        ImuErrors
            Independent normal errors of the given standard deviations; each of the six off-diagonal elements of M and
            the nine of G_g has the full standard deviation. Q becomes a pulse of ``sqrt(12) Q``.

        Raises
        ------
        InputError
            If the gauge or start is unknown.
        """
        if gauge not in ("full", "lower", "upper"):
            raise InputError(f"gauge: expected 'full', 'lower' or 'upper', got {gauge!r}")
        z = rng.standard_normal((2, 6, 3))
        z_G = rng.standard_normal((3, 3))
        M_a = draw_M(spec.accel, z[1])
        return cls(
            b_g=spec.gyro.turn_on_bias * z[0, 0],
            b_a=spec.accel.turn_on_bias * z[1, 0],
            M_g=draw_M(spec.gyro, z[0]),
            M_a=M_a if gauge == "full" else np.tril(M_a) if gauge == "lower" else np.triu(M_a),
            G_g=spec.gyro.g_sensitivity * z_G,
            gyro_bias_temperature=spec.gyro.bias_temperature * z[0, 4],
            accel_bias_temperature=spec.accel.bias_temperature * z[1, 4],
            gyro_scale_temperature=spec.gyro.scale_temperature * z[0, 5],
            accel_scale_temperature=spec.accel.scale_temperature * z[1, 5],
            temperature_0=temperature_0,
            gyro_noise=noise_model(spec.gyro, start),
            accel_noise=noise_model(spec.accel, start),
            gyro_range=spec.gyro.range,
            accel_range=spec.accel.range,
            gyro_resolution=spec.gyro.resolution,
            accel_resolution=spec.accel.resolution,
            gyro_quantum=sqrt(12.0) * spec.gyro.quantisation or None,
            accel_quantum=sqrt(12.0) * spec.accel.quantisation or None,
        )

    def apply_rates(
        self,
        gyro: ArrayLike,
        accel: ArrayLike,
        dt: float,
        rng: np.random.Generator,
        temperature: ArrayLike | None = None,
    ) -> tuple[FloatArray, FloatArray, ApplyReport]:
        """Corrupt ideal rates.

        Parameters
        ----------
        gyro, accel : array_like, shape (n, 3)
            True angular rate [rad/s] and specific force [m/s^2] in body axes, as means over the sampling intervals.
        dt : float
            Sampling interval. [s]
        rng : numpy.random.Generator
            For the noise; gyroscopes and accelerometers, white and in-run parts draw from children of their own.
        temperature : array_like, shape () or (n,), optional
            Without it the temperature terms are left out. [degC]

        Returns
        -------
        gyro, accel : ndarray, shape (n, 3)
            What the sensors report. [rad/s], [m/s^2]
        report : ApplyReport
            True biases and clipping.

        Raises
        ------
        InputError
            If shapes disagree or dt is no positive number.

        Notes
        -----
        White noise has standard deviation ``N / sqrt(dt)``. In-run biases are constant within a sample. A resolution
        rounds each sample by itself; only where there is none does a quantum round the sum, as in
        :meth:`apply_increments`.
        """
        omega, f, report = self._corrupt(gyro, accel, 1.0, dt, rng, temperature)
        omega = rounded(omega, self.gyro_resolution, scaled(self.gyro_quantum, 1.0 / dt))
        f = rounded(f, self.accel_resolution, scaled(self.accel_quantum, 1.0 / dt))
        return omega, f, report

    def apply_increments(
        self,
        dtheta: ArrayLike,
        dv: ArrayLike,
        dt: float,
        rng: np.random.Generator,
        temperature: ArrayLike | None = None,
    ) -> tuple[FloatArray, FloatArray, ApplyReport]:
        """Corrupt ideal increments.

        Parameters
        ----------
        dtheta, dv : array_like, shape (n, 3)
            True integrals of angular rate [rad] and specific force [m/s] in body axes over intervals ``dt``.
        dt : float
            Sampling interval, the same for all. [s]
        rng, temperature
            As for :meth:`apply_rates`; the same generator state gives the same errors.

        Returns
        -------
        dtheta, dv : ndarray, shape (n, 3)
            What the sensors report. [rad], [m/s]
        report : ApplyReport
            True biases (as rates) and clipping (of the mean rate).

        Raises
        ------
        InputError
            If shapes disagree or dt is no positive number.

        Notes
        -----
        White noise has standard deviation ``N sqrt(dt)``. Rounding, in pulses of the quantum or else of
        ``resolution * dt``, carries its remainder to the next interval, so it adds no drift.
        """
        dtheta, dv, report = self._corrupt(dtheta, dv, dt, dt, rng, temperature)
        dtheta = rounded(dtheta, None, self.gyro_quantum or scaled(self.gyro_resolution, dt))
        dv = rounded(dv, None, self.accel_quantum or scaled(self.accel_resolution, dt))
        return dtheta, dv, report

    def compensate_rates(
        self, gyro: ArrayLike, accel: ArrayLike, temperature: ArrayLike | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Take the deterministic errors out of measured rates.

        Parameters
        ----------
        gyro, accel : array_like, shape (n, 3)
            Measured angular rate [rad/s] and specific force [m/s^2].
        temperature : array_like, shape () or (n,), optional
            [degC]

        Returns
        -------
        gyro, accel : ndarray, shape (n, 3)
            ``f = (I + M_a)^-1 (f_meas - b_a)``, ``omega = (I + M_g)^-1 (omega_meas - b_g - G_g f)``: the exact inverse
            of :meth:`apply_rates` without noise, rounding and clipping. [rad/s], [m/s^2]

        Raises
        ------
        InputError
            If shapes disagree or I + M cannot be inverted.

        References
        ----------
        Inverse of Yaman (2017), eqs. (2-113) and (2-117).
        """
        return self._compensate(gyro, accel, 1.0, temperature)

    def compensate_increments(
        self, dtheta: ArrayLike, dv: ArrayLike, dt: float, temperature: ArrayLike | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Take the deterministic errors out of measured increments [rad], [m/s]; see :meth:`compensate_rates`.

        Parameters
        ----------
        dtheta, dv : array_like, shape (n, 3)
            Measured increments. [rad], [m/s]
        dt : float
            Length of the intervals. [s]
        temperature : array_like, shape () or (n,), optional
            [degC]

        Returns
        -------
        dtheta, dv : ndarray, shape (n, 3)
            [rad], [m/s]

        Raises
        ------
        InputError
            If shapes disagree, dt is no positive number or I + M cannot be inverted.
        """
        return self._compensate(dtheta, dv, as_interval(dt), temperature)

    def _corrupt(
        self,
        gyro: ArrayLike,
        accel: ArrayLike,
        h: float,
        dt: float,
        rng: np.random.Generator,
        temperature: ArrayLike | None,
    ) -> tuple[FloatArray, FloatArray, ApplyReport]:
        """The model with inputs and outputs that are ``h`` times a rate."""
        omega, f = as_pair(gyro, accel)
        warmth = self._warmth(temperature, len(omega))
        dt = as_interval(dt)
        b_g, w_g = biases(self.b_g, self.gyro_bias_temperature, self.gyro_noise, warmth, len(omega), dt, rng)
        omega_meas = omega + omega @ self.M_g.T + f @ self.G_g.T + (b_g + w_g) * h
        del w_g  # of a day at 200 Hz 410 MB
        b_a, w_a = biases(self.b_a, self.accel_bias_temperature, self.accel_noise, warmth, len(omega), dt, rng)
        f_meas = f + f @ self.M_a.T + (b_a + w_a) * h
        del w_a
        if warmth is not None:
            omega_meas += omega * (warmth * self.gyro_scale_temperature)
            f_meas += f * (warmth * self.accel_scale_temperature)
        omega_meas, gyro_clipped = clipped(omega_meas, scaled(self.gyro_range, h))
        f_meas, accel_clipped = clipped(f_meas, scaled(self.accel_range, h))
        return omega_meas, f_meas, ApplyReport(b_g, b_a, gyro_clipped, accel_clipped)

    def _compensate(
        self, gyro: ArrayLike, accel: ArrayLike, h: float, temperature: ArrayLike | None
    ) -> tuple[FloatArray, FloatArray]:
        omega, f = as_pair(gyro, accel)
        warmth = self._warmth(temperature, len(omega))
        b_g = at_temperature(self.b_g, self.gyro_bias_temperature, warmth)
        b_a = at_temperature(self.b_a, self.accel_bias_temperature, warmth)
        f = inverse_response(self.M_a, self.accel_scale_temperature, warmth, f - h * b_a)
        return inverse_response(self.M_g, self.gyro_scale_temperature, warmth, omega - h * b_g - f @ self.G_g.T), f

    def _warmth(self, temperature: ArrayLike | None, n: int) -> FloatArray | None:
        """Temperature above the reference, shape (n, 1) or (1, 1). [K]"""
        if temperature is None:
            return None
        t = as_floats(temperature, "temperature")
        if t.shape not in ((), (1,), (n,)):
            raise InputError(f"temperature: expected one value or shape ({n},), got {t.shape}")
        return t.reshape(-1, 1) - self.temperature_0
