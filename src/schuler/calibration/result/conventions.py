"""The same calibration in the words of other programs: imu_tk, Kalibr, ROS imu_calib, PSINS.

Formulas with a worked example for each stand in docs/calibration-conventions.md. Here R_a = I + M_a, R_g = I + M_g, and
s_a, s_g are the nominal factors, so that ``s_a raw = b_a + R_a f`` and ``s_g raw = b_g + R_g omega + G_g f``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from schuler.arrays import ArrayLike, as_floats
from schuler.calibration.result.foreign import (
    determined_errors,
    diagonal_matrix,
    held,
    inverse,
    left_out,
    named_places,
    places_of,
    turned,
    turned_places,
    usual_nominal,
)  # fmt: skip
from schuler.calibration.result.foreign_psins import from_psins, to_psins
from schuler.calibration.result.parameters import Gauge, in_gauge, rotation_to
from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import InputError
from schuler.recording.io.hint_texts import axes_matrix
from schuler.sensors.errors import ImuErrors

__all__ = [
    "from_imu_tk",
    "from_kalibr",
    "from_psins",
    "from_ros_imu_calib",
    "to_imu_tk",
    "to_kalibr",
    "to_psins",
    "to_ros_imu_calib",
]


def to_imu_tk(result: CalibrationResult) -> dict[str, Any]:
    """Parameters as imu_tk has them.

    Parameters
    ----------
    result : CalibrationResult

    Returns
    -------
    dict
        ``T_a, K_a, T_g, K_g`` of shape (3, 3) and ``B_a, B_g`` of shape (3,) with ``a = T_a K_a (raw - B_a)`` and
        ``omega = T_g K_g (raw - B_g)``: K diagonal [m/s^2, rad/s per unit of the log], T with ones on its diagonal, T_a
        upper triangular, B in units of the log. ``left_out``: sentences on what imu_tk has no place for.

    Raises
    ------
    InputError
        If a parameter is not determined, or a response cannot be inverted.

    Notes
    -----
    The result is brought to the gauge "upper" first: body z is the z accelerometer. imu_tk's files hold T, K, B of one
    triad each, in this order.

    References
    ----------
    Tedaldi, Pretto, Menegatti (ICRA 2014), whose bias has the other sign; imu_tk, calibration.h, class CalibratedTriad.
    """
    errors = in_gauge(determined_errors(result), "upper")
    values: dict[str, Any] = {}
    for triad, R, b, s in (
        ("a", np.eye(3) + errors.M_a, errors.b_a, result.nominal[0]),
        ("g", np.eye(3) + errors.M_g, errors.b_g, result.nominal[1]),
    ):
        TK = s * np.linalg.inv(R)
        K = np.diag(TK).copy()
        values |= {f"T_{triad}": TK / K, f"K_{triad}": np.diag(K), f"B_{triad}": b / s}
    values["T_a"] = np.triu(values["T_a"])  # rounding below the diagonal
    return values | {"left_out": left_out(result, "imu_tk", ("G_g", "Q_a", "r_a", "delay"))}


def from_imu_tk(
    T_a: ArrayLike,
    K_a: ArrayLike,
    B_a: ArrayLike,
    T_g: ArrayLike | None = None,
    K_g: ArrayLike | None = None,
    B_g: ArrayLike | None = None,
    *,
    nominal: tuple[float, float] | None = None,
) -> CalibrationResult:
    """A result from imu_tk's parameters; see :func:`to_imu_tk` for what they are.

    Parameters
    ----------
    T_a, K_a : array_like, shape (3, 3)
        K may also be its diagonal, shape (3,).
    B_a : array_like, shape (3,)
    T_g, K_g, B_g : array_like, optional
        Of the gyroscopes.
    nominal : (float, float), optional
        Factors of the result. Default: 1 where all scales are within a tenth of 1, else the mean scale.

    Returns
    -------
    CalibrationResult
        In the gauge "upper" if T_a is upper triangular, else "full". imu_tk gives no uncertainty: all parameters are
        held.

    Raises
    ------
    InputError
        If shapes are wrong, a matrix cannot be inverted, or only some of the gyroscopes' are given.
    """
    gyro = [v is not None for v in (T_g, K_g, B_g)]
    if any(gyro) and not all(gyro):
        raise InputError("T_g, K_g, B_g: expected all three or none, got some of them")
    TK_a = as_floats(T_a, "T_a", (3, 3)) @ diagonal_matrix(K_a, "K_a")
    TK_g = as_floats(T_g, "T_g", (3, 3)) @ diagonal_matrix(K_g, "K_g") if T_g is not None else np.eye(3)
    offset_g = as_floats(B_g, "B_g", (3,)) if B_g is not None else np.zeros(3)
    s_a, s_g = nominal or (usual_nominal(TK_a), usual_nominal(TK_g))
    errors = ImuErrors(
        M_a=s_a * inverse(TK_a, "T_a K_a") - np.eye(3), b_a=s_a * as_floats(B_a, "B_a", (3,)),
        M_g=s_g * inverse(TK_g, "T_g K_g") - np.eye(3), b_g=s_g * offset_g,
    )  # fmt: skip
    gauge: Gauge = "upper" if not np.tril(TK_a, -1).any() else "full"
    return held(errors, "imu_tk", gauge, ("b_a", "M_a", "b_g", "M_g") if all(gyro) else ("b_a", "M_a"), (s_a, s_g))


def to_kalibr(result: CalibrationResult, axes: str = "FRD") -> dict[str, Any]:
    """Parameters as Kalibr has them (model ``scale-misalignment``), ready for its YAML file.

    Parameters
    ----------
    result : CalibrationResult
        With nominal factors 1: Kalibr reads logs in SI.
    axes : str
        Directions of x, y, z of the axes Kalibr shall have, such as ``"FLU"``; ours are FRD.

    Returns
    -------
    dict
        ``model``; ``accelerometers`` with ``M``; ``gyroscopes`` with ``M``, ``A``, ``C_gyro_i``: lists with
        ``a_meas = M_a a + b_a`` and ``omega_meas = M_g C_gyro_i omega + A C_gyro_i a + b_g``, both M lower triangular,
        C_gyro_i a rotation. ``bias`` in each of the two, which Kalibr itself does not read: it finds its own. With
        places of the accelerometers also ``rx_i``, ``ry_i``, ``rz_i``, and the model is
        ``scale-misalignment-size-effect``.

    Raises
    ------
    InputError
        If a parameter is not determined, the log was not in SI, or axes are impossible.

    Notes
    -----
    The result is brought to the gauge "lower" in the axes asked for: C_gyro_i is the rotation that makes
    ``(I + M_g) C_gyro_i^T`` lower triangular.

    References
    ----------
    Rehder, Nikolic, Schneider, Hinzmann, Siegwart (ICRA 2016); Kalibr, IccSensors.py, classes IccScaledMisalignedImu
    and IccScaledMisalignedSizeEffectImu.
    """
    if result.nominal != (1.0, 1.0):
        raise InputError(
            f"nominal: expected factors 1 because Kalibr reads logs in m/s^2 and rad/s, got {result.nominal}; convert "
            "the log and use schuler.calibration.result.comparison.with_nominal(result, (1.0, 1.0)) for it"
        )
    P = axes_matrix(axes).T
    errors = in_gauge(turned(determined_errors(result), P), "lower")
    C = rotation_to(errors.M_g, "lower")
    accel: dict[str, Any] = {"M": np.tril(np.eye(3) + errors.M_a).tolist(), "bias": errors.b_a.tolist()}
    model = "scale-misalignment"
    places = places_of(result)
    if places is not None:
        model += "-size-effect"
        for name, row in zip(("rx_i", "ry_i", "rz_i"), turned_places(places, P), strict=True):
            accel[name] = row.tolist()
    gyro = {
        "M": np.tril((np.eye(3) + errors.M_g) @ C.T).tolist(), "A": (errors.G_g @ C.T).tolist(),
        "C_gyro_i": C.tolist(), "bias": errors.b_g.tolist(),
    }  # fmt: skip
    return {"model": model, "accelerometers": accel, "gyroscopes": gyro}


def from_kalibr(data: Mapping[str, Any], axes: str = "FRD") -> CalibrationResult:
    """A result from what Kalibr wrote for one IMU (``imu0`` of its YAML file); see :func:`to_kalibr`.

    Parameters
    ----------
    data : mapping
        With ``accelerometers`` and ``gyroscopes``.
    axes : str
        Directions of x, y, z of Kalibr's axes.

    Returns
    -------
    CalibrationResult
        In the gauge "lower" (of our axes). Kalibr gives no uncertainty: all parameters are held; biases are zero where
        the file has none.

    Raises
    ------
    InputError
        If an entry is missing or of the wrong shape.
    """
    try:
        accel, gyro = data["accelerometers"], data["gyroscopes"]
        M_a, M_g, C = (as_floats(m, n, (3, 3)) for m, n in (
            (accel["M"], "accelerometers M"), (gyro["M"], "gyroscopes M"), (gyro["C_gyro_i"], "gyroscopes C_gyro_i"),
        ))  # fmt: skip
    except (KeyError, TypeError) as error:
        raise InputError(
            f"expected accelerometers with M and gyroscopes with M, C_gyro_i, as Kalibr writes with --imu-models "
            f"scale-misalignment, got no {error}"
        ) from None
    A = as_floats(gyro.get("A", np.zeros((3, 3))), "gyroscopes A", (3, 3))
    errors = ImuErrors(
        M_a=M_a - np.eye(3), M_g=M_g @ C - np.eye(3), G_g=A @ C,
        b_a=as_floats(accel.get("bias", np.zeros(3)), "accelerometers bias", (3,)),
        b_g=as_floats(gyro.get("bias", np.zeros(3)), "gyroscopes bias", (3,)),
    )  # fmt: skip
    turn = axes_matrix(axes)
    result = held(in_gauge(turned(errors, turn), "lower"), "Kalibr", "lower", ("b_a", "M_a", "b_g", "M_g", "G_g"))
    if "rx_i" not in accel:
        return result
    rows = np.array([as_floats(accel[n], f"accelerometers {n}", (3,)) for n in ("rx_i", "ry_i", "rz_i")])
    return replace(result, fixed=result.fixed | named_places(turned_places(rows, turn)))


def to_ros_imu_calib(result: CalibrationResult, axes: str = "FRD") -> dict[str, Any]:
    """Parameters of the accelerometers as imu_calib (ROS, D. Koch) has them.

    Parameters
    ----------
    result : CalibrationResult
    axes : str
        Directions of x, y, z of the axes the ROS driver publishes, such as ``"FLU"``; ours are FRD.

    Returns
    -------
    dict
        ``SM``, nine numbers row by row, and ``bias``, three, with ``a = SM raw - bias`` [m/s^2], ready for its YAML
        file; ``left_out``: sentences on what it has no place for, not for the file.

    Raises
    ------
    InputError
        If a parameter is not determined, or axes are impossible.

    Notes
    -----
    ``SM = s_a R_a^-1``, ``bias = R_a^-1 b_a``: unlike ours the bias is taken off after the matrix. Gyroscopes are not
    in the file: the node takes their mean at start-up for their bias.

    References
    ----------
    imu_calib, accel_calib.cpp, ``applyCalib``; README. (STMicroelectronics AN4508 has plus where imu_calib has minus.)
    """
    errors = turned(determined_errors(result, ("b_a", "M_a")), axes_matrix(axes).T)
    back = np.linalg.inv(np.eye(3) + errors.M_a)
    return {
        "SM": (result.nominal[0] * back).ravel().tolist(),
        "bias": (back @ errors.b_a).tolist(),
        "left_out": left_out(result, "imu_calib", ("b_g", "M_g", "G_g", "Q_a", "r_a", "delay")),
    }


def from_ros_imu_calib(
    SM: ArrayLike, bias: ArrayLike, axes: str = "FRD", *, nominal: float | None = None
) -> CalibrationResult:
    """A result from the two entries of imu_calib's file; see :func:`to_ros_imu_calib`.

    Parameters
    ----------
    SM : array_like, shape (9,) or (3, 3)
    bias : array_like, shape (3,)
    axes : str
        Directions of x, y, z of the ROS driver's axes.
    nominal : float, optional
        Of the accelerometers; default as in :func:`from_imu_tk`.

    Returns
    -------
    CalibrationResult
        In the gauge "full": imu_calib refers to the six poses. All parameters are held.

    Raises
    ------
    InputError
        If shapes are wrong or SM cannot be inverted.
    """
    S = as_floats(np.reshape(np.asarray(SM), (3, 3)) if np.size(SM) == 9 else SM, "SM", (3, 3))
    s_a = nominal or usual_nominal(S)
    R = s_a * inverse(S, "SM")
    errors = turned(ImuErrors(M_a=R - np.eye(3), b_a=R @ as_floats(bias, "bias", (3,))), axes_matrix(axes))
    return held(errors, "imu_calib", "full", ("b_a", "M_a"), (s_a, 1.0))
