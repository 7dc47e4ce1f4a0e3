"""What a calibration finds out: parameters with covariance, how good they are, and what to do about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from schuler.arguments import explains_arguments
from schuler.arrays import FloatArray, as_floats, readonly
from schuler.calibration.result.parameters import (
    BIAS_M,
    GAUGES,
    LINEAR,
    MATRIX_M,
    Gauge,
    imu_errors,
    in_gauge,
    rotation_to,
    unit,
    vector,
)  # fmt: skip
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged, Displayed
from schuler.recording.series import ImuSeries
from schuler.sensors.errors import ImuErrors

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from schuler.calibration.result.comparison import Difference

Status: TypeAlias = Literal["ok", "warning", "refused"]

# elements that a gauge holds at zero
_ZEROS = {"lower": ("M_a_xy", "M_a_xz", "M_a_yz"), "upper": ("M_a_yx", "M_a_zx", "M_a_zy")}


@dataclass(frozen=True, eq=False, repr=False)
class Residuals(Abridged):
    """What is left per pose or turn after the fit.

    Attributes
    ----------
    label : tuple of str
        Such as ``"pose 3 (12.0..15.0 s)"``.
    value : ndarray, shape (n,)
        In the unit of the condition. [unit]
    sigma : ndarray, shape (n,)
        1-sigma that was expected of each. [unit]
    unit : str
    before : ndarray, shape (n,), or None
        The same with the uncalibrated sensor.
    direction : ndarray, shape (n, 3), or None
        Where the reference pointed, unit vectors in body axes, for the picture of the sphere.
    """

    label: tuple[str, ...]
    value: FloatArray
    sigma: FloatArray
    unit: str
    before: FloatArray | None = None
    direction: FloatArray | None = None

    @property
    def rms(self) -> float:
        """Root mean square. [unit]"""
        return float(np.sqrt(np.mean(np.square(self.value)))) if len(self.value) else float("nan")


@dataclass(frozen=True, eq=False, repr=False)
class CalibrationResult(Displayed):
    """Errors of an IMU as calibrated.

    Attributes
    ----------
    method : str
        ``sixposition``, ``multiposition``, ``freepose``, ``ratetable``, ``ferraris``, ``thermal``, ``field``.
    names : tuple of str
        Parameters that were estimated, see :mod:`schuler.calibration.result.parameters`.
    values : ndarray, shape (p,)
        SI, of an input multiplied with ``nominal``.
    covariance : ndarray, shape (p, p)
        SI. Infinite variances mean: not determined.
    gauge : {"full", "lower", "upper", "symmetric"}
        Which body axes the parameters refer to; ``GAUGES[gauge]`` says it in words.
    fixed : dict of str to float
        Parameters that were held at given values instead.
    nominal : (float, float)
        Factors of accelerometer [m/s^2 per unit of the log] and gyroscope [rad/s per unit of the log] that were applied
        before anything else; 1 for a log in SI.
    status : {"ok", "warning", "refused"}
    verdicts : tuple of str
        Sentences: what is not determined and what to do; what is suspicious.
    condition : float
        Condition number of the normal matrix with unit diagonal.
    prior_sigma : dict of str to float
        What was known before, 1 sigma, for the observability of each parameter; empty if nothing was stated.
    variance_of_unit_weight : float
        Weighted residuals squared over degrees of freedom; 1 if noise and model are right, NaN without redundancy.
    freedom : int
        Degrees of freedom.
    residuals : dict of str to Residuals
        By condition: ``accel``, ``gyro``, ...
    next_pose : str
        What to collect next, in words; empty if there is no advice.
    temperature : float or None
        Mean temperature of the log. [degC]
    history : ndarray, shape (k, p), or None
        Parameters by iteration.
    extra : dict
        What only one method has (temperature tables, delays, ...); plain numbers, strings, lists.
    provenance : dict
        Version, options, sources and their SHA-256.
    """

    method: str
    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    gauge: Gauge
    fixed: dict[str, float] = field(default_factory=dict)
    nominal: tuple[float, float] = (1.0, 1.0)
    status: Status = "ok"
    verdicts: tuple[str, ...] = ()
    condition: float = float("nan")
    prior_sigma: dict[str, float] = field(default_factory=dict)
    variance_of_unit_weight: float = float("nan")
    freedom: int = 0
    residuals: dict[str, Residuals] = field(default_factory=dict)
    next_pose: str = ""
    temperature: float | None = None
    history: FloatArray | None = None
    extra: dict[str, Any] = field(default_factory=dict)
    provenance: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        p = len(self.names)
        if len(set(self.names)) != p or set(self.names) & set(self.fixed):
            raise InputError(f"names: expected each once, estimated or fixed, got {self.names}, {self.fixed}")
        for name in (*self.names, *self.fixed):
            unit(name)
        values = as_floats(self.values, "values", (p,))
        object.__setattr__(self, "values", readonly(values.copy()))
        covariance = np.asarray(self.covariance, dtype=np.float64)
        if covariance.shape != (p, p) or np.isnan(covariance).any() or (np.diag(covariance) < 0.0).any():
            raise InputError(f"covariance: expected shape ({p}, {p}) without NaN or negative variances")
        determined = np.isfinite(np.diag(covariance))
        part, spread = covariance[np.ix_(determined, determined)], np.sqrt(np.diag(covariance)[determined])
        if (np.abs(part - part.T) > 1e-6 * np.outer(spread, spread)).any():
            raise InputError("covariance: expected a symmetric matrix")
        object.__setattr__(self, "covariance", readonly(0.5 * (covariance + covariance.T)))
        if self.gauge not in GAUGES:
            raise InputError(f"gauge: expected one of {', '.join(GAUGES)}, got {self.gauge!r}")

    def __getitem__(self, name: str) -> tuple[float, float]:
        """Value and 1-sigma uncertainty of a parameter by name; a fixed one has none."""
        if name in self.fixed:
            return self.fixed[name], 0.0
        if name not in self.names:
            raise InputError(f"name: expected one of {', '.join((*self.names, *self.fixed))}, got {name!r}")
        i = self.names.index(name)
        return float(self.values[i]), float(self.sigma[i])

    @property
    def sigma(self) -> FloatArray:
        """1-sigma uncertainty of the parameters. Shape (p,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def correlation(self) -> FloatArray:
        """Correlation of the parameters. Shape (p, p); zero where a variance is zero or infinite."""
        s = self.sigma
        usable = np.isfinite(s) & (s > 0.0)
        scale = np.where(usable, s, 1.0)
        C = np.where(np.outer(usable, usable), self.covariance, 0.0) / np.outer(scale, scale)
        np.fill_diagonal(C, 1.0)
        return np.asarray(C)

    @property
    def observability(self) -> dict[str, float]:
        """Uncertainty left over what was known before, by parameter: 0 is found out, 1 is nothing learnt."""
        return {n: self[n][1] / s for n, s in self.prior_sigma.items() if n in self.names and s > 0.0}

    @property
    def parameters(self) -> dict[str, float]:
        """Values by name, estimated and fixed."""
        return dict(zip(self.names, (float(v) for v in self.values), strict=True)) | self.fixed

    @property
    def errors(self) -> ImuErrors:
        """The errors as the simulator and the filter take them."""
        return imu_errors(self.parameters, 25.0 if self.temperature is None else self.temperature)

    @explains_arguments
    def apply(self, imu: ImuSeries) -> ImuSeries:
        """A log with the errors taken out.

        Parameters
        ----------
        imu : ImuSeries
            As recorded, in the units of the calibrated log (SI, or counts if ``nominal`` says so).

        Returns
        -------
        ImuSeries
            ``f = (I + M_a)^-1 (s_a y_a - b_a)``, ``omega = (I + M_g)^-1 (s_g y_g - b_g - G_g f)``, SI; rates or
            increments as they came; ``m = (I + M_m)^-1 (s_m y_m - b_m)`` of a calibrated magnetometer. A thermal
            calibration takes biases and M_a at the temperature of every sample, if the log has one.

        Raises
        ------
        InputError
            If I + M cannot be inverted, or a temperature is outside of the range of a thermal calibration.
        """
        if "thermal" in self.extra and imu.temperature is not None:
            from schuler.calibration.thermal.correction import compensate_thermal

            return compensate_thermal(self, imu)
        accel, gyro = imu.accel * self.nominal[0], imu.gyro * self.nominal[1]
        if imu.kind == "increment":
            gyro, accel = self.errors.compensate_increments(gyro, accel, imu.interval)
        else:
            gyro, accel = self.errors.compensate_rates(gyro, accel)
        return replace(imu, gyro=gyro, accel=accel, magnetometer=self._magnetic_field(imu))

    def _magnetic_field(self, imu: ImuSeries) -> FloatArray | None:
        """Field in body axes of a log with a magnetometer [T]; its readings if they are not calibrated."""
        if imu.magnetometer is None or MATRIX_M[0] not in self.names:
            return imu.magnetometer
        p = self.parameters
        A = np.eye(3) + np.array([p[n] for n in MATRIX_M]).reshape(3, 3)
        factor = float(self.extra.get("magnetometer", {}).get("nominal", 1.0))
        return np.asarray(np.linalg.solve(A, (factor * imu.magnetometer - [p[n] for n in BIAS_M]).T).T)

    @explains_arguments
    def inverse(self, imu: ImuSeries) -> ImuSeries:
        """What the sensor would have read: the errors put back, without noise; the inverse of :meth:`apply`."""
        h = imu.interval if imu.kind == "increment" else 1.0
        e = self.errors
        gyro = imu.gyro @ (np.eye(3) + e.M_g).T + imu.accel @ e.G_g.T + h * e.b_g
        accel = imu.accel @ (np.eye(3) + e.M_a).T + h * e.b_a
        return replace(imu, gyro=gyro / self.nominal[1], accel=accel / self.nominal[0])

    def in_gauge(self, gauge: Gauge) -> CalibrationResult:
        """The same calibration with other body axes, covariance included.

        Parameters
        ----------
        gauge : {"lower", "upper", "symmetric"}

        Returns
        -------
        CalibrationResult
            With all elements of the matrices that can differ from zero in the new axes; those that cannot are fixed at
            zero. Covariance by the derivative of the change, taken numerically; what is not determined stays so and is
            left out of the derivative. What was known before is dropped for elements that turn, so are iterations.
            Places of accelerometers (``r_a``) and ``extra`` stay as they are; places are off by the angle of the turn.

        Raises
        ------
        InputError
            If the gauge is unknown, or M_g does not refer to the axes of M_a.
        """
        if gauge == self.gauge:
            return self
        # as calibrate_multiposition leaves it
        if self.method == "multiposition" and "gyro" in self.extra and "turn" not in self.extra:
            raise InputError(
                "gauge: M_g of this calibration is in the gyroscopes' own axes, magnitudes having told nothing on the "
                "rotation between the triads; calibrate with between_triads=True, or change the gauge of a result "
                "without gyroscopes"
            )
        families = {n[:3] for n in (*self.names, *self.fixed)}
        names = [n for n in LINEAR if n[:3] in families]
        others = [n for n in self.names if n not in LINEAR]

        def changed(values: FloatArray) -> FloatArray:
            named = dict(zip(self.names, values, strict=True)) | self.fixed
            errors = imu_errors(named)
            if MATRIX_M[0] in named:  # a magnetometer is in the same body axes
                A = np.eye(3) + np.array([named[n] for n in MATRIX_M]).reshape(3, 3)
                turned = A @ rotation_to(errors.M_a, gauge).T - np.eye(3)
                named |= dict(zip(MATRIX_M, turned.ravel(), strict=True))
            return np.concatenate((vector(in_gauge(errors, gauge), names), [named[n] for n in others]))

        J = np.empty((len(names) + len(others), len(self.names)))
        for i in range(len(self.names)):
            h = np.zeros(len(self.names))
            h[i] = 1e-6
            J[:, i] = (changed(self.values + h) - changed(self.values - h)) / 2e-6
        determined = np.isfinite(self.sigma)
        covariance = J[:, determined] @ self.covariance[np.ix_(determined, determined)] @ J[:, determined].T
        lost = (np.abs(J[:, ~determined]) > 1e-3).any(axis=1)
        covariance[lost, lost] = np.inf
        values = changed(self.values)
        # by the gauge itself or because nothing they depend on is uncertain; not by size, which noise of J could pass
        zero = np.array([n in _ZEROS.get(gauge, ()) for n in (*names, *others)], dtype=bool)
        keep = ~zero & (np.diag(covariance) > 0.0)
        keep[len(names) :] = True
        held = dict(zip(names, np.where(zero, 0.0, values).tolist(), strict=False))
        C = rotation_to(self.errors.M_a, gauge)
        return replace(
            self,
            names=tuple(n for n, k in zip([*names, *others], keep, strict=True) if k),
            values=values[keep],
            covariance=covariance[np.ix_(keep, keep)],
            gauge=gauge,
            fixed={n: held[n] for n, k in zip(names, keep, strict=False) if not k}
            | {n: v for n, v in self.fixed.items() if n not in LINEAR},
            prior_sigma={n: s for n, s in self.prior_sigma.items() if n[:2] not in ("M_", "G_", "r_")},
            residuals={
                name: r if r.direction is None else replace(r, direction=r.direction @ C.T)
                for name, r in self.residuals.items()
            },
            history=None,
        )

    def compare(self, other: CalibrationResult) -> Difference:
        """What changed between two calibrations of one unit beyond its uncertainty; see :mod:`.comparison`."""
        from schuler.calibration.result.comparison import compare

        return compare(self, other)

    def summary(self) -> str:
        """Parameters with uncertainty in data-sheet units, verdicts, residuals, as text."""
        from schuler.calibration.result.summary import summary

        return summary(self)

    def _headline(self) -> str:
        from schuler.calibration.result.summary import headline

        return headline(self)

    def _facts(self) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
        from schuler.calibration.result.summary import rows

        return ("parameter", "value", "1 sigma", "unit"), [row[:4] for row in rows(self)]

    def plot(self, **options: Any) -> Figure:
        """Residuals per pose, sphere coverage, parameters with 1 sigma (matplotlib)."""
        from schuler.calibration.report.figures import calibration_figure

        return calibration_figure(self, **options)

    def report(self, path: Path | str, **options: Any) -> Path:
        """Write one self-contained HTML page, see :mod:`schuler.calibration.report.document`."""
        from schuler.calibration.report.document import calibration_report

        return calibration_report(self, path, **options)

    def to_yaml(self, path: Path | str) -> Path:
        """Write as a versioned YAML file, see :mod:`schuler.calibration.result.result_file`."""
        from schuler.calibration.result.result_file import write_result

        return write_result(self, path)

    @staticmethod
    def from_yaml(path: Path | str) -> CalibrationResult:
        """Read such a file."""
        from schuler.calibration.result.result_file import read_result

        return read_result(path)


def result_from(
    method: str, parameters: Mapping[str, tuple[float, float]], gauge: Gauge, **rest: Any
) -> CalibrationResult:
    """A result from values and independent uncertainties by name, for tests and for numbers from a data sheet."""
    names = tuple(parameters)
    values = np.array([parameters[n][0] for n in names])
    sigma = np.array([parameters[n][1] for n in names])
    return CalibrationResult(method, names, values, np.diag(sigma**2), gauge, **rest)
