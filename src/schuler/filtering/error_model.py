"""Linear error dynamics of the navigation equations: system matrices in Earth-fixed and in north-east-down axes.

Error is estimate minus truth for every state. With ``C_hat = exp([dpsi x]) C`` and sensor estimates used in the inverse
sensor model, the parameter columns carry a minus sign: a bias estimated too large is taken off too much.

The compiled filter does not multiply with these matrices, it accumulates its transition directly; tests hold the two,
and the finite differences of the mechanization, against each other.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from schuler import earth, frames, rotation
from schuler.arrays import ArrayLike, FloatArray, as_floats, as_vector3
from schuler.exceptions import InputError
from schuler.filtering.states import StateLayout

_OMEGA_IE_E = np.array([0.0, 0.0, earth.WGS84.omega_ie])


def sensor_matrices(layout: StateLayout, estimates: ArrayLike) -> tuple[FloatArray, ...]:
    """Sensor errors that a parameter vector stands for.

    Parameters
    ----------
    layout : StateLayout
    estimates : array_like, shape (m,)
        Parameter values in the layout's order.

    Returns
    -------
    b_g, b_a, M_g, M_a, G_g : ndarray, shapes (3,), (3,), (3, 3), (3, 3), (3, 3)
        ``omega_meas = b_g + (I + M_g) omega + G_g f``, ``f_meas = b_a + (I + M_a) f``.
    """
    est = as_floats(estimates, "estimates", (layout.size - 9,))
    b_g, b_a = np.zeros(3), np.zeros(3)
    M_g, M_a, G_g = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    for value, (sensor, axis, source) in zip(est[: layout.n_sensor], layout.table(), strict=False):
        if source == 0:
            (b_g if sensor == 0 else b_a)[axis] += value
        elif sensor == 0 and source >= 4:
            M_g[axis, source - 4] += value
        elif sensor == 0:
            G_g[axis, source - 1] += value
        else:
            M_a[axis, source - 1] += value
    return b_g, b_a, M_g, M_a, G_g


def parameter_columns(
    layout: StateLayout, C: ArrayLike, omega_ib_b: ArrayLike, f_ib_b: ArrayLike, estimates: ArrayLike | None = None
) -> tuple[FloatArray, FloatArray]:
    """How parameter errors drive attitude and velocity errors.

    Parameters
    ----------
    layout : StateLayout
    C : array_like, shape (3, 3)
        ``C_eb`` or ``C_nb``, whichever axes the errors are in.
    omega_ib_b, f_ib_b : array_like, shape (3,)
        Compensated angular rate [rad/s] and specific force [m/s^2].
    estimates : array_like, shape (m,), optional
        Current parameter estimates; default zero.

    Returns
    -------
    B_psi, B_v : ndarray, shape (3, m)
    """
    m = layout.size - 9
    C, omega, f = np.asarray(C), as_vector3(omega_ib_b, "omega_ib_b"), as_vector3(f_ib_b, "f_ib_b")
    _, _, M_g, M_a, G_g = sensor_matrices(layout, np.zeros(m) if estimates is None else estimates)
    K_g, K_a = np.linalg.inv(np.eye(3) + M_g), np.linalg.inv(np.eye(3) + M_a)
    regressors = np.concatenate(([1.0], f, omega))
    B_psi, B_v = np.zeros((3, m)), np.zeros((3, m))
    for k, (sensor, axis, source) in enumerate(layout.table()[: layout.n_sensor]):
        if sensor == 0:
            B_psi[:, k] = -(C @ K_g[:, axis]) * regressors[source]
        else:
            B_v[:, k] = -(C @ K_a[:, axis]) * regressors[source]
            B_psi[:, k] = C @ K_g @ G_g @ K_a[:, axis] * regressors[source]
    return B_psi, B_v


def system_matrix_ecef(
    layout: StateLayout,
    C_eb: ArrayLike,
    r_eb_e: ArrayLike,
    omega_ib_b: ArrayLike,
    f_ib_b: ArrayLike,
    estimates: ArrayLike | None = None,
) -> FloatArray:
    """System matrix ``F`` of the error state in Earth-fixed axes, ``d(dx)/dt = F dx + noise``.

    Parameters
    ----------
    layout : StateLayout
    C_eb : array_like, shape (3, 3)
        Attitude.
    r_eb_e : array_like, shape (3,)
        Position. [m]
    omega_ib_b, f_ib_b : array_like, shape (3,)
        Compensated angular rate [rad/s] and specific force [m/s^2], body axes.
    estimates : array_like, shape (m,), optional
        Parameter estimates about which is linearised; default zero.

    Returns
    -------
    F : ndarray, shape (n, n)
        Order dpsi_e, dv_eb_e, dr_eb_e, parameters. SI.

    References
    ----------
    Groves (2013), eq. (14.48) with errors as estimate minus truth; Stefanisko (2015), eq. (3.8), column B of its
    corrected sign table with the parameter columns negated.
    """
    C = as_floats(C_eb, "C_eb", (3, 3))
    F = np.zeros((layout.size, layout.size))
    W = rotation.skew(_OMEGA_IE_E)
    F[0:3, 0:3] = -W
    F[3:6, 0:3] = -rotation.skew(C @ np.asarray(f_ib_b))
    F[3:6, 3:6] = -2.0 * W
    F[3:6, 6:9] = earth.gravity_gradient_ecef(r_eb_e)
    F[6:9, 3:6] = np.eye(3)
    F[0:3, 9:], F[3:6, 9:] = parameter_columns(layout, C, omega_ib_b, f_ib_b, estimates)
    F[9:, 9:] = -np.diag(layout.dynamics()[:, 0])
    return F


def system_matrix_ned(
    layout: StateLayout,
    C_nb: ArrayLike,
    v_eb_n: ArrayLike,
    llh: ArrayLike,
    omega_ib_b: ArrayLike,
    f_ib_b: ArrayLike,
    estimates: ArrayLike | None = None,
    *,
    position: Literal["metres", "radians"] = "metres",
) -> FloatArray:
    """System matrix ``F`` of the error state in north-east-down axes.

    Parameters
    ----------
    layout : StateLayout
    C_nb : array_like, shape (3, 3)
        Attitude.
    v_eb_n, llh : array_like, shape (3,)
        Velocity [m/s] and latitude, longitude [rad], height [m].
    omega_ib_b, f_ib_b : array_like, shape (3,)
        Compensated angular rate [rad/s] and specific force [m/s^2], body axes.
    estimates : array_like, shape (m,), optional
        Parameter estimates about which is linearised; default zero.
    position : {"metres", "radians"}
        Position error as north, east, down [m] or as latitude, longitude [rad], height [m].

    Returns
    -------
    F : ndarray, shape (n, n)
        Order dpsi_n, dv_eb_n, position, parameters.

    Notes
    -----
    All terms are kept, the derivative of gravity with latitude too (5e-2 m/s^2 a radian), which Yaman drops.

    References
    ----------
    Groves (2013), eqs. (14.63)-(14.71); Yaman (2017), eqs. (2-105)-(2-110) without their misprints; Du (2015),
    eqs. (2.16)-(2.18), whose signs of F_eps_r, F_eps_v are reversed in print.
    """
    if position not in ("metres", "radians"):
        raise InputError(f"position: expected 'metres' or 'radians', got {position!r}")
    C = as_floats(C_nb, "C_nb", (3, 3))
    vN, vE, vD = v = as_vector3(v_eb_n, "v_eb_n")
    lat, _, h = as_vector3(llh, "llh")
    E = earth.WGS84
    s, c, t = np.sin(lat), np.cos(lat), np.tan(lat)
    R_N, R_E = (float(R) for R in earth.radii_of_curvature(lat))
    w2 = 1.0 - E.e2 * s * s
    rn, re = R_N + h, R_E + h
    rn_L, re_L = 3.0 * E.e2 * s * c / w2 * R_N, E.e2 * s * c / w2 * R_E  # derivatives of the radii with latitude
    Om = E.omega_ie
    omega_ie, omega_en = earth.earth_rate_ned(lat), earth.transport_rate_ned(lat, h, v)
    zero = np.zeros(3)
    # derivatives with latitude and height of Earth rate, transport rate and gravity
    ie_L = Om * np.array([-s, 0.0, -c])
    en_L = np.array([-vE * re_L / re**2, vN * rn_L / rn**2, -vE / (re * c * c) + vE * t * re_L / re**2])
    en_h = np.array([-vE / re**2, vN / rn**2, vE * t / re**2])
    en_v = np.array([[0.0, 1.0 / re, 0.0], [-1.0 / rn, 0.0, 0.0], [0.0, -t / re, 0.0]])
    g_L = (earth.gravity_ned(lat + 1e-4, h) - earth.gravity_ned(lat - 1e-4, h)) / 2e-4
    g_h = (earth.gravity_ned(lat, h + 10.0) - earth.gravity_ned(lat, h - 10.0)) / 20.0
    F = np.zeros((layout.size, layout.size))
    F[0:3, 0:3] = -rotation.skew(omega_ie + omega_en)
    F[0:3, 3:6] = -en_v
    F[0:3, 6:9] = -np.stack((ie_L + en_L, zero, en_h), axis=-1)
    F[3:6, 0:3] = -rotation.skew(C @ np.asarray(f_ib_b))
    F[3:6, 3:6] = -rotation.skew(2.0 * omega_ie + omega_en) + rotation.skew(v) @ en_v
    F[3:6, 6:9] = np.stack((g_L - np.cross(2.0 * ie_L + en_L, v), zero, g_h - np.cross(en_h, v)), axis=-1)
    lat_rate, lon_rate = vN / rn, vE / (re * c)
    F[6:9, 3:6] = np.diag([1.0 / rn, 1.0 / (re * c), -1.0])
    F[6:9, 6:9] = np.array(
        [
            [-lat_rate * rn_L / rn, 0.0, -lat_rate / rn],
            [lon_rate * (t - re_L / re), 0.0, -lon_rate / re],
            [0.0, 0.0, 0.0],
        ]
    )
    F[0:3, 9:], F[3:6, 9:] = parameter_columns(layout, C, omega_ib_b, f_ib_b, estimates)
    F[9:, 9:] = -np.diag(layout.dynamics()[:, 0])
    if position == "metres":
        scale = np.array([rn, re * c, -1.0])
        scale_rate = np.array([rn_L * lat_rate - vD, (re_L * lat_rate - vD) * c - re * s * lat_rate, 0.0])
        F[:, 6:9] /= scale
        F[6:9, :] *= scale[:, None]
        F[6:9, 6:9] += np.diag(scale_rate / scale)
    return F


def noise_density(layout: StateLayout, C: ArrayLike, gyro_psd: ArrayLike, accel_psd: ArrayLike) -> FloatArray:
    """Power spectral density matrix of the noise that drives the error state.

    Parameters
    ----------
    layout : StateLayout
    C : array_like, shape (3, 3)
        ``C_eb`` or ``C_nb``.
    gyro_psd, accel_psd : array_like, shape (3,)
        ``N**2`` by axis. [rad^2/s], [m^2/s^3]

    Returns
    -------
    Q : ndarray, shape (n, n)
    """
    C = as_floats(C, "C", (3, 3))
    Q = np.zeros((layout.size, layout.size))
    Q[0:3, 0:3] = C @ np.diag(as_vector3(gyro_psd, "gyro_psd")) @ C.T
    Q[3:6, 3:6] = C @ np.diag(as_vector3(accel_psd, "accel_psd")) @ C.T
    Q[9:, 9:] = np.diag(layout.dynamics()[:, 1])
    return Q


def ecef_from_ned_states(llh: ArrayLike, n: int) -> FloatArray:
    """Matrix that turns the navigation part of an error vector from north-east-down to Earth-fixed axes.

    Parameters
    ----------
    llh : array_like, shape (3,) or (k, 3)
        Position. [rad, rad, m]
    n : int
        Number of states.

    Returns
    -------
    T : ndarray, shape (..., n, n)
        ``dx_e = T dx_n``, ``P_e = T P_n T'``; orthogonal, so its transpose goes back.
    """
    C = frames.C_en(llh)
    T = np.zeros((*C.shape[:-2], n, n))
    T[..., range(n), range(n)] = 1.0
    for i in (0, 3, 6):
        T[..., i : i + 3, i : i + 3] = C
    return T
