"""Errors of an IMU in other axes, and in a log from which a part of them was taken out.

All 33 linear errors of an IMU (:data:`~schuler.calibration.result.parameters.LINEAR`: b_a, M_a, b_g, M_g, G_g,
matrices row by
row) are carried together with one covariance, so that correlations survive every step. Errors are estimate minus truth.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.calibration.result.parameters import LINEAR, imu_errors, in_gauge, vector

B_A, M_A, B_G, M_G, G_G = slice(0, 3), slice(3, 12), slice(12, 15), slice(15, 24), slice(24, 33)
SIZE = len(LINEAR)
#: Places of the elements of M_a that a gauge holds at zero.
HELD = {
    "upper": tuple(LINEAR.index(name) for name in ("M_a_yx", "M_a_zx", "M_a_zy")),
    "lower": tuple(LINEAR.index(name) for name in ("M_a_xy", "M_a_xz", "M_a_yz")),
}

_ACTS = 1e-3  # a smaller derivative does not make something known or unknown


@dataclass(frozen=True)
class SensorErrors:
    """Errors of an IMU with their covariance.

    Attributes
    ----------
    values : ndarray, shape (33,)
        SI.
    covariance : ndarray, shape (33, 33)
        SI; of errors that were not measured that of the budget.
    calibrated : ndarray of bool, shape (33,)
        Whether the calibration gives a value, with or without uncertainty.
    measured : ndarray of bool, shape (33,)
        Whether the uncertainty too is the calibration's.
    """

    values: FloatArray
    covariance: FloatArray
    calibrated: BoolArray
    measured: BoolArray

    @property
    def matrices(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """b_a, M_a, b_g, M_g, G_g."""
        p = self.values
        return p[B_A], p[M_A].reshape(3, 3), p[B_G], p[M_G].reshape(3, 3), p[G_G].reshape(3, 3)

    def mapped(self, values: FloatArray, J: FloatArray) -> SensorErrors:
        """With other values, whose errors are ``J`` times the present ones."""
        C = J @ self.covariance @ J.T
        acts = np.abs(J) > _ACTS
        calibrated, measured = acts[:, self.calibrated].any(axis=1), acts[:, self.measured].any(axis=1)
        return SensorErrors(values, 0.5 * (C + C.T), np.asarray(calibrated), np.asarray(measured))


@dataclass(frozen=True)
class Correction:
    """A linear change of a log: ``gyro' = gyro T_g^T + accel U^T + t_g``, ``accel' = accel T_a^T + t_a``.

    Attributes
    ----------
    T_g, T_a, U : ndarray, shape (3, 3)
        Matrices, the same for rates and increments. [-], [-], [(rad/s)/(m/s^2)]
    t_g, t_a : ndarray, shape (3,)
        Offsets of rates; times the interval for increments. [rad/s], [m/s^2]
    """

    T_g: FloatArray
    T_a: FloatArray
    U: FloatArray
    t_g: FloatArray
    t_a: FloatArray

    @property
    def is_identity(self) -> bool:
        """Whether it leaves a log unchanged, to the last bit."""
        identity = np.eye(3)
        same = np.array_equal(self.T_g, identity) and np.array_equal(self.T_a, identity)
        return bool(same and not (self.U.any() or self.t_g.any() or self.t_a.any()))

    def apply(self, gyro: FloatArray, accel: FloatArray, h: FloatArray | float = 1.0) -> tuple[FloatArray, FloatArray]:
        """Gyro and accelerometer output after it, shape (..., 3); ``h`` is 1 for rates, else the intervals [s]."""
        return gyro @ self.T_g.T + accel @ self.U.T + h * self.t_g, accel @ self.T_a.T + h * self.t_a


def rotated_errors(errors: SensorErrors, C_bs: FloatArray) -> SensorErrors:
    """Errors in the axes of the vehicle.

    Parameters
    ----------
    errors : SensorErrors
        In the IMU's axes.
    C_bs : ndarray, shape (3, 3)
        Maps the IMU's components to the vehicle's: ``b' = C b``, ``M' = C M C^T``, ``G' = C G C^T``.
    """
    J = np.zeros((SIZE, SIZE))
    J[B_A, B_A] = J[B_G, B_G] = C_bs
    J[M_A, M_A] = J[M_G, M_G] = J[G_G, G_G] = np.kron(C_bs, C_bs)
    return errors.mapped(J @ errors.values, J)


def upper_gauge_errors(errors: SensorErrors) -> SensorErrors:
    """Errors in the gauge with M_a upper triangular: body z is the z accelerometer, body y in the plane of y and z.

    Raises
    ------
    InputError
        If I + M_a is no right-handed response.

    Notes
    -----
    Like :meth:`CalibrationResult.in_gauge`, covariance by the derivative taken numerically, with all 33 parameters.
    """

    def in_upper_gauge(values: FloatArray) -> FloatArray:
        return vector(in_gauge(imu_errors(dict(zip(LINEAR, values, strict=True))), "upper"))

    J, step = np.empty((SIZE, SIZE)), 1e-6
    for i in range(SIZE):
        h = np.zeros(SIZE)
        h[i] = step
        J[:, i] = (in_upper_gauge(errors.values + h) - in_upper_gauge(errors.values - h)) / (2.0 * step)
    values = in_upper_gauge(errors.values)
    zero = list(HELD["upper"])
    J[zero, :] = values[zero] = 0.0  # by the choice of axes
    out = errors.mapped(values, J)
    out.calibrated[zero] = out.measured[zero] = True
    return out


def split_errors(errors: SensorErrors, estimated: BoolArray) -> tuple[SensorErrors, Correction]:
    """Take the errors that a filter does not estimate out of a log, so that the others explain it as all did before.

    Parameters
    ----------
    errors : SensorErrors
    estimated : ndarray of bool, shape (33,)
        Errors that stay in the log because a filter estimates them; G_g all or none.

    Returns
    -------
    errors : SensorErrors
        Those of the changed log: values as before where estimated and zero elsewhere (G_g follows T_g), and the
        uncertainty of all.
    correction : Correction

    Notes
    -----
    With k for the estimated errors, ``T = (I + M_k) (I + M)^-1`` turns the response I + M into I + M_k, for both
    triads. If G is not estimated, its share ``T_g G (I + M_a)^-1 (f_meas - b_a)`` is taken out too. Offsets put the
    biases where they belong. Exact, no matter how large the errors: after a perfect calibration the log has the
    estimated errors only. Errors of the calibration act on the corrected log linearly: ``db_a' = T_a db_a``,
    ``dM_a' = T_a dM_a``, ``db_g' = T_g db_g + U db_a``, ``dM_g' = T_g dM_g``, ``dG' = T_g dG + U dM_a``.
    """
    b_a, M_a, b_g, M_g, G = errors.matrices
    k_b_a, k_M_a, k_b_g, k_M_g, _ = replace(errors, values=np.where(estimated, errors.values, 0.0)).matrices
    identity = np.eye(3)
    # all kept: exactly the identity, rather than up to rounding
    T_a = identity if np.array_equal(k_M_a, M_a) else (identity + k_M_a) @ np.linalg.inv(identity + M_a)
    T_g = identity if np.array_equal(k_M_g, M_g) else (identity + k_M_g) @ np.linalg.inv(identity + M_g)
    keeps_G = bool(estimated[G_G].all())
    U = np.zeros((3, 3)) if keeps_G or not G.any() else -T_g @ G @ np.linalg.inv(identity + M_a)
    correction = Correction(T_g, T_a, U, k_b_g - T_g @ b_g - U @ b_a, k_b_a - T_a @ b_a)
    J = np.zeros((SIZE, SIZE))
    J[B_A, B_A], J[M_A, M_A] = T_a, np.kron(T_a, identity)
    J[B_G, B_G], J[M_G, M_G], J[G_G, G_G] = T_g, np.kron(T_g, identity), np.kron(T_g, identity)
    J[B_G, B_A], J[G_G, M_A] = U, np.kron(U, identity)
    values = np.concatenate((k_b_a, k_M_a.ravel(), k_b_g, k_M_g.ravel(), (keeps_G * T_g @ G).ravel()))
    return replace(errors, values=values, covariance=errors.mapped(values, J).covariance), correction
