"""Du's no-manoeuvre error model with a turning IMU, as numbers: exactly level, exactly vertical force."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schuler import rotation
from schuler.arrays import ArrayLike, FloatArray, as_vector3
from schuler.earth import WGS84, radii_of_curvature
from schuler.exceptions import InputError
from schuler.observability.dynamics import transitions
from schuler.observability.system import LinearSystem, state_names
from schuler.plotting.notebook import Abridged

_BLOCKS = {"dpsi": 3, "dv": 3, "b_a": 3, "b_g": 3}
_G = 9.806


@dataclass(frozen=True, kw_only=True, repr=False)
class RotaryModel(Abridged):
    """Twelve states of an IMU that turns at a constant rate, on a vehicle that does not manoeuvre.

    Attributes
    ----------
    axis : tuple of 3 floats, optional
        About which the platform turns, forward-right-down axes of the vehicle; None for an IMU that stands. Du's
        rotation about X is ``(0, 1, 0)`` here, about Y ``(1, 0, 0)``, about Z ``(0, 0, -1)``.
    rate : float
        [rad/s]
    rpy_nb : tuple of 3 floats
        Attitude of the vehicle: tilt and heading. [rad]
    lat : float
        [rad]
    earth_rate : float
        Zero leaves out what an IMU of low cost cannot see. [rad/s]
    gravity : float
        [m/s^2]
    force : tuple of 3 floats
        Specific force north, east, down beside gravity's: a constant horizontal acceleration. [m/s^2]
    jerk : tuple of 3 floats
        Its rate of change. [m/s^3]
    """

    axis: tuple[float, float, float] | None = None
    rate: float = 0.0
    rpy_nb: tuple[float, float, float] = (0.0, 0.0, 0.0)
    lat: float = 0.0
    earth_rate: float = WGS84.omega_ie
    gravity: float = _G
    force: tuple[float, float, float] = (0.0, 0.0, 0.0)
    jerk: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def C_ns(self, t: FloatArray) -> FloatArray:
        """Attitude of the IMU. Shapes (k,) to (k, 3, 3)."""
        C_nb = rotation.dcm_from_rpy(np.array(self.rpy_nb))
        if self.axis is None:
            return np.broadcast_to(C_nb, (len(t), 3, 3))
        u = as_vector3(self.axis, "axis")
        C_bs = rotation.dcm_from_rotvec(np.outer(self.rate * t, u / np.linalg.norm(u)))
        return np.asarray(C_nb @ C_bs)

    def matrices(self, t: FloatArray) -> FloatArray:
        """System matrices: attitude, velocity, accelerometer and gyroscope biases. Shapes (k,) to (k, 12, 12).

        References
        ----------
        Du (2015), eqs. (5.3)-(5.8) with the sign of the east Schuler loop corrected, (6.3)-(6.5), here in
        north-east-down axes and with errors of estimated biases.
        """
        k = len(t)
        F = np.zeros((k, 12, 12))
        s, c, tan = np.sin(self.lat), np.cos(self.lat), np.tan(self.lat)
        R_N, R_E = (float(R) for R in radii_of_curvature(self.lat))
        W = self.earth_rate * np.array([c, 0.0, -s])
        f = np.array(self.force) + np.outer(t, self.jerk) - np.array([0.0, 0.0, self.gravity])
        C = self.C_ns(t)
        F[:, 0:3, 0:3] = -rotation.skew(W)
        F[:, 0:3, 3:6] = -np.array([[0.0, 1.0 / R_E, 0.0], [-1.0 / R_N, 0.0, 0.0], [0.0, -tan / R_E, 0.0]])
        F[:, 0:3, 9:12] = -C
        F[:, 3:6, 0:3] = -rotation.skew(f)
        F[:, 3:6, 3:6] = -2.0 * rotation.skew(W)
        F[:, 3:6, 6:9] = -C
        return F

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the twelve states."""
        return state_names(_BLOCKS)


#: Velocity is measured.
VELOCITY_ROWS = np.hstack((np.zeros((3, 3)), np.eye(3), np.zeros((3, 6))))


def model_system(
    model: RotaryModel,
    *,
    duration: float,
    sigma: ArrayLike,
    rate_hz: float = 10.0,
    sigma_velocity: float = 0.01,
    step: float = 0.1,
    psd: ArrayLike | None = None,
    name: str = "Du's model",
) -> LinearSystem:
    """The model with measurements of velocity at a constant rate.

    Parameters
    ----------
    model : RotaryModel
    duration : float
        [s]
    sigma : array_like, shape (12,)
        Prior 1-sigma of attitude, velocity, accelerometer and gyroscope biases. SI
    rate_hz : float
        Rate of the measurements.
    sigma_velocity : float
        1-sigma of each. [m/s]
    step : float
        Largest step. [s]
    psd : array_like, shape (12,), optional
        Densities of the driving noise; none by default.
    name : str
    """
    if not (duration * rate_hz >= 1.0 and sigma_velocity > 0.0):
        raise InputError(f"expected at least one measurement of positive sigma, got {duration} s at {rate_hz} Hz")
    t = np.arange(int(np.floor(duration * rate_hz + 1e-9)) + 1) / rate_hz
    fine, rough = (transitions(model.matrices, t, step=h) for h in (0.5 * step, step))
    at = np.arange(1, len(t))
    system = LinearSystem(
        model.names, t, rough, np.broadcast_to(VELOCITY_ROWS / sigma_velocity, (len(at), 3, 12)), at,
        np.asarray(sigma, dtype=np.float64), np.zeros(12) if psd is None else np.asarray(psd, dtype=np.float64),
        to_imu=model.C_ns(t[:1])[0], name=name,
    )  # fmt: skip
    rough_phi = system.phi
    system = replace(system, step=fine)
    return replace(system, doubt=np.abs(system.phi - rough_phi))
