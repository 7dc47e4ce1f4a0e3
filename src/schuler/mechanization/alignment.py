"""Initial attitude: levelling, gyrocompassing, heading from course.

Every result has its covariance and the part of it that the sensors' biases cause: a filter that starts from an attitude
and estimates these biases needs the correlation of the two errors.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from schuler import earth, frames, rotation
from schuler.arrays import ArrayLike, FloatArray, as_floats, as_vector3
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged


@dataclass(frozen=True, repr=False)
class Alignment(Abridged):
    """Attitude with its covariance.

    Attributes
    ----------
    t : float
        Time of validity. [s]
    rpy_nb : ndarray, shape (3,)
        Roll, pitch, yaw. [rad]
    cov_noise_n : ndarray, shape (3, 3)
        Covariance of the attitude error about north, east, down from everything but biases. [rad^2]
    method : str
        Method, a phrase for reports.
    psi_accel, psi_gyro : ndarray, shape (3, 3)
        Attitude error (n axes, estimate minus truth) per error of the accelerometer and gyro bias estimates used
        (body axes, estimate minus truth). [rad/(m/s^2)], [rad/(rad/s)]
    sigma_b_a, sigma_b_g : float
        1-sigma of those bias errors, per axis. [m/s^2], [rad/s]
    force : float, optional
        Size of the specific force at rest that it was levelled with. [m/s^2]
    """

    t: float
    rpy_nb: FloatArray
    cov_noise_n: FloatArray
    method: str
    psi_accel: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    psi_gyro: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    sigma_b_a: float = 0.0
    sigma_b_g: float = 0.0
    force: float | None = None

    @property
    def C_nb(self) -> FloatArray:
        """Attitude matrix, body to north-east-down."""
        return rotation.dcm_from_rpy(self.rpy_nb)

    @property
    def cov_psi_n(self) -> FloatArray:
        """Covariance of the attitude error about north, east, down, biases included. [rad^2]"""
        cov: FloatArray = (
            self.cov_noise_n
            + self.sigma_b_a**2 * self.psi_accel @ self.psi_accel.T
            + self.sigma_b_g**2 * self.psi_gyro @ self.psi_gyro.T
        )
        return cov

    def with_heading(self, heading: float, sigma: float, method: str) -> Alignment:
        """Add a heading from another source.

        Parameters
        ----------
        heading, sigma : float
            Heading and its 1-sigma error. [rad]
        method : str
            Phrase for reports.
        """
        if not sigma > 0.0:
            raise InputError(f"sigma: expected a positive 1-sigma heading error [rad], got {sigma!r}")
        # tilt errors belong to the body: about north and east they turn with it
        turn = rotation.dcm_from_rpy(np.array([0.0, 0.0, heading - self.rpy_nb[2]]))
        noise = turn @ self.cov_noise_n @ turn.T
        noise[2, :] = noise[:, 2] = 0.0
        noise[2, 2] = sigma**2
        accel, gyro = turn @ self.psi_accel, turn @ self.psi_gyro
        accel[2] = gyro[2] = 0.0
        rpy = np.array([self.rpy_nb[0], self.rpy_nb[1], float(frames.wrap_angle(heading))])
        return replace(
            self, rpy_nb=rpy, cov_noise_n=noise, method=f"{self.method}, {method}", psi_accel=accel, psi_gyro=gyro,
        )  # fmt: skip


def levelling(
    f_ib_b: ArrayLike,
    *,
    t: float = 0.0,
    sigma_bias: float = 0.0,
    sigma_noise: float = 0.0,
    sigma_heading: float = np.pi,
) -> Alignment:
    """Roll and pitch from the specific force at rest; the heading stays unknown.

    Parameters
    ----------
    f_ib_b : array_like, shape (3,) or (n, 3)
        Specific force at rest, body axes; samples are averaged. [m/s^2]
    t : float
        Time of validity. [s]
    sigma_bias, sigma_noise : float
        1-sigma of the accelerometer biases, and of everything else in the mean: noise, sway. [m/s^2]
    sigma_heading : float
        1-sigma of the heading, which is set to zero. [rad]

    Returns
    -------
    Alignment

    Raises
    ------
    InputError
        If the force is not that of a body at rest: off g by more than 5 percent and four sigma_bias.

    References
    ----------
    Groves (2013), eq. (5.101); Yaman (2017), section 6.2.1.1.
    """
    f = np.atleast_2d(as_floats(f_ib_b, "f_ib_b")).mean(axis=0)
    norm = float(np.linalg.norm(f))
    # the cheapest accelerometers have biases of 80 mg
    if not abs(norm - 9.81) < 0.05 * 9.81 + 4.0 * sigma_bias:
        raise InputError(
            f"levelling needs the specific force of a body at rest, about 9.81 m/s^2; got {norm:.3f} m/s^2. "
            "Use a stretch at rest, and check the unit and whether the log holds increments"
        )
    rpy = np.array([np.arctan2(-f[1], -f[2]), np.arctan2(f[0], np.hypot(f[1], f[2])), 0.0])
    # the levelled force has no horizontal part: dpsi x f_n = C db_a, with f_n = (0, 0, -g)
    psi_accel = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]) / norm @ rotation.dcm_from_rpy(rpy)
    tilt = (sigma_noise / norm) ** 2
    return Alignment(
        float(t), rpy, np.diag([tilt, tilt, sigma_heading**2]), "levelled", psi_accel=psi_accel, sigma_b_a=sigma_bias,
        force=norm,
    )  # fmt: skip


def gyrocompass(
    omega_ib_b: ArrayLike,
    f_ib_b: ArrayLike,
    lat: float,
    *,
    t: float = 0.0,
    sigma_gyro_bias: float = 0.0,
    sigma_gyro_noise: float = 0.0,
    sigma_accel_bias: float = 0.0,
    sigma_accel_noise: float = 0.0,
) -> Alignment:
    """Attitude at rest from gravity and Earth rate.

    Parameters
    ----------
    omega_ib_b, f_ib_b : array_like, shape (3,) or (n, 3)
        Angular rate [rad/s] and specific force [m/s^2] at rest, body axes; samples are averaged.
    lat : float
        Geodetic latitude. [rad]
    t : float
        Time of validity. [s]
    sigma_gyro_bias, sigma_gyro_noise : float
        1-sigma of the gyro biases, and of the noise in the mean rate. [rad/s]
    sigma_accel_bias, sigma_accel_noise : float
        The same of the accelerometers. [m/s^2]

    Returns
    -------
    Alignment
        Its heading error is the east gyro error over ``omega_ie cos(lat)``, less tilt about north times the tangent of
        the latitude.

    Raises
    ------
    InputError
        If the heading would be worse than 60 deg: too close to a pole, or gyros too poor for it.

    Notes
    -----
    Gravity is taken as exact and Earth rate only fixes the turn about it: the better sensor decides the tilt.

    References
    ----------
    Groves (2013), section 5.6.2; Du (2015), section 4.2.1.
    """
    level = levelling(f_ib_b, t=t, sigma_bias=sigma_accel_bias, sigma_noise=sigma_accel_noise)
    omega = np.atleast_2d(as_floats(omega_ib_b, "omega_ib_b")).mean(axis=0)
    horizontal = level.C_nb @ omega
    heading = float(np.arctan2(-horizontal[1], horizontal[0]))
    north_rate = earth.WGS84.omega_ie * np.cos(lat)
    sigma = np.inf
    if north_rate > 1e-12:
        tilt = np.hypot(sigma_accel_bias, sigma_accel_noise) / 9.81
        sigma = np.hypot(np.hypot(sigma_gyro_bias, sigma_gyro_noise) / north_rate, np.tan(lat) * tilt)
    if not sigma < np.pi / 3.0:
        raise InputError(
            f"gyrocompassing at latitude {lat:.4f} rad with a gyro error of "
            f"{np.hypot(sigma_gyro_bias, sigma_gyro_noise):.2e} rad/s would leave the heading unknown "
            f"(1-sigma {sigma:.2f} rad); give a heading from GNSS course, a compass or a survey"
        )
    turned = level.with_heading(heading, 1.0, "gyrocompassed")
    # no east component of Earth rate is left: dpsi_D omega_N - dpsi_N omega_D = (C db_g)_E
    accel = turned.psi_accel.copy()
    accel[2] = -np.tan(lat) * accel[0]
    gyro = np.zeros((3, 3))
    gyro[2] = turned.C_nb[1] / north_rate
    noise = turned.cov_noise_n.copy()
    noise[2, :] = noise[:, 2] = -np.tan(lat) * noise[0]
    noise[2, 2] = (sigma_gyro_noise / north_rate) ** 2 + np.tan(lat) ** 2 * noise[0, 0]
    return replace(
        turned, cov_noise_n=noise, psi_accel=accel, psi_gyro=gyro, sigma_b_g=sigma_gyro_bias,
        method="levelled and gyrocompassed",
    )  # fmt: skip


def heading_from_course(v_eb_n: ArrayLike, sigma_v: float, *, sigma_sideslip: float = 0.0) -> tuple[float, float]:
    """Heading of a vehicle that drives forward, from its velocity over ground.

    Parameters
    ----------
    v_eb_n : array_like, shape (3,)
        Velocity north, east, down. [m/s]
    sigma_v : float
        1-sigma error of a horizontal velocity component. [m/s]
    sigma_sideslip : float
        1-sigma angle between course and heading: tyres, mounting, wind. [rad]

    Returns
    -------
    heading, sigma : float
        [rad]

    Raises
    ------
    InputError
        If the vehicle is too slow for its course to mean anything (below three times ``sigma_v``).

    References
    ----------
    Groves (2013), section 5.6.1.
    """
    v = as_vector3(v_eb_n, "v_eb_n")
    speed = float(np.hypot(v[0], v[1]))
    if speed < 3.0 * sigma_v:
        raise InputError(
            f"course needs a speed well above the velocity error; got {speed:.3f} m/s with sigma {sigma_v:.3f} m/s"
        )
    return float(np.arctan2(v[1], v[0])), float(np.hypot(sigma_v / speed, sigma_sideslip))
