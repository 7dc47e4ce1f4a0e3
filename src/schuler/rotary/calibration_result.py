"""Gyroscope errors that a rotation of the platform has shown: biases, and responses to a rate about its axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.plotting.notebook import Displayed
from schuler.recording.series import Increments
from schuler.sensors.errors import ImuErrors
from schuler.units import DEG, DEG_PER_HR, PPM

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Du's strategies of compensation: nothing, biases (I), biases and responses (II).
Strategy = Literal["none", "I", "II"]
_LETTERS = "xyz"


class Stretch(NamedTuple):
    """Mean over a stretch of constant platform rate, IMU axes.

    Attributes
    ----------
    start, stop : float
        [s]
    reading : ndarray, shape (3,)
        Mean of the gyroscopes. [rad/s]
    expected : ndarray, shape (3,)
        True rate there: the platform's and the Earth's. [rad/s]
    platform : ndarray, shape (3,)
        The platform's alone. [rad/s]
    """

    start: float
    stop: float
    reading: FloatArray
    expected: FloatArray
    platform: FloatArray

    @property
    def duration(self) -> float:
        """[s]"""
        return self.stop - self.start


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RotationCalibration(Displayed):
    """Biases and responses of gyroscopes with their covariance.

    The model is ``reading = omega + bias + sum_a response_a (axis_a . omega)``: with an axis along z the response is
    the third column of M, Du's ``[K_gxz, K_gyz, K_gz]`` in the axes of the IMU.

    Attributes
    ----------
    axes : ndarray, shape (m, 3)
        Orthonormal directions about which there was rotation, IMU axes.
    bias : ndarray, shape (3,)
        [rad/s]
    response : ndarray, shape (m, 3)
        Row a: what the three gyroscopes show too much for a unit rate about axis a. [-]
    covariance : ndarray, shape (3 + 3 m, 3 + 3 m)
        Covariance of bias, then of the rows of response.
    random_walk : ndarray, shape (3,)
        Noise that weights and covariance are from. [rad/sqrt(s)]
    chi_square : float
        Weighted sum of squared residuals of the stretches.
    degrees : int
        Its degrees of freedom; zero if nothing is left over.
    stretches : tuple of Stretch
    notes : tuple of str
        Sentences on what was left out or is doubtful.
    """

    axes: FloatArray
    bias: FloatArray
    response: FloatArray
    covariance: FloatArray
    random_walk: FloatArray
    chi_square: float
    degrees: int
    stretches: tuple[Stretch, ...]
    notes: tuple[str, ...] = ()

    @property
    def sigma_bias(self) -> FloatArray:
        """1-sigma of the biases. Shape (3,). [rad/s]"""
        return np.asarray(np.sqrt(np.diag(self.covariance)[:3]))

    @property
    def sigma_response(self) -> FloatArray:
        """1-sigma of the responses. Shape (m, 3). [-]"""
        return np.asarray(np.sqrt(np.diag(self.covariance)[3:]).reshape(-1, 3))

    @property
    def M(self) -> FloatArray:
        """Responses as error matrix of :class:`~schuler.sensors.errors.ImuErrors`. Shape (3, 3). [-]"""
        return np.asarray(self.response.T @ self.axes)

    @property
    def names(self) -> tuple[str, ...]:
        """Names in the order of the covariance: ``b_g_x``, ..., then ``M_g_xz``, ... or ``response_1_x``, ..."""
        names = [f"b_g_{i}" for i in _LETTERS]
        for k, axis in enumerate(self.axes):
            along = np.flatnonzero(np.abs(axis) > 1.0 - 1e-9)
            if len(along) and axis[along[0]] > 0.0:
                names += [f"M_g_{i}{_LETTERS[along[0]]}" for i in _LETTERS]
            else:
                names += [f"response_{k + 1}_{i}" for i in _LETTERS]
        return tuple(names)

    @property
    def scatter(self) -> float:
        """Root of chi-square per degree of freedom: 1 where white noise explains the stretches; NaN without any."""
        return float(np.sqrt(self.chi_square / self.degrees)) if self.degrees else float("nan")

    def sigma_at(self, omega: FloatArray) -> FloatArray:
        """1-sigma of what is left of the gyroscopes' errors at a rate (3,) once compensated. Shape (3,). [rad/s]"""
        h = np.concatenate(([1.0], self.axes @ np.asarray(omega, dtype=np.float64)))
        blocks = self.covariance.reshape(len(h), 3, len(h), 3)
        variance = np.einsum("a,aibi,b->i", h, blocks, h)
        return np.asarray(np.sqrt(variance))

    def errors(self, strategy: Strategy = "II") -> ImuErrors:
        """As errors of an IMU, for compensation and for simulation. Accelerometers are taken as perfect."""
        if strategy not in ("none", "I", "II"):
            raise InputError(f"strategy: expected 'none', 'I' (biases) or 'II' (responses too), got {strategy!r}")
        if strategy == "none":
            return ImuErrors()
        return ImuErrors(b_g=self.bias) if strategy == "I" else ImuErrors(b_g=self.bias, M_g=self.M)

    def compensated(self, increments: Increments, strategy: Strategy = "II") -> Increments:
        """Take the errors out of a log in IMU axes.

        Parameters
        ----------
        increments : Increments
        strategy : {"none", "I", "II"}
            I: biases only. II: also responses, ``(I + M)^-1 (reading - bias)``.

        Notes
        -----
        Du multiplies the responses by the platform's rate; the measured rate about the axis, used here, is the same at
        rest and right on a vehicle that turns.
        """
        if strategy == "none":
            return increments
        own = self.errors(strategy)
        step = increments.dt[:, None]
        turned = (increments.dtheta_ib_b - own.b_g * step) @ np.linalg.inv(np.eye(3) + own.M_g).T
        return Increments(increments.t, increments.dt, turned, increments.dv_ib_b)

    def summary(self) -> str:
        """Some lines: values with 1-sigma, how well the model fits, notes."""
        moving = [s for s in self.stretches if np.linalg.norm(s.platform) > 0.0]
        rates = sorted({round(float(np.linalg.norm(s.platform)) / DEG, 3) for s in moving})
        lines = [
            f"Calibration by rotation: {sum(s.duration for s in self.stretches):.4g} s, of which "
            f"{sum(s.duration for s in moving):.4g} s turning at {', '.join(f'{r:g}' for r in rates)} deg/s"
        ]
        values = np.concatenate((self.bias, self.response.ravel()))
        for name, value, sigma in zip(self.names, values, np.sqrt(np.diag(self.covariance)), strict=True):
            unit, scale = ("deg/h", DEG_PER_HR) if name.startswith("b_g") else ("ppm", PPM)
            lines.append(f"  {name}: {value / scale:.2f} +- {sigma / scale:.2f} {unit}")
        if self.degrees:
            lines.append(
                f"  stretches scatter {self.scatter:.2f} times as much as white noise explains "
                f"({self.degrees} degrees of freedom)"
            )
        return "\n".join([*lines, *(f"  note: {note}" for note in self.notes)])

    def plot(self) -> Figure:
        """Means of the stretches beside the model, an axis of the gyroscopes each (matplotlib)."""
        from schuler.plotting.drawing import draw
        from schuler.rotary.report import calibration_figure

        return draw(calibration_figure(self))
