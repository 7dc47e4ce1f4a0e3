"""Turn-on to turn-on bias: how much the mean of a sensor differs from one switch-on to the next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.characterisation.trends import mean_with_sigma
from schuler.exceptions import InputError
from schuler.plotting.notebook import Displayed
from schuler.recording.series import ImuSeries


@dataclass(frozen=True, repr=False)
class TurnOn(Displayed):
    """Distribution of the bias over switch-ons, per axis.

    Attributes
    ----------
    mean : ndarray, shape (k,)
        Mean over the records: what a calibration can remove. [x]
    mean_sigma : ndarray, shape (k,)
        1-sigma uncertainty of it. [x]
    mean_low, mean_high : ndarray, shape (k,)
        95 % interval of ``mean``, by Student's distribution with ``records - 1`` degrees of freedom. [x]
    sigma : ndarray, shape (k,)
        Standard deviation from one switch-on to the next, without the uncertainty of the single means: the budget's
        turn-on bias. Zero where the means scatter less than their own uncertainty. [x]
    low, high : ndarray, shape (k,)
        95 % interval of ``sigma``; ``low`` is zero where no spread is shown at all. [x]
    records : int
    within : ndarray, shape (k,)
        Root mean square of the uncertainties of the single means. [x]
    """

    mean: FloatArray
    mean_sigma: FloatArray
    mean_low: FloatArray
    mean_high: FloatArray
    sigma: FloatArray
    low: FloatArray
    high: FloatArray
    records: int
    within: FloatArray

    def summary(self) -> str:
        """One line for each axis."""
        rows = [f"turn-on bias over {self.records} records: mean, spread and its 95 % interval"]
        rows += [
            f"  {k}: {mean:.4g} +- {mean_sigma:.2g}, spread {sigma:.3g} ({low:.3g} to {high:.3g})"
            for k, (mean, mean_sigma, sigma, low, high) in enumerate(
                zip(self.mean, self.mean_sigma, self.sigma, self.low, self.high, strict=True)
            )
        ]
        return "\n".join(rows)


def turn_on_bias(means: ArrayLike, sigmas: ArrayLike = 0.0, confidence: float = 0.95) -> TurnOn:
    """Spread of the means of several records beyond their own uncertainty.

    Parameters
    ----------
    means : array_like, shape (r,) or (r, k)
        Mean of each record, between which the sensor was switched off (and cooled); k axes. [x]
    sigmas : array_like, broadcast to the shape of ``means``
        1-sigma uncertainty of each mean, with the drift within a record; see :func:`record_means`. [x]
    confidence : float
        Probability of the interval.

    Returns
    -------
    TurnOn

    Raises
    ------
    InputError
        If there are fewer than 3 records, or a sigma is negative.

    Notes
    -----
    Random effects: mean i is normal about the common mean with variance ``sigma^2 + s_i^2``. At the true sigma
    ``Q = sum w_i (m_i - m)^2``, ``w_i = 1 / (sigma^2 + s_i^2)``, ``m`` the weighted mean, is chi-square distributed
    with r - 1 degrees of freedom. Q falls with sigma; sigma is where it equals r - 1, the bounds are where it equals
    the quantiles. With equal s_i that is the sample variance less s^2, and its usual chi-square interval.

    References
    ----------
    Paule and Mandel (1982) for the estimate, Viechtbauer (2007) for the interval ("Q profile"); Hartung and Knapp
    (2001) for the interval of the mean.
    """
    from scipy.stats import chi2
    from scipy.stats import t as student

    m = as_floats(means, "means")
    if m.ndim not in (1, 2) or len(m) < 3:
        raise InputError(f"means: expected at least 3 records, shape (r,) or (r, axes), got {m.shape}")
    if not 0.0 < confidence < 1.0:
        raise InputError(f"confidence: expected a number between 0 and 1, got {confidence}")
    m = m.reshape(len(m), -1)
    s = as_floats(sigmas, "sigmas")
    try:
        s = np.broadcast_to(s[:, None] if s.ndim == 1 and len(s) == len(m) else s, m.shape)
    except ValueError as error:
        raise InputError(f"sigmas: expected one for each of the means, shape {m.shape}, got {s.shape}") from error
    if np.any(s < 0.0):
        raise InputError(f"sigmas: expected none below zero, got {s.min()}")
    r, tail = len(m), 0.5 * (1.0 - confidence)
    rows = []
    for x, sigmas_ in zip(m.T, s.T, strict=True):
        spread = _solve(x, sigmas_, r - 1.0)
        low = _solve(x, sigmas_, float(chi2.isf(tail, r - 1)))
        high = _solve(x, sigmas_, float(chi2.ppf(tail, r - 1)))
        w = _weights(spread, x, sigmas_)
        rows.append((float(w @ x / w.sum()), 1.0 / sqrt(w.sum()), spread, low, high))
    mean, mean_sigma, spread_, low_, high_ = np.array(rows).T
    half = float(student.isf(tail, r - 1)) * mean_sigma
    return TurnOn(
        mean, mean_sigma, mean - half, mean + half, spread_, low_, high_, r, np.sqrt(np.mean(s**2, axis=0))
    )  # fmt: skip


def record_means(recordings: Sequence[ImuSeries]) -> tuple[FloatArray, FloatArray]:
    """Means of gyroscopes and accelerometers of each record and their uncertainties, for :func:`turn_on_bias`.

    Parameters
    ----------
    recordings : sequence of ImuSeries
        All at rest in the same pose: gravity and Earth rate must be the same in every mean.

    Returns
    -------
    means, sigmas : ndarray, shape (r, 6)
        Gyroscope x, y, z [rad/s], accelerometer x, y, z [m/s^2]. The uncertainty is that of the mean over the record
        under the noise found in it (white, flicker, random walk), not the deviation over the square root of n.

    Raises
    ------
    InputError
        If a record has fewer than 200 samples or an axis that never changes.
    """
    rows = []
    for imu in recordings:
        rates = imu.rates()
        rows.append([mean_with_sigma(x, imu.rate_hz) for x in (*rates.gyro.T, *rates.accel.T)])
    values = np.array(rows).reshape(-1, 6, 2)
    return values[:, :, 0], values[:, :, 1]


def _weights(spread: float, x: FloatArray, sigmas_: FloatArray) -> FloatArray:
    """One over the variance of each mean; equal ones where there is neither spread nor uncertainty."""
    nothing = max(1e-9 * float(np.ptp(x)), 1e-150)
    return np.asarray(1.0 / np.maximum(spread**2 + sigmas_**2, nothing**2))


def _q(spread: float, x: FloatArray, sigmas_: FloatArray) -> float:
    w = _weights(spread, x, sigmas_)
    return float(np.sum(w * (x - w @ x / w.sum()) ** 2))


def _solve(x: FloatArray, sigmas_: FloatArray, target: float) -> float:
    """Spread at which Q is ``target``; zero if it is below that already without any."""
    from scipy.optimize import brentq

    scatter = float(np.ptp(x))
    if scatter == 0.0 or _q(0.0, x, sigmas_) <= target:
        return 0.0
    # Q is at most r ptp^2 / spread^2: above this spread it is certainly below the target
    top = 1.01 * scatter * sqrt(len(x) / target)
    return float(brentq(lambda u: _q(u, x, sigmas_) - target, 0.0, top, xtol=1e-14 * top, rtol=1e-12))
