"""Time between the IMU's clock and the GNSS receiver's: the shift at which one explains the other best.

Turn rate is regressed on the three gyro channels, and acceleration along and across the course on the three
accelerometer channels, at each trial shift. A regression does not care for units, signs, axes and mounting, so that the
shift is found whatever else is wrong. (Correlation of turn rates is Levinson, IEEE TIM 2009, and others'; the
regression makes it independent of axes.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.diagnosis.motion import Motion, WindowMeans

NARROW_S, WIDE_S = 25.0, 400.0
_BLOCKS = 8
_COARSE = 700  # epochs used for the first look


@dataclass(frozen=True)
class Lag:
    """Time offset of an IMU.

    Attributes
    ----------
    offset : float
        To be added to the IMU's stamps. [s]
    sigma : float
        1-sigma. [s]
    r2 : ndarray, shape (3,)
        Share of the variance of turn rate, forward and right acceleration that the IMU explains.
    clear : float
        Log-likelihood per sample by which the best shift leads the best one 3 s or more away.
    drift, drift_sigma : float
        Change of the offset over time. [s/s]
    curve : ndarray, shape (m, 2)
        Trial shifts [s] and their scores.
    """

    offset: float
    sigma: float
    r2: FloatArray
    clear: float
    drift: float
    drift_sigma: float
    curve: FloatArray

    @property
    def found(self) -> bool:
        """Whether the two logs share a motion."""
        return bool(self.r2.max() > 0.35 and self.clear > 0.1)


def explained(
    means: WindowMeans, motion: Motion, shift: float, keep: BoolArray | None = None, ahead: float = 0.0
) -> FloatArray:
    """Share of the variance explained with ``shift`` added to the IMU's stamps. Shape (3,): turn, forward, right.

    ``ahead`` is how far the antenna is ahead of the point that goes where the body points, in a car the rear axle [m]:
    the course there is ``heading + ahead r / V``, which looks like a clock that is ``ahead / V`` wrong.
    """
    use = motion.moving if keep is None else motion.moving & keep
    if ahead:
        everywhere, inside = means.at(motion.t - shift, motion.half)
        w = everywhere[:, 3:]
        bent = np.gradient((w - w.mean(axis=0)) / np.maximum(motion.speed, 1.0)[:, None], motion.t, axis=0)
        everywhere[:, 3:] = w + ahead * bent
        y, inside = everywhere[use], inside[use]
    else:
        y, inside = means.at(motion.t[use] - shift, motion.half)
    # few samples are explained by anything
    if inside.sum() < max(15.0, 0.25 * len(inside)):
        return np.zeros(3)
    y = y[inside]
    y = y - y.mean(axis=0)
    out = np.zeros(3)
    for i, (target, columns) in enumerate(
        ((motion.turn, slice(3, 6)), (motion.forward, slice(0, 3)), (motion.right, slice(0, 3)))
    ):
        x = target[use][inside]
        x = x - x.mean()
        A = y[:, columns]
        size = np.sqrt(np.sum(A * A, axis=0))
        A = A / np.where(size > 0.0, size, 1.0)
        G = A.T @ A + 1e-9 * np.eye(3)
        b = A.T @ x
        total = float(x @ x)
        out[i] = 0.0 if total <= 0.0 else float(np.clip(b @ np.linalg.solve(G, b) / total, 0.0, 1.0))
    return out


def score(r2: FloatArray) -> float:
    """Log-likelihood per sample, up to a constant: each target's residual variance counts by its logarithm."""
    return float(-0.5 * np.sum(np.log(np.maximum(1.0 - r2, 1e-4))))


