"""Initial attitude: levelling, gyrocompassing, heading from course.

Every result carries its covariance, because the filter that starts from it must know how wrong it may be.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler import earth, frames, rotation
from schuler.arrays import ArrayLike, FloatArray, as_floats, as_vector3
from schuler.exceptions import InputError


@dataclass(frozen=True)
class Alignment:
    """An attitude and how well it is known.

    Attributes
    ----------
    t : float
        Time of validity. [s]
    rpy_nb : ndarray, shape (3,)
        Roll, pitch, yaw. [rad]
    cov_psi_n : ndarray, shape (3, 3)
        Covariance of the attitude error about north, east and down (estimate minus truth). [rad^2]
    method : str
        How it was found, a phrase for reports.
    """

    t: float
    rpy_nb: FloatArray
    cov_psi_n: FloatArray
    method: str

    @property
    def C_nb(self) -> FloatArray:
        """Attitude matrix, body to north-east-down."""
        return rotation.dcm_from_rpy(self.rpy_nb)

    def with_heading(self, heading: float, sigma: float, method: str) -> Alignment:
        """The same roll and pitch with a heading from elsewhere.

        Parameters
        ----------
        heading, sigma : float
            Heading and its 1-sigma error. [rad]
        method : str
            Phrase for reports.
        """
        if not sigma > 0.0:
            raise InputError(f"sigma: expected a positive 1-sigma heading error [rad], got {sigma!r}")
        # the tilt covariance was about north and east of the old heading; it belongs to the body, so it turns along
        turn = rotation.dcm_from_rpy(np.array([0.0, 0.0, heading - self.rpy_nb[2]]))
        cov = turn @ self.cov_psi_n @ turn.T
        cov[2, :] = cov[:, 2] = 0.0
        cov[2, 2] = sigma**2
        rpy = np.array([self.rpy_nb[0], self.rpy_nb[1], float(frames.wrap_angle(heading))])
        return Alignment(self.t, rpy, cov, f"{self.method}, {method}")


def levelling(
    f_ib_b: ArrayLike, *, t: float = 0.0, sigma_accel: float = 0.0, sigma_heading: float = np.pi
) -> Alignment:
    """Roll and pitch from the specific force at rest; the heading stays unknown.

    Parameters
    ----------
    f_ib_b : array_like, shape (3,) or (n, 3)
        Specific force at rest, body axes; samples are averaged. [m/s^2]
    t : float
        Time of validity. [s]
    sigma_accel : float
        1-sigma error of the mean specific force, bias included. [m/s^2]
    sigma_heading : float
        1-sigma of the heading, which is set to zero. [rad]

    Returns
    -------
    Alignment

    Raises
    ------
    InputError
        If the force is not that of a body at rest (5 percent off g).

    References
    ----------
    Groves (2013), eq. (5.101); Yaman (2017), section 6.2.1.1.
    """
    f = np.atleast_2d(as_floats(f_ib_b, "f_ib_b")).mean(axis=0)
    norm = float(np.linalg.norm(f))
    if not 0.95 < norm / 9.81 < 1.05:
        raise InputError(
            f"levelling needs the specific force of a body at rest, about 9.81 m/s^2; got {norm:.3f} m/s^2. "
            "Use a stretch at rest, and check the unit and whether the log holds increments"
        )
    rpy = np.array([np.arctan2(-f[1], -f[2]), np.arctan2(f[0], np.hypot(f[1], f[2])), 0.0])
    tilt = (sigma_accel / norm) ** 2
    return Alignment(float(t), rpy, np.diag([tilt, tilt, sigma_heading**2]), "levelled")


def gyrocompass(
    omega_ib_b: ArrayLike,
    f_ib_b: ArrayLike,
    lat: float,
    *,
    t: float = 0.0,
    sigma_gyro: float = 0.0,
    sigma_accel: float = 0.0,
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
    sigma_gyro, sigma_accel : float
        1-sigma errors of the means, biases included. [rad/s], [m/s^2]

    Returns
    -------
    Alignment
        Its heading error is the east gyro error over ``omega_ie cos(lat)``, plus tilt times the tangent of latitude.

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
    level = levelling(f_ib_b, t=t, sigma_accel=sigma_accel)
    omega = np.atleast_2d(as_floats(omega_ib_b, "omega_ib_b")).mean(axis=0)
    horizontal = rotation.dcm_from_rpy(level.rpy_nb) @ omega
    heading = float(np.arctan2(-horizontal[1], horizontal[0]))
    north_rate = earth.WGS84.omega_ie * np.cos(lat)
    tilt = level.cov_psi_n[0, 0]
    variance = (sigma_gyro / north_rate) ** 2 + np.tan(lat) ** 2 * tilt if north_rate > 0 else np.inf
    if not np.sqrt(variance) < np.pi / 3.0:
        raise InputError(
            f"gyrocompassing at latitude {lat:.4f} rad with a gyro error of {sigma_gyro:.2e} rad/s would leave the heading "
            f"unknown (1-sigma {np.sqrt(variance):.2f} rad); give a heading from GNSS course, a compass or a survey"
        )
    # levelling leaves the body's x axis north in its own axes: the heading turns them
    result = level.with_heading(heading, max(float(np.sqrt(variance)), 1e-12), "gyrocompassed")
    cov = result.cov_psi_n.copy()
    # a tilt about north leaks vertical Earth rate into the east direction the heading is taken from
    cov[0, 2] = cov[2, 0] = np.tan(lat) * tilt
    return Alignment(result.t, result.rpy_nb, cov, "levelled and gyrocompassed")


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
