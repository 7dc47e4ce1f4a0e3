"""Time between the IMU's clock and the GNSS receiver's: the shift at which one explains the other best.

Turn rate is regressed on the three gyro channels, and acceleration along and across the course on the three
accelerometer channels, at each trial shift. A regression does not care for units, signs, axes and mounting, so that the
shift is found whatever else is wrong. (Correlation of turn rates is Levinson, IEEE TIM 2009, and others'; the
regression makes it independent of axes.)

Shifts are compared by the likelihood of all of the motion: what an IMU does not cover at a shift it does not explain
there, and windows that overlap or whose residuals are alike count once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.diagnosis.motion import Motion, WindowMeans

NEAR_S, NARROW_S, WIDE_S = 6.0, 25.0, 400.0
_BLOCKS = 8
_COARSE = 400  # epochs used for the first look
_AT_ONCE = 20_000  # windows in memory at a time
_COMMON = 0.25  # share of the motion that an IMU must cover to be compared with it
_LEAST = 8.0  # log-likelihood by which a match must lead no match, beyond what the number of trials gives
_LONGEST_S = 20.0  # residuals further apart are independent


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
    samples : ndarray, shape (3,)
        Number of independent samples of turn rate, forward and right acceleration.
    evidence : float
        Log-likelihood ratio of the shift against no motion in common, less what the best of so many trials has by
        chance.
    """

    offset: float
    sigma: float
    r2: FloatArray
    clear: float
    drift: float
    drift_sigma: float
    curve: FloatArray
    samples: FloatArray
    evidence: float

    @property
    def matched(self) -> bool:
        """Whether the two logs share a motion."""
        return bool(self.r2.max() > 0.35 and self.clear > 0.1 and self.evidence > _LEAST)