def find_lag(means: WindowMeans, motion: Motion, centre: float = 0.0) -> Lag:
    """Offset of the IMU's clock from all of the motion.

    Parameters
    ----------
    means : WindowMeans
        Of the IMU as read.
    motion : Motion
    centre : float
        Where to look first. [s]

    Notes
    -----
    Searched within 25 s of ``centre``, and within 400 s if nothing is found there. The 1-sigma is the scatter of the
    offset in eight parts of the log over the root of their number.
    """
    index = np.flatnonzero(motion.moving)
    thin = np.zeros(len(motion.t), dtype=bool)
    thin[index[:: max(1, len(index) // _COARSE)]] = True
    offset, clear, curve = 0.0, 0.0, np.zeros((0, 2))
    for reach, step in ((NARROW_S, 0.25), (WIDE_S, 0.5)):
        shifts = centre + np.arange(-reach, reach + 0.5 * step, step)
        scores = np.array([score(explained(means, motion, s, thin)) for s in shifts])
        k = int(np.argmax(scores))
        far = np.abs(shifts - shifts[k]) > 3.0
        if len(curve) and scores[k] <= curve[:, 1].max() + 0.1:
            break  # nothing better further out
        offset = float(shifts[k])
        clear = float(scores[k] - scores[far].max()) if far.any() else 0.0
        curve = np.stack((shifts, scores), axis=1)
        # a shift that explains nearly all leaves no doubt; motion that repeats itself explains much at others
        if explained(means, motion, offset, thin).max() > 0.85 and clear > 0.5:
            break
    offset = _refined(means, motion, offset, 0.25)
    r2 = explained(means, motion, offset)
    sigma, drift, drift_sigma = _scatter(means, motion, offset)
    return Lag(offset, sigma, r2, clear, drift, drift_sigma, curve)


def at_ahead(means: WindowMeans, motion: Motion, offset: float, ahead: float) -> float:
    """Clock offset near another one, for an antenna so far ahead of the axle. [s]"""
    return _refined(means, motion, offset, 0.2, None, ahead)


def find_ahead(means: WindowMeans, motion: Motion, offset: float) -> tuple[float, float, float]:
    """How far the antenna is ahead of the axle, the clock offset with that, and by how much it explains better.

    Parameters
    ----------
    means : WindowMeans
    motion : Motion
    offset : float
        Found without it. [s]

    Returns
    -------
    ahead : float
        [m]
    offset : float
        [s]
    gain : float
        Log-likelihood ratio against no distance.
    """
    trials = np.arange(-2.0, 6.1, 1.0)
    found = []
    for ahead in trials:
        at = _refined(means, motion, offset, 0.25, None, float(ahead))
        found.append((score(explained(means, motion, at, None, float(ahead))), at))
    scores = np.array([f[0] for f in found])
    k = int(np.clip(np.argmax(scores), 1, len(trials) - 2))
    bend = scores[k - 1] - 2.0 * scores[k] + scores[k + 1]
    shift = float(np.clip(0.5 * (scores[k - 1] - scores[k + 1]) / bend, -1.0, 1.0)) if bend < 0.0 else 0.0
    ahead = float(trials[k] + shift)
    at = _refined(means, motion, found[k][1], 0.1, None, ahead)
    seconds = motion.moving.sum() * float(np.median(np.diff(motion.t)))
    gain = (scores.max() - scores[int(np.argmin(np.abs(trials)))]) * seconds / (2.0 * motion.half)
    return ahead, at, float(gain)


def _refined(
    means: WindowMeans, motion: Motion, at: float, step: float, keep: BoolArray | None = None, ahead: float = 0.0
) -> float:
    """Maximum of the score near ``at``, by parabolas of shrinking width."""
    for _ in range(4):
        x = at + step * np.array([-1.0, 0.0, 1.0])
        s = [score(explained(means, motion, v, keep, ahead)) for v in x]
        bend = s[0] - 2.0 * s[1] + s[2]
        if bend >= 0.0:
            at = float(x[int(np.argmax(s))])
            continue
        at = float(at + step * np.clip(0.5 * (s[0] - s[2]) / bend, -1.0, 1.0))
        step = max(0.4 * step, 0.03)
    return at


def _scatter(means: WindowMeans, motion: Motion, at: float) -> tuple[float, float, float]:
    """1-sigma of the offset and its drift, from parts of the log."""
    index = np.flatnonzero(motion.moving)
    found, when = [], []
    for part in np.array_split(index, _BLOCKS):
        if len(part) < 30:
            continue
        keep = np.zeros(len(motion.t), dtype=bool)
        keep[part] = True
        here = explained(means, motion, at, keep)
        trials = at + np.arange(-3.0, 3.01, 0.25)
        scores = [score(explained(means, motion, s, keep)) for s in trials]
        if max(scores) < 0.2 and here.max() < 0.4:
            continue  # straight and even: this part tells nothing
        found.append(_refined(means, motion, float(trials[int(np.argmax(scores))]), 0.2, keep))
        when.append(float(np.mean(motion.t[part])))
    if len(found) < 3:
        return 0.1, 0.0, np.inf
    x, y = np.array(when) - np.mean(when), np.array(found)
    off = 1.4826 * np.median(np.abs(y - np.median(y)))
    # few parts know their own scatter badly: Student's factor at 0.998 over the normal one
    student = (3.5, 2.3, 1.8, 1.6, 1.5, 1.4)[min(len(y), _BLOCKS) - 3]
    sigma = student * max(float(off), 0.005) / np.sqrt(len(y))
    slopes = [(y[j] - y[i]) / (x[j] - x[i]) for i in range(len(x)) for j in range(i + 1, len(x))]
    slope = float(np.median(slopes))
    resid = y - np.median(y - slope * x) - slope * x
    noise = max(1.4826 * float(np.median(np.abs(resid))), 0.01)
    return float(sigma), slope, float(noise / np.sqrt(np.sum(x**2)))
