"""Error budgets of inertial sensors: what a data sheet promises, in SI and as 1-sigma values.

The only place in this layer where other units occur are the keywords of :meth:`TriadSpec.gyro` and
:meth:`TriadSpec.accelerometer` (of ``sheets``); each names its unit. ``x`` stands for rad/s (gyroscope) or m/s^2
(accelerometer).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal, TypeAlias, Unpack

from schuler.exceptions import InputError
from schuler.plotting.notebook import Displayed
from schuler.sensors.sheets import (
    ACCEL_UNITS,
    ALLAN_FLICKER,
    GYRO_UNITS,
    AccelerometerSheet,
    GyroSheet,
    check_entries,
    magnitude,
    read_sheet,
)

Density: TypeAlias = Literal["one-sided", "two-sided"]


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class TriadSpec:
    """Error budget of one triad: 1-sigma values in SI, the same for its three axes; letters as in IEEE Std 952.

    Attributes
    ----------
    random_walk : float
        N, white-noise root density, two-sided: a sample at rate f has standard deviation ``N sqrt(f)``. [x/sqrt(Hz)]
    bias_instability : float
        B, coefficient of the 1/f noise; the Allan deviation is flat at :func:`allan_minimum` (B), not at B. [x]
    rate_random_walk : float
        K. [x*sqrt(Hz)]
    rate_ramp : float
        R. [x/s]
    quantisation : float
        Q, of the increments: a pulse of size q gives ``Q = q / sqrt(12)``. [x*s]
    turn_on_bias : float
        Constant within a run, new at each switch-on. [x]
    in_run_bias, in_run_time : float
        Standard deviation [x] and correlation time [s] of a first-order Gauss-Markov bias; both or neither.
    scale_factor : float
        Linear. [-]
    misalignment : float
        Per off-diagonal element, non-orthogonality and misalignment together. [rad]
    g_sensitivity : float
        Per element of the 3x3 matrix, gyroscopes only. [(rad/s)/(m/s^2)]
    bias_temperature : float
        Slope of the bias. [x/K]
    scale_temperature : float
        Slope of the scale factor. [1/K]
    range : float or None
        Largest magnitude the sensor reports; None is unlimited. [x]
    resolution : float or None
        Least significant bit of a rate sample; None is a continuous output. [x]

    Raises
    ------
    InputError
        If a value is negative or not finite, only one of the two in-run values is given, or a range or resolution is
        zero. Leave a field out rather than setting it to NaN.
    """

    random_walk: float
    bias_instability: float = 0.0
    rate_random_walk: float = 0.0
    rate_ramp: float = 0.0
    quantisation: float = 0.0
    turn_on_bias: float = 0.0
    in_run_bias: float = 0.0
    in_run_time: float = 0.0
    scale_factor: float = 0.0
    misalignment: float = 0.0
    g_sensitivity: float = 0.0
    bias_temperature: float = 0.0
    scale_temperature: float = 0.0
    range: float | None = None
    resolution: float | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is not None:
                object.__setattr__(self, field.name, magnitude(value, field.name))
            elif field.default is not None:
                raise InputError(f"{field.name}: expected a number, got None")
        for name in ("range", "resolution"):
            if getattr(self, name) == 0.0:
                raise InputError(f"{name}: expected a positive number or None for no limit, got 0")
        if (self.in_run_bias > 0.0) != (self.in_run_time > 0.0):
            raise InputError(
                "expected both in_run_bias and in_run_time (a Gauss-Markov bias) or neither, got "
                f"in_run_bias = {self.in_run_bias}, in_run_time = {self.in_run_time}; "
                "a stability figure without a correlation time is a bias_instability"
            )

    @classmethod
    def gyro(cls, *, density: Density | None = None, **sheet: Unpack[GyroSheet]) -> TriadSpec:
        """Build from the numbers of a gyroscope data sheet.

        Parameters
        ----------
        density : {"one-sided", "two-sided"}, optional
            What a ``noise_*`` figure is; required with one, refused with ``arw_deg_rthr``. See Notes.
        arw_deg_rthr, noise_deg_s_rthz, noise_deg_hr_rthz : float
            White noise, exactly one of them. [deg/sqrt(h)], [deg/s/sqrt(Hz)], [deg/h/sqrt(Hz)]
        bias_instability_deg_hr, allan_minimum_deg_hr : float
            B itself, or the flat part of the Allan deviation, which is 0.664 B. [deg/h]
        rrw_deg_hr_rthr, ramp_deg_hr_hr : float
            Rate random walk [deg/h/sqrt(h)] and rate ramp [deg/h/h].
        quantisation_arcsec : float
            Q of the angle increments. [arcsec]
        bias_deg_hr, bias_deg_s : float
            Turn-on bias. [deg/h], [deg/s]
        in_run_deg_hr, in_run_deg_s, in_run_time_s : float
            Gauss-Markov bias [deg/h], [deg/s] and its correlation time [s].
        scale_ppm, scale_percent : float
            Scale-factor error. [ppm], [%]
        misalignment_mrad, misalignment_urad, misalignment_deg, misalignment_percent : float
            Per off-diagonal element; the percentage is a "cross-axis sensitivity". [mrad], [urad], [deg], [%]
        g_sensitivity_deg_hr_g, g_sensitivity_deg_s_g : float
            [deg/h/g], [deg/s/g], g = 9.80665 m/s^2.
        bias_temperature_deg_hr_K, bias_temperature_deg_s_K : float
            [deg/h/K], [deg/s/K]
        scale_temperature_ppm_K, scale_temperature_percent_K : float
            [ppm/K], [%/K]
        range_deg_s, resolution_deg_s : float
            Range and least significant bit. [deg/s]

        Returns
        -------
        TriadSpec

        Raises
        ------
        InputError
            If a keyword is unknown, a quantity is given twice or the noise figure or its ``density`` is missing.

        Notes
        -----
        N^2 is the two-sided density: S(f) for f in (-inf, inf). A spectrum analyser shows 2 S(f) for f >= 0, so a sheet
        that prints a one-sided root density d means ``d = sqrt(2) N``, that is ``N = d / sqrt(2)``; a two-sided one
        means ``N = d``. An angle random walk is N by definition: the angle's variance is ``N^2 t``.

        Examples
        --------
        >>> f"{TriadSpec.gyro(arw_deg_rthr=0.125).random_walk:.3e}"
        '3.636e-05'
        """
        return cls(**read_sheet(GyroSheet, sheet, density, "gyro"))

    @classmethod
    def accelerometer(cls, *, density: Density | None = None, **sheet: Unpack[AccelerometerSheet]) -> TriadSpec:
        """Build from the numbers of an accelerometer data sheet.

        Parameters
        ----------
        density : {"one-sided", "two-sided"}, optional
            What a ``noise_*`` figure is; required with one, refused with ``vrw_m_s_rthr``. See :meth:`gyro`.
        vrw_m_s_rthr, noise_ug_rthz, noise_mg_rthz, noise_m_s2_rthz : float
            White noise, exactly one of them. [m/s/sqrt(h)], [ug/sqrt(Hz)], [mg/sqrt(Hz)], [m/s^2/sqrt(Hz)]
        bias_instability_ug, bias_instability_mg, allan_minimum_ug : float
            B itself, or the flat part of the Allan deviation, which is 0.664 B. [ug], [mg]
        rrw_ug_rthr, ramp_ug_hr : float
            Rate random walk [ug/sqrt(h)] and ramp [ug/h].
        quantisation_m_s : float
            Q of the velocity increments. [m/s]
        bias_mg, bias_ug, bias_m_s2 : float
            Turn-on bias. [mg], [ug], [m/s^2]
        in_run_mg, in_run_ug, in_run_time_s : float
            Gauss-Markov bias and its correlation time. [mg], [ug], [s]
        scale_ppm, scale_percent, misalignment_mrad, misalignment_urad, misalignment_deg, misalignment_percent : float
            As for :meth:`gyro`.
        bias_temperature_mg_K, bias_temperature_ug_K, scale_temperature_ppm_K, scale_temperature_percent_K : float
            [mg/K], [ug/K], [ppm/K], [%/K]
        range_g, range_m_s2, resolution_mg, resolution_ug : float
            Range and least significant bit. [g], [m/s^2], [mg], [ug]; g = 9.80665 m/s^2.

        Returns
        -------
        TriadSpec

        Raises
        ------
        InputError
            As for :meth:`gyro`.

        Examples
        --------
        >>> f"{TriadSpec.accelerometer(noise_ug_rthz=846.0, density='two-sided').random_walk:.4f}"
        '0.0083'
        """
        return cls(**read_sheet(AccelerometerSheet, sheet, density, "accelerometer"))

    def __repr__(self) -> str:
        return f"TriadSpec({', '.join(f'{name}={value!r}' for name, value in self.to_dict().items())})"

    def to_dict(self) -> dict[str, float]:
        """The fields that differ from their defaults, in SI, for files. ``random_walk`` is always there."""
        return {f.name: getattr(self, f.name) for f in fields(self) if getattr(self, f.name) != f.default}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> TriadSpec:
        """Inverse of :meth:`to_dict`.

        Raises
        ------
        InputError
            If a name is unknown or ``random_walk`` is missing.
        """
        check_entries(data, [f.name for f in fields(cls)], ["random_walk"], "triad")
        return cls(**data)


@dataclass(frozen=True, slots=True, repr=False)
class ImuSpec(Displayed):
    """Error budget of an IMU.

    Attributes
    ----------
    name : str
    gyro, accel : TriadSpec
        Gyroscope triad (rad/s) and accelerometer triad (m/s^2).
    rate_hz : float or None
        Output rate, where the source states one. [Hz]
    source : str
        Where the numbers come from.

    Raises
    ------
    InputError
        If the accelerometer triad has a g-sensitivity or the rate is not positive.
    """

    name: str
    gyro: TriadSpec
    accel: TriadSpec
    rate_hz: float | None = None
    source: str = ""

    def __post_init__(self) -> None:
        if self.accel.g_sensitivity:
            raise InputError(
                f"{self.name}: g_sensitivity belongs to the gyroscope, got {self.accel.g_sensitivity} in accel; "
                "an accelerometer's response to force is its scale_factor and misalignment"
            )
        if self.rate_hz is not None and magnitude(self.rate_hz, "rate_hz") == 0.0:
            raise InputError("rate_hz: expected a positive number or None, got 0")

    def summary(self) -> str:
        """Table of the terms that are not zero, in SI and in the units of data sheets."""
        rate = "" if self.rate_hz is None else f", {self.rate_hz:g} Hz"
        lines = [f"{self.name}{rate}" + (f" ({self.source})" if self.source else "")]
        for title in ("gyroscope", "accelerometer"):
            lines.append(f"  {title + ', 1 sigma':<34}{'SI':<34}data sheet")
            for _, label, value, si, sheet, unit in (row for row in self._terms() if row[0] == title):
                lines.append(f"    {label:<32}{value:<11} {si:<22}{sheet:<10} {unit}".rstrip())
        return "\n".join(lines)

    def _terms(self) -> list[tuple[str, ...]]:
        """Sensor, term, value and unit in SI, value and unit of data sheets, of the terms that are not zero."""
        tables = (("gyroscope", self.gyro, GYRO_UNITS), ("accelerometer", self.accel, ACCEL_UNITS))
        return [
            (title, label, f"{value:.4g}", si, f"{value / factor:.4g}", unit)
            for title, triad, table in tables
            for name, (label, si, unit, factor) in table.items()
            if (value := getattr(triad, name))
        ]

    def _facts(self) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
        return ("sensor", "1 sigma", "SI", "", "data sheet", ""), self._terms()

    def to_dict(self) -> dict[str, Any]:
        """Plain dictionary in SI, for files; :meth:`from_dict` restores an equal object."""
        data: dict[str, Any] = {"name": self.name, "gyro": self.gyro.to_dict(), "accel": self.accel.to_dict()}
        if self.rate_hz is not None:
            data["rate_hz"] = self.rate_hz
        if self.source:
            data["source"] = self.source
        return data

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> ImuSpec:
        """Inverse of :meth:`to_dict`.

        Raises
        ------
        InputError
            If a name is unknown or one of name, gyro, accel is missing.
        """
        check_entries(data, [f.name for f in fields(cls)], ["name", "gyro", "accel"], "IMU")
        triads = {key: TriadSpec.from_dict(data[key]) for key in ("gyro", "accel")}
        return cls(**{**data, **triads})


def allan_minimum(B: float) -> float:
    """Height of the flat part of the Allan deviation of 1/f noise: ``sqrt(2 ln 2 / pi) B = 0.664 B``.

    Parameters
    ----------
    B : float
        Bias instability of IEEE Std 952. [x]

    Returns
    -------
    float
        What is read off a measured curve at its minimum, when white noise and random walk are far below it there. A
        sheet that prints this number as "bias instability" understates B by a third. [x]
    """
    return ALLAN_FLICKER * B
