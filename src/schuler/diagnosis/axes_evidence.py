"""Where a vehicle's axes lie in the sensor, measured: regressions of the IMU on the motion that GNSS tells.

With the lag found, accelerometer means are regressed on acceleration forward and to the right, gyro means on the turn
rate. The columns are where the vehicle's forward and right axes, and its down axis as the gyro has it, lie in the
sensor; gravity at rest gives down as the accelerometer has it. Specific force is ``-gravity``, so that down is where
the accelerometer reads ``-g``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.diagnosis.motion import Motion, WindowMeans


@dataclass(frozen=True)
class AxesEvidence:
    """Where the vehicle's axes lie in the sensor, as measured.

    Attributes
    ----------
    B : ndarray, shape (3, 3)
        Columns: forward, right, down in the accelerometer's axes as read, one each long if the unit is right.
    sigma : ndarray, shape (3,)
        1-sigma of a component of each column.
    e : ndarray, shape (3,)
        Down in the gyro's axes as read, times the factor of its unit.
    e_sigma : float
    tilt : ndarray, shape (2, 3)
        Rates of tilt forward and to the right, in g-components a second, by the gyro's axes; zeros if not known.
    tilt_sigma : ndarray, shape (2, 3)
    centripetal : ndarray, shape (2,)
        Rough lever arm forward and right of the antenna from the IMU [m], ``nan`` if not known.
    arm_sigma : ndarray, shape (2,)
    climb, climb_sigma : ndarray, shape (3,)
        Forward in the gyro's axes as read, times the factor of its unit: by turns on a slope.
    """

    B: FloatArray
    sigma: FloatArray
    e: FloatArray
    e_sigma: float
    tilt: FloatArray
    tilt_sigma: FloatArray
    arm: FloatArray
    arm_sigma: FloatArray
    climb: FloatArray
    climb_sigma: FloatArray


def measure_axes(
    means: WindowMeans, motion: Motion, offset: float, accel_factor: float, level_f: FloatArray, gravity: float
) -> AxesEvidence | None:
    """Evidence on axes from a moving log; None if too little of it overlaps.

    Parameters
    ----------
    means : WindowMeans
    motion : Motion
    offset : float
        To be added to the IMU's stamps. [s]
    accel_factor : float
        Makes the accelerometer's numbers SI.
    level_f : ndarray, shape (3,)
        Its mean at rest or over the log, as read.
    gravity : float
        [m/s^2]
    """
    use = motion.moving
    y, inside = means.at(motion.t[use] - offset, motion.half)
    if inside.sum() < 20:
        return None
    y = y[inside]
    fwd, right, turn = (x[use][inside] for x in (motion.forward, motion.right, motion.turn))
    samples = max(len(fwd) * float(np.median(np.diff(motion.t))) / (2.0 * motion.half), 4.0)  # independent ones
    A = np.stack((fwd, right, np.ones(len(fwd))), axis=1)
    f = y[:, :3] * accel_factor
    c, left, G = _robust(A, f)
    noise = float(np.sqrt(np.mean(left**2)))
    spread = np.sqrt(np.maximum(np.diag(G)[:2], 0.0) * len(fwd) / samples)
    down = -level_f * accel_factor / gravity
    B = np.stack((c[0], c[1], down / max(float(np.linalg.norm(down)), 1e-12)), axis=1)
    sigma = np.array([*(np.maximum(noise * spread, 0.02)), 0.05])
    w = y[:, 3:]
    cw, left_w, Gw = _robust(np.stack((turn, np.ones(len(turn))), axis=1), w)
    e_sigma = float(np.sqrt(np.mean(left_w**2)) * np.sqrt(max(Gw[0, 0], 0.0) * len(fwd) / samples))
    tilt, tilt_sigma = _tilts(means, motion, offset, accel_factor, B, gravity)
    arm, arm_sigma = _arm(motion, use, inside, f, w, c, cw[0], samples)
    climb, climb_sigma = _climb(turn, motion.slope[use][inside], w, samples)
    return AxesEvidence(B, sigma, cw[0], e_sigma, tilt, tilt_sigma, arm, arm_sigma, climb, climb_sigma)


def _climb(turn: FloatArray, slope: FloatArray, w: FloatArray, samples: float) -> tuple[FloatArray, FloatArray]:
    """Forward axis in the gyro: a body that climbs at ``theta`` while it turns rolls at ``-turn sin(theta)``.

    A roll axis is seen by that even where the body never leans, as in simulations of flat curves. Misalignments are in
    the column of the turn itself.
    """
    c, left, G = _robust(np.stack((turn, turn * slope, np.ones(len(turn))), axis=1), w)
    # neighbouring windows are off alike: twice what independent ones would have
    sigma = 2.0 * np.sqrt(np.mean(left**2, axis=0) * max(G[1, 1], 0.0) * len(turn) / samples)
    return -c[1], np.asarray(sigma)


def _robust(A: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Least squares with rows beyond 4 robust deviations left out once."""
    size = np.sqrt(np.mean(A**2, axis=0))
    size = np.where(size > 0.0, size, 1.0)
    a = A / size
    keep = np.ones(len(a), dtype=bool)
    for _ in range(2):
        G = np.linalg.pinv(a[keep].T @ a[keep], hermitian=True)
        c = G @ (a[keep].T @ y[keep])
        left = np.linalg.norm(y - a @ c, axis=1)
        keep = left <= 5.0 * 1.4826 * float(np.median(left)) + 1e-12
    return c / size[:, None], (y - a @ c)[keep], G / np.outer(size, size)


