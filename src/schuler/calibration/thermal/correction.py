"""Biases and scale factors of a thermal calibration at any temperature, and a log corrected with them."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.calibration.result.parameters import BIAS_A, BIAS_G
from schuler.calibration.result.result import CalibrationResult
from schuler.calibration.thermal import table as thermal_table
from schuler.calibration.thermal.ramp import powers
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries


def thermal_value(
    result: CalibrationResult,
    name: str,
    temperature: ArrayLike,
    *,
    extrapolate: bool = False,
    method: Literal["polynomial", "table"] = "polynomial",
) -> tuple[FloatArray, FloatArray]:
    """A parameter and its uncertainty at given temperatures.

    Parameters
    ----------
    result : CalibrationResult
        Of :func:`calibrate_thermal`.
    name : str
        Such as ``b_g_x``.
    temperature : array_like
        [degC]
    extrapolate : bool
        Allow temperatures outside the calibrated range: the polynomial goes on as it pleases, a table stays at its end.
    method : {"polynomial", "table"}

    Returns
    -------
    value, sigma : ndarray, shape of temperature
        SI. After a ramp without known specific force, b_a is the change from the reference temperature.

    Raises
    ------
    InputError
        If the result has no temperature dependence or not this parameter, or a temperature is out of range.
    """
    thermal = result.extra.get("thermal")
    if not thermal:
        raise InputError("result: expected one of calibrate_thermal that was not refused; see its verdicts")
    if method not in ("polynomial", "table"):
        raise InputError(f"method: expected 'polynomial' or 'table', got {method!r}")
    if name not in thermal["coefficients"]:
        raise InputError(f"name: expected one of {', '.join(thermal['coefficients'])}, got {name!r}")
    T = np.asarray(temperature, dtype=np.float64)
    low, high = thermal["range"]
    outside = ~((low - 1e-9 <= T) & (high + 1e-9 >= T))
    if outside.any() and not (extrapolate and np.isfinite(T).all()):
        raise InputError(
            f"temperature: calibrated from {low:.1f} to {high:.1f} degC, got "
            f"{float(np.atleast_1d(T[outside])[0]):.1f}; calibrate over a wider range, or say extrapolate=True"
        )
    if method == "table":
        table = thermal["table"].get(name)
        if table is None:
            raise InputError(f"name: there is no table of {name}; use the polynomial")
        order = np.argsort(thermal["table"]["temperature"], kind="stable")
        at = [thermal["table"]["temperature"][k] for k in order]
        columns = (thermal_table.interpolated(T, at, [table[what][k] for k in order]) for what in ("value", "sigma"))
        return next(columns), next(columns)
    c = np.array(thermal["coefficients"][name])
    P = powers(T, thermal["reference_temperature"], len(c))
    C = np.array(thermal["covariance"][name])
    return np.asarray(P @ c), np.asarray(np.sqrt(np.maximum(np.einsum("...i,ij,...j->...", P, C, P), 0.0)))


def thermal_correction(
    result: CalibrationResult,
    temperature: ArrayLike,
    *,
    extrapolate: bool = False,
    method: Literal["polynomial", "table"] = "polynomial",
) -> tuple[FloatArray, FloatArray]:
    """Biases at given temperatures: subtract them.

    Parameters
    ----------
    result, temperature, extrapolate, method
        As for :func:`thermal_value`.

    Returns
    -------
    b_g, b_a : ndarray, shape of temperature + (3,)
        [rad/s], [m/s^2]

    Raises
    ------
    InputError
        See :func:`thermal_value`.
    """
    b_g, b_a = (
        np.stack(
            [thermal_value(result, n, temperature, extrapolate=extrapolate, method=method)[0] for n in names], axis=-1
        )
        for names in (BIAS_G, BIAS_A)
    )
    return b_g, b_a


def compensate_thermal(result: CalibrationResult, imu: ImuSeries, *, extrapolate: bool = False) -> ImuSeries:
    """A log with biases, and what is known of M_a, taken out at the temperature of every sample.

    Parameters
    ----------
    result : CalibrationResult
        Of :func:`calibrate_thermal`.
    imu : ImuSeries
        With temperature.
    extrapolate : bool
        See :func:`thermal_value`.

    Returns
    -------
    ImuSeries
        Rates or increments as they came: ``omega = omega_meas - b_g(T)``, ``f = (I + M_a(T))^-1 (f_meas - b_a(T))``.

    Raises
    ------
    InputError
        If the log has no temperature, or one that is out of range.
    """
    if imu.temperature is None:
        raise InputError("imu: expected a log with temperature, got none")
    T = imu.temperature
    h = (imu.increments().dt if imu.kind == "increment" else np.ones(len(imu)))[:, None]
    b_g, b_a = thermal_correction(result, T, extrapolate=extrapolate)
    names = [n for n in result.extra["thermal"]["coefficients"] if n.startswith("M_a")]
    accel = imu.accel - h * b_a
    if names:
        R = np.broadcast_to(np.eye(3), (len(imu), 3, 3)).copy()
        for n in names:
            R[:, "xyz".index(n[4]), "xyz".index(n[5])] += thermal_value(result, n, T, extrapolate=extrapolate)[0]
        accel = np.asarray(np.linalg.solve(R, accel[..., None])[..., 0])
    return replace(imu, gyro=imu.gyro - h * b_g, accel=accel)
