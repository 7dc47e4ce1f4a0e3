"""Whether a GNSS solution was filtered or smoothed: quick turns and quick changes of speed beside the IMU's."""

from __future__ import annotations

from typing import Any

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.diagnosis.findings import Finding
from schuler.diagnosis.lag import Lag
from schuler.diagnosis.motion import Motion, WindowMeans

_SMOOTH = 0.6  # gain of quick changes against slow ones
_LEAST = (0.01, 0.05, 0.05)  # RMS of quick changes worth comparing: turn [rad/s], forward, right [m/s^2]
_PATH = 0.8  # share of slow accelerations that the path explains, for quick ones to be the path's and not the body's
_QUICK_S = 1.5


def check_smoothing(means: WindowMeans, motion: Motion, lag: Lag) -> list[Finding]:
    """Whether quick motion comes through a GNSS solution as slow motion does, compared with the IMU.

    Parameters
    ----------
    means : WindowMeans
    motion : Motion
    lag : Lag

    Notes
    -----
    Turn rate is regressed on the gyro, accelerations on the accelerometer; their gain for changes within some seconds,
    over that for all, is 1 for a solution of single epochs and falls when positions were filtered: a mean over 4 s
    halves it. Gains of all three are averaged with their weights.
    """
    gains = [g for k in range(3) if (g := quick_gain(means, motion, lag, k)) is not None]
    if not gains:
        return []
    weight = np.array([g[1] ** -2 for g in gains])
    value = float(weight @ [g[0] for g in gains] / weight.sum())
    sigma = float(weight.sum() ** -0.5)
    if value > _SMOOTH or value + 2.0 * sigma > 0.8:
        return []
    text = (
        f"quick turns and changes of speed come through the GNSS solution at {value:.2f} of the gain of slow ones "
        f"(1-sigma {sigma:.2f}): it was filtered or smoothed, its errors are correlated and its accuracies too good"
    )
    fix = "the receiver's unsmoothed solution; or larger sigma"
    evidence: dict[str, Any] = {"gain": value, "sigma": sigma}
    return [Finding("gnss_smoothed", "warning", text, 0.8, fix, evidence, "gnss")]


def quick_gain(means: WindowMeans, motion: Motion, lag: Lag, which: int = 0) -> tuple[float, float] | None:
    """Gain of changes within 3 s over that of all, and its 1-sigma.

    Parameters
    ----------
    means : WindowMeans
    motion : Motion
    lag : Lag
    which : {0, 1, 2}
        Turn rate, forward or right acceleration.

    Returns
    -------
    tuple of float, optional
        None if there is too little quick motion, or a body whose accelerations are not those of its path.
    """
    if which and lag.r2[which] < _PATH:
        return None
    at = motion.t - lag.offset
    w, inside = means.at(at, motion.half)
    inside = inside & means.whole(at, motion.half)
    use = motion.moving & inside
    if use.sum() < 60:
        return None
    w = w[:, 3:] if which == 0 else w[:, :3]
    x = (motion.turn, motion.forward, motion.right)[which]
    A = np.concatenate((w[use], np.ones((int(use.sum()), 1))), axis=1)
    c, *_ = np.linalg.lstsq(A, x[use], rcond=None)
    fit = w @ c[:3]
    step = float(np.median(np.diff(motion.t)))
    n = max(round(_QUICK_S / step), 1)
    quick_fit, quick_x, ok = _high(fit, n), _high(x, n), _eroded(use, n)
    # stops make a course of noise: keep well clear of them
    a, b = quick_fit[ok], quick_x[ok]
    if len(a) < 60 or np.sqrt(np.mean(a**2)) < _LEAST[which]:
        return None
    # noise of the IMU is in both sums of squares; at rest it stands alone
    still = _eroded(inside & (motion.speed < 0.1), n)
    own = float(np.mean(quick_fit[still] ** 2)) if still.sum() > 20 else 0.0
    power = float(a @ a) - own * len(a)
    if power < 0.3 * float(a @ a):
        return None
    centred, path = fit[use] - fit[use].mean(), x[use] - x[use].mean()
    slow = float(centred @ path / max(float(centred @ centred) - own * int(use.sum()), 1e-300))
    gain = float(a @ b / power) / max(slow, 1e-9)
    noise = np.sqrt(np.mean((b - gain * slow * a) ** 2) / power * 4.0 * motion.half / step)
    return gain, max(float(noise / max(slow, 1e-9)), 0.01)


def _high(x: FloatArray, n: int) -> FloatArray:
    kernel = np.ones(2 * n + 1) / (2 * n + 1)
    return np.asarray(x - np.convolve(x, kernel, mode="same"))


def _eroded(use: BoolArray, n: int) -> BoolArray:
    return np.asarray(np.convolve(use.astype(float), np.ones(2 * n + 1), mode="same") > 2 * n + 0.5)
