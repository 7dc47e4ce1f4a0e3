"""Numbers of ROS messages by the path of their field, as ROS's conventions have them (REP 103, 105, 145)."""

from __future__ import annotations

from typing import Any

import numpy as np

from schuler import rotation, units
from schuler.arrays import FloatArray
from schuler.recording.formats.ros_tables import ENU, FLU

Fields = dict[str, Any]

#: Variance of an angular rate that is not in a message. [rad^2/s^2]
NOT_GIVEN = 1e6
_STATUS = {1: 2, 2: 2, 3: 1, 4: 2, 5: 0, 6: 0, 7: 0}  # NavSatStatus of our qualities


def imu_fields(gyro: FloatArray, accel: FloatArray) -> Fields:
    """Fields of ``sensor_msgs/Imu`` of angular rates [rad/s] and specific forces [m/s^2], forward-right-down. (n, 3)"""
    values: Fields = {"orientation_covariance.0": -1.0, "orientation.w": 1.0}  # -1: there is no orientation
    return values | _vectors("angular_velocity", gyro @ FLU) | _vectors("linear_acceleration", accel @ FLU)


def fix_fields(llh: FloatArray, cov_r_n: FloatArray, quality: Any) -> Fields:
    """Fields of ``sensor_msgs/NavSatFix``.

    Parameters
    ----------
    llh : ndarray, shape (n, 3)
        [rad], [rad], [m]
    cov_r_n : ndarray, shape (n, 3, 3)
        North, east, down. [m^2]
    quality : sequence of int, shape (n,)
        See :data:`schuler.recording.series.QUALITY`.
    """
    return {
        "status.status": [_STATUS.get(int(q), 0) for q in quality], "status.service": 1,
        "latitude": llh[:, 0] / units.DEG, "longitude": llh[:, 1] / units.DEG, "altitude": llh[:, 2],
        "position_covariance_type": 3, **_matrices("position_covariance", ENU @ cov_r_n @ ENU),
    }  # fmt: skip


def velocity_fields(v_n: FloatArray, cov_v_n: FloatArray) -> Fields:
    """Fields of ``geometry_msgs/TwistWithCovarianceStamped`` of velocities over ground, east-north-up.

    Parameters
    ----------
    v_n, cov_v_n : ndarray, shape (n, 3), (n, 3, 3)
        North, east, down. [m/s], [m^2/s^2]
    """
    cov = np.zeros((len(v_n), 6, 6))
    cov[:, :3, :3] = ENU @ cov_v_n @ ENU
    return _vectors("twist.twist.linear", v_n @ ENU) | _matrices("twist.covariance", cov)


def speed_fields(speed: FloatArray, sigma: FloatArray) -> Fields:
    """Fields of ``geometry_msgs/TwistWithCovarianceStamped`` of forward speeds and their 1-sigma. (n,), [m/s]"""
    return {"twist.twist.linear.x": speed, "twist.covariance.0": sigma**2}


def odometry_fields(r_n: FloatArray, C_nb: FloatArray | None = None, v_n: FloatArray | None = None) -> Fields:
    """Fields of ``nav_msgs/Odometry``: a pose east-north-up, a velocity forward-left-up.

    Parameters
    ----------
    r_n : ndarray, shape (n, 3)
        North, east, down of the origin. [m]
    C_nb : ndarray, shape (n, 3, 3), optional
        Attitude about the origin's axes; without it there is no velocity.
    v_n : ndarray, shape (n, 3), optional
        Along the origin's axes. [m/s]
    """
    values = _vectors("pose.pose.position", r_n @ ENU)
    if C_nb is None:
        return values
    q = rotation.quat_from_dcm(ENU @ C_nb @ FLU)
    values |= {f"pose.pose.orientation.{axis}": q[:, k] for k, axis in enumerate("wxyz")}
    if v_n is not None:
        values |= _vectors("twist.twist.linear", np.einsum("nji,nj->ni", C_nb, v_n) @ FLU)
    return values


def odometry_covariances(cov_r_n: FloatArray, cov_psi_n: FloatArray, cov_v_n: FloatArray, C_nb: FloatArray) -> Fields:
    """Covariances of ``nav_msgs/Odometry``, from those of position, attitude and velocity north, east, down.

    Parameters
    ----------
    cov_r_n, cov_psi_n, cov_v_n : ndarray, shape (n, 3, 3)
        [m^2], of rotation vectors about north, east, down [rad^2], [m^2/s^2]
    C_nb : ndarray, shape (n, 3, 3)
        Attitude.
    """
    pose, twist = np.zeros((2, len(C_nb), 6, 6))
    pose[:, :3, :3], pose[:, 3:, 3:] = ENU @ cov_r_n @ ENU, ENU @ cov_psi_n @ ENU
    C_fn = FLU @ C_nb.swapaxes(1, 2)
    twist[:, :3, :3] = C_fn @ cov_v_n @ C_fn.swapaxes(1, 2)
    twist[:, 3:, 3:] = NOT_GIVEN * np.eye(3)
    return _matrices("pose.covariance", pose) | _matrices("twist.covariance", twist)


def _vectors(stem: str, vectors: FloatArray) -> Fields:
    return {f"{stem}.{axis}": vectors[:, k] for k, axis in enumerate("xyz")}


def _matrices(stem: str, matrices: FloatArray) -> Fields:
    n = matrices.shape[1]
    return {f"{stem}.{k}": matrices[:, k // n, k % n] for k in range(n * n)}
