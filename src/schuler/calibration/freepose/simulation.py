"""A hand-rotated calibration log, simulated: to try a sequence of poses before spending an afternoon on it."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.rotation import dcm_from_quat, dcm_from_rotvec, rotvec_from_dcm
from schuler.sensors.errors import ImuErrors
from schuler.units import G0


def hand_log(
    errors: ImuErrors,
    rng: np.random.Generator,
    *,
    poses: int = 24,
    rest_s: float = 3.0,
    turn_s: float = 2.0,
    initial_rest_s: float = 20.0,
    rate_hz: float = 100.0,
    turn: float = 1.8,
    gravity: float = G0,
    rotvecs: FloatArray | None = None,
    places: ArrayLike | None = None,
    delay: float = 0.0,
    sway: float = 0.0,
    field_n: ArrayLike | None = None,
) -> ImuSeries:
    """Increments of an IMU put down in one pose after another.

    Parameters
    ----------
    errors : ImuErrors
        Of the unit, noise included.
    rng : numpy.random.Generator
        Draws the turns, then the noise.
    poses : int
        How many; the first is the initial rest, level.
    rest_s, turn_s, initial_rest_s : float
        Time at rest in each pose, for each turn, and in the first pose. [s]
    rate_hz : float
        Sampling rate.
    turn : float
        Turns are about random axes by angles uniform in 0.5 to 1 times this. [rad]
    gravity : float
        [m/s^2]
    rotvecs : ndarray, shape (poses - 1, 3), optional
        Rotation vector of each turn in body axes instead. [rad]
    places : array_like, shape (3, 3), optional
        Row i: where the accelerometer of axis i sits, from the point the unit turns about. [m]
    delay : float
        By which the gyroscopes report later than the accelerometers. [s]
    sway : float
        The unit is carried this far and back along each level axis in every turn. [m]
    field_n : array_like, shape (3,), optional
        Magnetic flux density north, east, down, which a magnetometer without errors measures. [T]

    Returns
    -------
    ImuSeries
        Kind "increment". The unit turns about a body-fixed axis at ``1 - cos`` rate within each turn; rates are exact
        means over intervals, specific force is that of the middle of the interval where the unit moves. The Earth does
        not turn.

    Raises
    ------
    InputError
        If a time is not positive or there are fewer than two poses.
    """
    if min(rest_s, turn_s, initial_rest_s, rate_hz) <= 0.0:
        raise InputError("rest_s, turn_s, initial_rest_s, rate_hz: expected positive numbers")
    if rotvecs is None:
        if poses < 2:
            raise InputError(f"poses: expected 2 or more, got {poses}")
        axes = rng.standard_normal((poses - 1, 3))
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        rotvecs = axes * rng.uniform(0.5 * turn, turn, (poses - 1, 1))
    else:
        rotvecs = as_floats(rotvecs, "rotvecs", (None, 3))
    arms = np.zeros((3, 3)) if places is None else as_floats(places, "places", (3, 3))
    n_turn, n_rest = max(2, round(turn_s * rate_hz)), max(2, round(rest_s * rate_hz))
    dt = 1.0 / rate_hz
    k = np.arange(n_turn) + 0.5
    up = np.array([0.0, 0.0, -1.0])

    def progress(phase: npt.NDArray[Any]) -> FloatArray:
        """Share of a turn that is done, 0 before and 1 after it."""
        phase = np.clip(phase, 0.0, 1.0)
        return np.asarray(phase - np.sin(2.0 * np.pi * phase) / (2.0 * np.pi))

    middle = k / n_turn
    speed = (1.0 - np.cos(2.0 * np.pi * middle)) / turn_s
    speed_rate = 2.0 * np.pi * np.sin(2.0 * np.pi * middle) / turn_s**2
    # there and back: a smooth bump in position, at rest at both ends
    bump = -sway * 8.0 * np.pi**2 / turn_s**2 * (np.cos(4.0 * np.pi * middle) - np.cos(2.0 * np.pi * middle)) / 4.0
    # a delayed turn reaches into the rest after it
    reach = min(n_rest, int(np.ceil(max(delay, 0.0) * rate_hz)) + 1)
    late = np.diff(progress((np.arange(n_turn + reach + 1) * dt - delay) / turn_s))
    C_nb = np.eye(3)
    dtheta = [np.zeros((max(2, round(initial_rest_s * rate_hz)), 3))]
    f = [np.tile(gravity * up, (len(dtheta[0]), 1))]
    b_n = np.zeros(3) if field_n is None else as_floats(field_n, "field_n", (3,))
    m = [np.tile(b_n, (len(dtheta[0]), 1))]
    for rotvec in rotvecs:
        dtheta.append(late[:, None] * rotvec)
        dtheta.append(np.zeros((n_rest - reach, 3)))
        C = C_nb @ dcm_from_rotvec(progress(middle)[:, None] * rotvec)
        force_n = gravity * up + bump[:, None] * np.array([1.0, 1.0, 0.0])
        omega, alpha = speed[:, None] * rotvec, speed_rate[:, None] * rotvec
        lever = np.cross(alpha[:, None, :], arms) + np.cross(omega[:, None, :], np.cross(omega[:, None, :], arms))
        f.append(np.einsum("kji,kj->ki", C, force_n) + np.einsum("kii->ki", lever))
        m.append(np.einsum("kji,j->ki", C, b_n))
        C_nb = C_nb @ dcm_from_rotvec(rotvec)
        m.append(np.tile(b_n @ C_nb, (n_rest, 1)))
        f.append(np.tile(gravity * (C_nb.T @ up), (n_rest, 1)))
    angles, forces = np.concatenate(dtheta), np.concatenate(f)
    gyro, accel, _ = errors.apply_increments(angles, forces * dt, dt, rng)
    t = np.asarray(dt * np.arange(1, len(gyro) + 1), dtype=np.float64)
    return ImuSeries(t, gyro, accel, "increment", magnetometer=None if field_n is None else np.concatenate(m))


def spread_turns(n: int, rng: np.random.Generator) -> FloatArray:
    """Rotation vectors between n attitudes drawn evenly over all: a generous sequence. Shape (n - 1, 3). [rad]"""
    q = rng.standard_normal((n, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    C = dcm_from_quat(q)
    C[0] = np.eye(3)
    return np.array([rotvec_from_dcm(a.T @ b) for a, b in pairwise(C)])