def _tilts(
    means: WindowMeans, motion: Motion, offset: float, factor: float, B: FloatArray, gravity: float
) -> tuple[FloatArray, FloatArray]:
    """Change of the level components of gravity, per second, regressed on the gyro's axes."""
    none = np.zeros((2, 3)), np.full((2, 3), np.inf)
    half, lag = motion.half, 2.0 * motion.half
    start = motion.t[0]
    edges = np.arange(start + half, motion.t[-1] - half, lag)
    if len(edges) < 30:
        return none
    f, inside = means.at(edges - offset, half)
    at = [np.interp(edges, motion.t, np.where(motion.moving, x, 0.0)) for x in (motion.forward, motion.right)]
    slow = np.interp(edges, motion.t, motion.moving.astype(float))
    usable = inside & ((slow > 0.999) | (np.interp(edges, motion.t, motion.speed) < 0.05))
    q, r = np.linalg.qr(B)
    C = q * np.sign(np.diag(r))
    level = (f[:, :3] * factor) @ C  # along forward, right, down
    g = -np.stack((level[:, 0] - at[0], level[:, 1] - at[1]), axis=1) / gravity
    rate = np.diff(g, axis=0) / lag
    w, _ = means.at(0.5 * (edges[1:] + edges[:-1]) - offset, half)
    keep = usable[1:] & usable[:-1] & (np.linalg.norm(rate, axis=1) < 0.5)
    if keep.sum() < 30:
        return none
    x, y = w[keep][:, 3:], rate[keep]
    x, y = x - x.mean(axis=0), y - y.mean(axis=0)
    size = x.std(axis=0)
    if not np.all(size > 0.0):
        return none
    G = np.linalg.pinv(x.T @ x, hermitian=True)
    c = (G @ (x.T @ y)).T
    left = y - x @ c.T
    sigma = np.sqrt(np.outer(np.mean(left**2, axis=0), np.diag(G)) * 2.0)
    return c, sigma


def _arm(
    motion: Motion,
    use: BoolArray,
    inside: BoolArray,
    f: FloatArray,
    w: FloatArray,
    c: FloatArray,
    e: FloatArray,
    samples: float,
) -> tuple[FloatArray, FloatArray]:
    """Rough horizontal lever arm from what turning adds to specific force at the IMU.

    The antenna is at l from the IMU and x ahead of the point that goes where the body points (a rear axle): its course
    is off the heading by ``x r / V``, so that ``f_fwd = a_fwd + dr l_y + (l_x - x) r^2`` and
    ``f_right = a_right - dr l_x + r^2 l_y + a_fwd x r / V``. The x of the two is left free.
    """
    nan = np.full(2, np.nan), np.full(2, np.inf)
    axes = c[:2] / np.maximum(np.linalg.norm(c[:2], axis=1, keepdims=True), 1e-12)
    along = (f - c[2]) @ axes.T
    fwd, right, speed = (x[use][inside] for x in (motion.forward, motion.right, motion.speed))
    rate = (w - w.mean(axis=0)) @ e / max(float(e @ e), 1e-300)
    if rate.std() < 0.03:
        return nan
    t = motion.t[use][inside]
    step = float(np.median(np.diff(t)))
    turn = np.gradient(rate, t)
    turn[np.concatenate(([False], np.diff(t) > 1.5 * step))] = 0.0
    one, zero = np.ones(len(rate)), np.zeros(len(rate))
    A = np.concatenate(
        (
            np.stack((zero, turn, rate**2, zero, fwd, zero, one, zero), axis=1),
            np.stack((-turn, rate**2, zero, fwd * rate / speed, zero, right, zero, one), axis=1),
        )
    )
    y = np.concatenate((along[:, 0], along[:, 1]))
    x, left, G = _robust(A, y[:, None])
    sigma = np.sqrt(np.mean(left**2) * np.diag(G)[:2] * len(rate) / samples)
    return np.asarray(x[:2, 0]), np.maximum(2.0 * sigma, 0.15)
