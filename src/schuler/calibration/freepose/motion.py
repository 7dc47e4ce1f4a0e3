"""Size effect and delay from the turns of a calibrated log: the velocity gained between two rests is zero."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schuler.arrays import FloatArray
from schuler.calibration.freepose.gyro import GyroFit
from schuler.calibration.freepose.turns import Turns, rotations
from schuler.calibration.freepose.weights import excess_spread, outlier_weights, pseudo_inverse

#: Places of the accelerometers relative to that of the x accelerometer, estimated from the size effect. [m]
PLACES = ("r_a_yx", "r_a_yy", "r_a_yz", "r_a_zx", "r_a_zy", "r_a_zz")
#: Elements that the choice of the reference point holds.
HELD = {"r_a_xx": 0.0, "r_a_xy": 0.0, "r_a_xz": 0.0}


@dataclass(frozen=True, eq=False)
class MotionFit:
    """Places of accelerometers and delay.

    Attributes
    ----------
    names : tuple of str
    values : ndarray, shape (p,)
        [m], [s]
    covariance : ndarray, shape (p, p)
    residual : ndarray, shape (n, 3)
        Velocity gained in each turn, axes of its start. [m/s]
    sigma : ndarray, shape (n,)
        1-sigma of a component by noise. [m/s]
    spread : float
        Scatter beyond noise. [m/s]
    before : ndarray, shape (n,)
        Velocity gained without these parameters. [m/s]
    chi2 : float
    freedom : int
    """

    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    residual: FloatArray
    sigma: FloatArray
    spread: float
    before: FloatArray
    chi2: float
    freedom: int


def gained_velocity(
    turns: Turns, nominal: float, gyro: GyroFit, gravity: float, places: FloatArray, delay: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Velocity gained in each turn, with derivatives by places and delay.

    Parameters
    ----------
    turns : Turns
    nominal : float
        [rad/s per unit of the log]
    gyro : GyroFit
    gravity : float
        [m/s^2]
    places : ndarray, shape (3, 3)
        Row i: place of the accelerometer of axis i. [m]
    delay : float
        Delay of the gyroscopes behind the accelerometers. [s]

    Returns
    -------
    v : ndarray, shape (n, 3)
        ``integral of C f dt - g up T``, axes of the start. The attitude error that shows at the end of the turn is
        spread over it in proportion to time. [m/s]
    by_places : ndarray, shape (n, 3, 3, 3)
        [1/s]
    by_delay : ndarray, shape (n, 3)
        [m/s^2]
    """
    from schuler.calibration.freepose import _motion_kernels as kernels

    kernels.prepare_motion()
    if delay:  # rates at the time they were sensed, by straight lines between samples
        sensed = [np.interp(turns.t + delay, turns.t, axis) for axis in turns.gyro.T]
        turns = replace(turns, gyro=np.stack(sensed, axis=1))
    n = len(turns.spans)
    V, S, T, R = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3, 3, 3))
    Q = np.ascontiguousarray(nominal * np.linalg.inv(np.eye(3) + gyro.M))
    kernels.velocities(
        turns.t, turns.gyro, turns.accel, turns.spans, turns.before, Q, gyro.b / nominal,
        np.ascontiguousarray(turns.B_a), np.ascontiguousarray(turns.b_a), np.ascontiguousarray(places), V, S, T, R,
    )  # fmt: skip
    up = turns.up[turns.pair[:, 0]]
    seconds = turns.t[turns.spans[:, 1]] - turns.t[turns.spans[:, 0]]
    C, _, _ = rotations(turns, turns.spans, Q, gyro.b / nominal, None)
    # turning this brings the final vertical, seen from the start, onto the first one
    tilt = np.cross(np.einsum("kij,kj->ki", C, turns.up[turns.pair[:, 1]]), up)
    return V + np.cross(tilt, S) - gravity * seconds[:, None] * up, -R, T


def fit_motion(
    turns: Turns, nominal: float, gyro: GyroFit, gravity: float, noise: tuple[float, float], up_sigma: float,
    *, size_effect: bool, delay: bool, robust: bool,
) -> MotionFit:  # fmt: skip
    """Places of the accelerometers and delay of the gyroscopes from velocities gained between rests.

    Parameters
    ----------
    turns, nominal, gyro, gravity
        See :func:`gained_velocity`.
    noise : (float, float)
        N of gyroscopes [rad/s/sqrt(Hz)] and accelerometers [m/s^2/sqrt(Hz)].
    up_sigma : float
        1 sigma of a measured vertical. [rad]
    size_effect, delay, robust : bool

    Returns
    -------
    MotionFit
        The sum of equal lever arms cannot be seen (moving the reference point gains no velocity between rests): the x
        accelerometer is the reference. Covariance is by noise and by the scatter beyond it; the parameters of the
        first two steps are held.

    References
    ----------
    Velocity error between rests as the observation of a systematic calibration is common for navigation-grade units
    (Savage, Strapdown Analytics, 18.4); here each turn stands alone and the attitude is closed on both verticals.
    """
    if gyro.G.any():  # the rates at rest and in turns without what specific force adds to them
        f = (turns.accel - turns.b_a) @ turns.B_a.T
        turns = replace(turns, gyro=turns.gyro - f @ gyro.G.T / nominal)
    names = (PLACES if size_effect else ()) + (("delay",) if delay else ())
    N_g, N_a = noise
    seconds = turns.t[turns.spans[:, 1]] - turns.t[turns.spans[:, 0]]
    # a random walk that is tied at both ends has T/12 times its density on average over the turn
    variance = N_a**2 * seconds + gravity**2 * (N_g**2 * seconds**3 / 12.0 + up_sigma**2 * seconds**2 / 3.0)
    x, sigma = np.zeros(len(names)), np.sqrt(variance)
    before = np.linalg.norm(gained_velocity(turns, nominal, gyro, gravity, np.zeros((3, 3)), 0.0)[0], axis=1)
    freedom = 3 * len(seconds) - len(names)
    for _ in range(8):
        places = np.zeros((3, 3))
        if size_effect:
            places[1:] = x[:6].reshape(2, 3)
        v, by_places, by_delay = gained_velocity(turns, nominal, gyro, gravity, places, float(x[-1]) if delay else 0.0)
        columns = [by_places[:, :, 1:, :].reshape(len(v), 3, 6)] if size_effect else []
        J = np.concatenate(columns + ([by_delay[:, :, None]] if delay else []), axis=2)
        size = np.linalg.norm(v, axis=1)
        size = size / np.sqrt(max(freedom, 1) / v.size)
        spread = excess_spread(size, sigma, 3, robust)
        total = variance + spread**2
        weight = (outlier_weights(size / np.sqrt(total), 3) if robust else np.ones(len(v))) / total
        normal = np.einsum("kip,k,kiq->pq", J, weight, J)
        dx = -pseudo_inverse(normal) @ np.einsum("kip,k,ki->p", J, weight, v)
        x = x + dx
        if np.abs(dx).max() < 1e-9:
            break
    chi2 = float(((v * v).sum(axis=1) / variance).sum())
    return MotionFit(names, x, pseudo_inverse(normal), v, sigma, spread, before, chi2, freedom)