def explained(
    means: WindowMeans,
    motion: Motion,
    shifts: FloatArray,
    keep: BoolArray | None = None,
    ahead: float = 0.0,
) -> FloatArray:
    """Share of the variance that the IMU explains, for each shift added to its stamps.

    Parameters
    ----------
    means : WindowMeans
    motion : Motion
    shifts : ndarray, shape (k,)
        [s]
    keep : ndarray of bool, shape (n,), optional
        Only these times of ``motion``.
    ahead : float
        How far the antenna is ahead of the point that goes where the body points, in a car the rear axle: the course
        there is ``heading + ahead r / V``, which looks like a clock that is ``ahead / V`` wrong. [m]

    Returns
    -------
    ndarray, shape (k, 3)
        Shares of turn rate, forward and right acceleration; zeros where the two have too little in common.
    """
    shifts = np.atleast_1d(np.asarray(shifts, dtype=np.float64))
    use = motion.moving if keep is None else motion.moving & keep
    # the bend needs neighbours in time, whatever is used
    t = motion.t if ahead else motion.t[use]
    targets = np.stack((motion.turn[use], motion.forward[use], motion.right[use]), axis=1)
    per = max(1, _AT_ONCE // max(len(t), 1))
    out = np.zeros((len(shifts), 3))
    for start in range(0, len(shifts), per):
        part = shifts[start : start + per]
        y, inside = means.at((t[None, :] - part[:, None]).ravel(), motion.half)
        y -= means.origin
        y, inside = y.reshape(len(part), -1, 6), inside.reshape(len(part), -1)
        if ahead:
            w = y[..., 3:]
            faster = (w - w.mean(axis=1, keepdims=True)) / np.maximum(motion.speed, 1.0)[:, None]
            y[..., 3:] = w + ahead * np.gradient(faster, motion.t, axis=1)
            y, inside = y[:, use], inside[:, use]
        out[start : start + per] = _shares(y, inside, targets)
    return out


def _shares(y: FloatArray, inside: BoolArray, x: FloatArray) -> FloatArray:
    """R squared of turn rate on the gyro, of both accelerations on the accelerometer. (k, n, 6), (k, n), (n, 3)."""
    w = inside.astype(np.float64)
    y = y * w[..., None]
    number = w.sum(axis=1)
    count = np.maximum(number, 1.0)[:, None]
    x = x - x.mean(axis=0)
    # sums of squares and products about the means of what is inside
    sum_y, sum_x = y.sum(axis=1), w @ x
    total = w @ (x * x) - sum_x**2 / count
    out = np.zeros((len(y), 3))
    for columns, target in ((slice(3, 6), slice(0, 1)), (slice(0, 3), slice(1, 3))):
        A, s = y[..., columns], sum_y[:, columns] / count
        G = A.mT @ A - count[..., None] * s[:, :, None] * s[:, None, :]
        b = A.mT @ x[:, target] - s[:, :, None] * sum_x[:, None, target]
        size = np.sqrt(np.maximum(np.diagonal(G, axis1=1, axis2=2), 0.0))
        size = np.where(size > 0.0, size, 1.0)
        G = G / (size[:, :, None] * size[:, None, :]) + 1e-9 * np.eye(3)
        b = b / size[:, :, None]
        fit = np.sum(b * np.linalg.solve(G, b), axis=1)
        out[:, target] = np.clip(fit / np.where(total[:, target] > 0.0, total[:, target], np.inf), 0.0, 1.0)
    # few samples are explained by anything
    out[number < max(15.0, _COMMON * len(x))] = 0.0
    return out


def score(r2: FloatArray) -> FloatArray:
    """Log-likelihood per sample, up to a constant: each target's residual variance counts by its logarithm.

    Parameters
    ----------
    r2 : ndarray, shape (k, 3)

    Returns
    -------
    ndarray, shape (k,)
    """
    return np.asarray(-0.5 * np.sum(np.log(np.maximum(1.0 - r2, 1e-4)), axis=-1))


def covered(means: WindowMeans, motion: Motion, shifts: FloatArray, keep: BoolArray | None = None) -> FloatArray:
    """Share of the motion that the IMU's log covers at each shift. Shape (k,)."""
    t = motion.t[motion.moving if keep is None else motion.moving & keep]
    first = np.searchsorted(t, means.t[0] + motion.half + shifts, side="left")
    last = np.searchsorted(t, means.t[-1] - motion.half + shifts, side="right")
    return np.asarray(np.maximum(last - first, 0) / max(len(t), 1))


def independent_samples(means: WindowMeans, motion: Motion, offset: float) -> FloatArray:
    """Number of independent samples of each target: time in motion over the correlation time of its residuals.

    Parameters
    ----------
    means : WindowMeans
    motion : Motion
    offset : float
        To be added to the IMU's stamps. [s]

    Returns
    -------
    ndarray, shape (3,)
    """
    y, inside = means.at(motion.t - offset, motion.half)
    use = motion.moving & inside
    if use.sum() < 20:
        return np.zeros(3)
    y = y - means.origin
    step = float(np.median(np.diff(motion.t)))
    most = min(int(_LONGEST_S / step), int(use.sum()) // 4)
    both = np.array([np.count_nonzero(use[j:] & use[: len(use) - j]) for j in range(1, most + 1)])
    out = np.zeros(3)
    targets = ((motion.turn, slice(3, 6)), (motion.forward, slice(0, 3)), (motion.right, slice(0, 3)))
    for k, (x, columns) in enumerate(targets):
        A = np.concatenate((y[use][:, columns], np.ones((int(use.sum()), 1))), axis=1)
        c, *_ = np.linalg.lstsq(A, x[use], rcond=None)
        e = np.zeros(len(use))
        e[use] = x[use] - A @ c
        power = float(e @ e) / float(use.sum())
        rho = np.array([e[j:] @ e[: len(e) - j] for j in range(1, most + 1)]) / np.maximum(both, 1) / max(power, 1e-300)
        end = int(np.argmax(rho < 0.05)) if np.any(rho < 0.05) else most
        tau = step * (1.0 + 2.0 * float(rho[:end].sum()))
        out[k] = motion.moving.sum() * step / max(tau, 2.0 * motion.half)
    return out


def log_likelihood(
    means: WindowMeans, motion: Motion, shifts: FloatArray, samples: FloatArray, keep: BoolArray | None = None
) -> FloatArray:
    """Log-likelihood ratio of each shift against no motion in common.

    Parameters
    ----------
    means : WindowMeans
    motion : Motion
    shifts : ndarray, shape (k,)
        [s]
    samples : ndarray, shape (3,)
        Independent ones of all of the motion.
    keep : ndarray of bool, shape (n,), optional
        Only these times of ``motion``.

    Returns
    -------
    ndarray, shape (k,)
    """
    moving = float(np.count_nonzero(motion.moving))
    share = 1.0 if keep is None else float(np.count_nonzero(motion.moving & keep)) / max(moving, 1.0)
    r2 = explained(means, motion, shifts, keep)
    gain = -0.5 * np.log(np.maximum(1.0 - r2, 1e-4)) @ samples
    return np.asarray(share * covered(means, motion, shifts, keep) * gain)


def find_lag(means: WindowMeans, motion: Motion, centre: float = 0.0, *, near: bool = False) -> Lag:
    """Offset of the IMU's clock from all of the motion.

    Parameters
    ----------
    means : WindowMeans
        Means of the IMU as read.
    motion : Motion
    centre : float
        Where to look first. [s]
    near : bool
        It is known to be within some seconds of ``centre``.

    Notes
    -----
    Searched within 25 s of ``centre`` (6 s if ``near``), and within 400 s if nothing is found there. The 1-sigma is the
    scatter of the offset in eight parts of the log over the root of their number.
    """
    index = np.flatnonzero(motion.moving)
    thin = np.zeros(len(motion.t), dtype=bool)
    thin[index[:: max(1, len(index) // _COARSE)]] = True
    offset, clear, curve = 0.0, 0.0, np.zeros((0, 2))
    for reach, step in ((NEAR_S, 0.25),) if near else ((NARROW_S, 0.25), (WIDE_S, 0.5)):
        shifts = centre + np.arange(-reach, reach + 0.5 * step, step)
        share = covered(means, motion, shifts)
        some = share >= _COMMON
        if np.count_nonzero(some) > 2:
            shifts, share = shifts[some], share[some]
        r2 = explained(means, motion, shifts, thin)
        # an IMU that covers less of the motion explains less of it
        scores = score(r2) * share / max(float(share.max()), 1e-9)
        k = int(np.argmax(scores))
        distant = np.abs(shifts - shifts[k]) > 3.0
        if len(curve) and scores[k] <= curve[:, 1].max() + 0.1:
            break  # nothing better further out
        offset = float(shifts[k])
        clear = float(scores[k] - scores[distant].max()) if distant.any() else 0.0
        curve = np.stack((shifts, scores), axis=1)
        # a shift that explains nearly all leaves no doubt; motion that repeats itself explains much at others
        if r2[k].max() > 0.85 and clear > 0.5:
            break
    offset = _refined(means, motion, offset, 0.25)
    r2 = explained(means, motion, np.array([offset]))[0]
    sigma, drift, drift_sigma = _scatter(means, motion, offset)
    samples = independent_samples(means, motion, offset)
    # three regressors for each of three targets, and the best of so many trials a window apart
    chance = 4.5 + np.log(max(len(curve) * float(np.median(np.diff(curve[:, 0]))) / (2.0 * motion.half), 1.0))
    evidence = float(log_likelihood(means, motion, np.array([offset]), samples)[0] - chance)
    return Lag(offset, sigma, r2, clear, drift, drift_sigma, curve, samples, evidence)


def at_ahead(means: WindowMeans, motion: Motion, offset: float, ahead: float) -> float:
    """Clock offset near another one, for an antenna so far ahead of the axle. [s]"""
    return _refined(means, motion, offset, 0.2, None, ahead)


def find_ahead(means: WindowMeans, motion: Motion, offset: float) -> tuple[float, float, float]:
    """Distance of the antenna ahead of the axle, the clock offset with it, and the gain in likelihood.

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
    results = []
    for ahead in trials:
        at = _refined(means, motion, offset, 0.25, None, float(ahead), rounds=2)
        results.append((float(score(explained(means, motion, np.array([at]), None, float(ahead)))[0]), at))
    scores = np.array([f[0] for f in results])
    k = int(np.clip(np.argmax(scores), 1, len(trials) - 2))
    bend = scores[k - 1] - 2.0 * scores[k] + scores[k + 1]
    shift = float(np.clip(0.5 * (scores[k - 1] - scores[k + 1]) / bend, -1.0, 1.0)) if bend < 0.0 else 0.0
    ahead = float(trials[k] + shift)
    at = _refined(means, motion, results[k][1], 0.1, None, ahead)
    seconds = motion.moving.sum() * float(np.median(np.diff(motion.t)))
    gain = (scores.max() - scores[int(np.argmin(np.abs(trials)))]) * seconds / (2.0 * motion.half)
    return ahead, at, float(gain)


def _refined(
    means: WindowMeans,
    motion: Motion,
    at: float,
    step: float,
    keep: BoolArray | None = None,
    ahead: float = 0.0,
    rounds: int = 4,
) -> float:
    """Maximum of the score near ``at``, by parabolas of shrinking width."""
    for _ in range(rounds):
        x = at + step * np.array([-1.0, 0.0, 1.0])
        s = score(explained(means, motion, x, keep, ahead))
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
    results, when = [], []
    for part in np.array_split(index, _BLOCKS):
        if len(part) < 30:
            continue
        keep = np.zeros(len(motion.t), dtype=bool)
        keep[part] = True
        trials = at + np.arange(-3.0, 3.01, 0.25)
        r2 = explained(means, motion, trials, keep)
        scores = score(r2)
        if scores.max() < 0.2 and r2[len(trials) // 2].max() < 0.4:
            continue  # straight and even: this part tells nothing
        results.append(_refined(means, motion, float(trials[int(np.argmax(scores))]), 0.2, keep))
        when.append(float(np.mean(motion.t[part])))
    if len(results) < 3:
        return 0.1, 0.0, np.inf
    x, y = np.array(when) - np.mean(when), np.array(results)
    off = 1.4826 * np.median(np.abs(y - np.median(y)))
    # few parts know their own scatter badly: Student's factor at 0.998 over the normal one
    student = (3.5, 2.3, 1.8, 1.6, 1.5, 1.4)[min(len(y), _BLOCKS) - 3]
    sigma = student * max(float(off), 0.005) / np.sqrt(len(y))
    slopes = [(y[j] - y[i]) / (x[j] - x[i]) for i in range(len(x)) for j in range(i + 1, len(x))]
    slope = float(np.median(slopes))
    resid = y - np.median(y - slope * x) - slope * x
    noise = max(1.4826 * float(np.median(np.abs(resid))), 0.01)
    return float(sigma), slope, float(noise / np.sqrt(np.sum(x**2)))
