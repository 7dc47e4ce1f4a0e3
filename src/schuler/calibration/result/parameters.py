"""Names, units and order of calibration parameters, and their change of gauge.

A parameter is an element of :class:`~schuler.sensors.errors.ImuErrors` under its own name: ``b_a_x``, ``M_a_xy`` (row
x, column y), ``b_g_z``, ``M_g_zz``, ``G_g_xy``; then there are those ImuErrors has no place for: ``Q_a_x`` quadratic
term [1/(m/s^2)], ``b_m_x`` [T] and ``M_m_xy`` of a magnetometer, ``r_a_xy`` place of the x accelerometer
along y [m], ``delay`` of the gyroscopes behind the accelerometers [s].
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, TypeAlias

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.sensors.errors import ImuErrors

Gauge: TypeAlias = Literal["full", "lower", "upper", "symmetric"]

AXES = "xyz"
#: What each gauge means.
GAUGES: dict[str, str] = {
    "full": "body axes are those of the reference (table, fixture): all nine elements of M_a and M_g count",
    "lower": "M_a is lower triangular: body x is the x accelerometer, body y in the plane of x and y accelerometer",
    "upper": "M_a is upper triangular: body z is the z accelerometer, body y in the plane of y and z accelerometer",
    "symmetric": "M_a is symmetric: body axes are those nearest to the three accelerometers (polar decomposition)",
}

BIAS_A = tuple(f"b_a_{i}" for i in AXES)
BIAS_G = tuple(f"b_g_{i}" for i in AXES)
MATRIX_A = tuple(f"M_a_{i}{j}" for i in AXES for j in AXES)
MATRIX_G = tuple(f"M_g_{i}{j}" for i in AXES for j in AXES)
SENSITIVITY = tuple(f"G_g_{i}{j}" for i in AXES for j in AXES)
#: Every parameter that ImuErrors has a place for, in the order of results.
LINEAR = BIAS_A + MATRIX_A + BIAS_G + MATRIX_G + SENSITIVITY
#: Of a magnetometer, which ImuErrors has no place for.
BIAS_M = tuple(f"b_m_{i}" for i in AXES)
MATRIX_M = tuple(f"M_m_{i}{j}" for i in AXES for j in AXES)
_OTHERS = {"b_m": "T", "M_m": "-", "Q_a": "1/(m/s^2)", "r_a": "m", "delay": "s"}


def unit(name: str) -> str:
    """SI unit of a parameter.

    Raises
    ------
    InputError
        If there is no parameter of this name.
    """
    family = name if name == "delay" else name[:3]
    units = {"b_a": "m/s^2", "M_a": "-", "b_g": "rad/s", "M_g": "-", "G_g": "(rad/s)/(m/s^2)", **_OTHERS}
    if family not in units or (family != "delay" and (name not in LINEAR and family not in _OTHERS)):
        raise InputError(f"parameter: expected a name such as b_a_x, M_a_xy, b_g_z, M_g_zz, G_g_xy, got {name!r}")
    return units[family]


def imu_errors(values: Mapping[str, float], temperature_0: float = 25.0) -> ImuErrors:
    """Errors of an IMU from named parameters; those that are not named are zero, others than :data:`LINEAR` left out.

    Parameters
    ----------
    values : mapping of str to float
        SI.
    temperature_0 : float
        Temperature of the calibration. [degC]
    """

    def block(names: Sequence[str]) -> FloatArray:
        return np.array([values.get(name, 0.0) for name in names])

    return ImuErrors(
        b_a=block(BIAS_A), M_a=block(MATRIX_A).reshape(3, 3), b_g=block(BIAS_G), M_g=block(MATRIX_G).reshape(3, 3),
        G_g=block(SENSITIVITY).reshape(3, 3), temperature_0=temperature_0,
    )  # fmt: skip


def vector(errors: ImuErrors, names: Sequence[str] = LINEAR) -> FloatArray:
    """Named parameters of an IMU's errors, shape (p,); names out of :data:`LINEAR`. SI."""
    flat = np.concatenate((errors.b_a, errors.M_a.ravel(), errors.b_g, errors.M_g.ravel(), errors.G_g.ravel()))
    place = {name: i for i, name in enumerate(LINEAR)}
    return np.array([flat[place[name]] for name in names])


def rotation_to(M_a: FloatArray, gauge: Gauge) -> FloatArray:
    """Rotation between body axes that brings ``M_a`` into a gauge.

    Parameters
    ----------
    M_a : ndarray, shape (3, 3)
        Response less identity, in the present body axes.
    gauge : {"lower", "upper", "symmetric"}

    Returns
    -------
    ndarray, shape (3, 3)
        C with ``v_new = C @ v_old``; then ``I + M_new = (I + M_old) C^T`` for both triads, ``G_new = G_old C^T``.

    Raises
    ------
    InputError
        If the gauge is unknown or "full", which no rotation leads to, or I + M_a is no right-handed response.
    """
    R = np.eye(3) + M_a
    if np.linalg.det(R) <= 0.0:
        raise InputError(f"M_a: expected a right-handed response I + M_a, got {R.tolist()}; check signs and axes")
    if gauge == "lower":
        Q, L = np.linalg.qr(R.T)  # R = L^T Q^T with L^T lower
        signs = np.sign(np.diag(L))
        return np.asarray((Q * signs).T)
    if gauge == "upper":
        flip = np.eye(3)[::-1]
        Q, L = np.linalg.qr((flip @ R).T)
        signs = np.sign(np.diag(L))
        return np.asarray(flip @ (Q * signs).T)
    if gauge == "symmetric":
        U, _, Vt = np.linalg.svd(R)
        return np.asarray(U @ Vt)
    raise InputError(f"gauge: expected 'lower', 'upper' or 'symmetric', got {gauge!r}; body axes cannot be invented")


def in_gauge(errors: ImuErrors, gauge: Gauge) -> ImuErrors:
    """The same IMU with other body axes: what it reads is the same, what is called x, y, z turns by arc minutes.

    Parameters
    ----------
    errors : ImuErrors
    gauge : {"lower", "upper", "symmetric"}

    Returns
    -------
    ImuErrors
        Bias, M and G in the new axes; the rest as it was.

    Raises
    ------
    InputError
        See :func:`rotation_to`.
    """
    from dataclasses import replace

    C = rotation_to(errors.M_a, gauge)
    identity = np.eye(3)
    return replace(
        errors,
        M_a=(identity + errors.M_a) @ C.T - identity,
        M_g=(identity + errors.M_g) @ C.T - identity,
        G_g=errors.G_g @ C.T,
    )
