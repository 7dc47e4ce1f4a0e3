"""Wavelet de-noising of static data, and what it does and does not do for a bias estimate.

An orthogonal wavelet transform splits a signal into details, one band an octave, and a slow rest. De-noising shrinks
the details by a threshold that white noise hardly exceeds and puts the signal together again.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import log, sqrt
from typing import Literal, TypeAlias

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError
from schuler.plotting.notebook import Displayed

Wavelet: TypeAlias = Literal["haar", "db2"]

_ROOT3 = sqrt(3.0)
#: Low-pass filters of unit length. Daubechies' wavelet of four taps has two vanishing moments ("db2" elsewhere).
_FILTERS: dict[str, FloatArray] = {
    "haar": np.array([1.0, 1.0]) / sqrt(2.0),
    "db2": np.array([1.0 + _ROOT3, 3.0 + _ROOT3, 3.0 - _ROOT3, 1.0 - _ROOT3]) / (4.0 * sqrt(2.0)),
}


@dataclass(frozen=True, repr=False)
class Denoised(Displayed):
    """A de-noised signal.

    Attributes
    ----------
    x : ndarray, shape (n,)
        [x]
    level : int
        Levels of decomposition.
    cutoff_hz : float
        Upper end of the slow rest, ``rate / 2**(level + 1)``: what the threshold never touches. [Hz]
    sigma : float
        White-noise standard deviation of a sample, from the finest details. [x]
    std : (float, float)
        Standard deviation before and after. [x]
    mean : (float, float)
        Mean before and after: the bias estimate of the whole record. [x]
    wander : (float, float)
        Standard deviation of means over ``average_s`` before and after: what a bias estimate from so long an average
        scatters. [x]
    average_s : float
    """

    x: FloatArray
    level: int
    cutoff_hz: float
    sigma: float
    std: tuple[float, float]
    mean: tuple[float, float]
    wander: tuple[float, float]
    average_s: float

    def summary(self) -> str:
        """Effect on the samples and on the bias estimate."""
        return (
            f"level {self.level} (leaves {self.cutoff_hz:.3g} Hz): standard deviation of a sample "
            f"{100.0 * (1.0 - self.std[1] / self.std[0]):.1f} % smaller; of means over {self.average_s:.3g} s "
            f"{100.0 * (1.0 - self.wander[1] / self.wander[0]):.1f} % smaller; mean moved by "
            f"{abs(self.mean[1] - self.mean[0]):.1e}"
        )


def decompose(x: ArrayLike, level: int, wavelet: Wavelet = "db2") -> list[FloatArray]:
    """Orthogonal wavelet transform of a periodic signal.

    Parameters
    ----------
    x : array_like, shape (n,)
        n a multiple of ``2**level``.
    level : int
    wavelet : {"haar", "db2"}

    Returns
    -------
    list of ndarray
        Slow rest (n / 2**level values), then details from the slowest to the fastest (n / 2 values).

    Raises
    ------
    InputError
        If the length is no such multiple, or level or wavelet are unknown.

    References
    ----------
    Daubechies, Ten Lectures on Wavelets (1992), chapter 6; Mallat's pyramid algorithm.
    """
    x = as_floats(x, "x", (None,))
    h = _filter(wavelet)
    if not (isinstance(level, int) and level >= 0 and len(x) >= 2**level and len(x) % 2**level == 0):
        raise InputError(f"x: expected a multiple of 2**level samples, got {len(x)} samples and level {level!r}")
    details: list[FloatArray] = []
    for _ in range(level):
        x, detail = _split(x, h)
        details.append(detail)
    return [x, *details[::-1]]


def recompose(parts: list[FloatArray], wavelet: Wavelet = "db2") -> FloatArray:
    """Inverse of :func:`decompose`.

    Parameters
    ----------
    parts : list of ndarray
    wavelet : {"haar", "db2"}

    Returns
    -------
    ndarray, shape (n,)
    """
    h = _filter(wavelet)
    x = parts[0]
    for detail in parts[1:]:
        x = _join(x, detail, h)
    return x


def denoise(
    x: ArrayLike,
    rate_hz: float,
    level: int | None = None,
    *,
    wavelet: Wavelet = "db2",
    average_s: float | None = None,
) -> Denoised:
    """De-noise a log at rest by soft thresholds on its wavelet details.

    Parameters
    ----------
    x : array_like, shape (n,)
        [x]
    rate_hz : float
        [Hz]
    level : int, optional
        Levels of decomposition; default :func:`choose_level`.
    wavelet : {"haar", "db2"}
    average_s : float, optional
        Averaging time of the bias estimates that are compared; default a twentieth of the log. [s]

    Returns
    -------
    Denoised

    Raises
    ------
    InputError
        If there are fewer than 64 samples or gaps, or a number is impossible.

    Notes
    -----
    Threshold ``sigma sqrt(2 ln n)`` for all details, sigma from the median magnitude of the finest ones, that is
    median / 0.6745 (Donoho and Johnstone). The signal is continued by its mirror image so that its ends need not meet.

    The mean over a long time is a low-frequency quantity that lies in the slow rest; thresholds never touch it.
    De-noising makes samples prettier, by tens of percent and more, and a bias estimate from an average no better. What
    it removes the average would have removed anyway.

    References
    ----------
    Hayal, Static calibration of tactical grade inertial measurement units (2010), section 2.4.3, which reports 34 to
    63 % from the literature; Donoho and Johnstone (1994).
    """
    x = as_floats(x, "x", (None,))
    if len(x) < 64:
        raise InputError(f"x: expected 64 samples or more, got {len(x)}")
    if not (np.isfinite(rate_hz) and rate_hz > 0.0):
        raise InputError(f"rate_hz: expected a positive number, got {rate_hz!r}")
    most = int(np.log2(len(x))) - 3
    level = choose_level(x, wavelet=wavelet) if level is None else level
    if not (isinstance(level, int) and 1 <= level <= most):
        raise InputError(f"level: expected 1 to {most} for {len(x)} samples, got {level!r}")
    average_s = len(x) / rate_hz / 20.0 if average_s is None else average_s
    block = round(average_s * rate_hz)
    if not 1 <= block <= len(x) // 2:
        raise InputError(f"average_s: expected between one sample and half the log, got {average_s!r} s")
    parts = decompose(_mirrored(x, level), level, wavelet)
    sigma = float(np.median(np.abs(parts[-1]))) / 0.6745
    threshold = sigma * sqrt(2.0 * log(len(x)))
    shrunk = [parts[0], *(np.sign(d) * np.maximum(np.abs(d) - threshold, 0.0) for d in parts[1:])]
    y = recompose(shrunk, wavelet)[: len(x)]
    return Denoised(
        y, level, rate_hz / 2.0 ** (level + 1), sigma, (float(x.std()), float(y.std())),
        (float(x.mean()), float(y.mean())), (_block_std(x, block), _block_std(y, block)), block / rate_hz,
    )  # fmt: skip


def choose_level(x: ArrayLike, *, wavelet: Wavelet = "db2", gain: float = 0.05) -> int:
    """Level of decomposition beyond which a further octave removes hardly any noise from static data.

    Parameters
    ----------
    x : array_like, shape (n,)
        A log at rest. [x]
    wavelet : {"haar", "db2"}
    gain : float
        Least share of the standard deviation by which the slow rest of the next level must be smaller.

    Returns
    -------
    int
        1 or more. For data in motion it is bounded besides by the motion's bandwidth: ``rate / 2**(level + 1)`` must
        stay above it.

    Notes
    -----
    White noise falls by 29 % each level; where the bias or its wander is left the curve is flat.
    """
    x = as_floats(x, "x", (None,))
    h = _filter(wavelet)
    most = int(np.log2(max(len(x), 1))) - 3
    if most < 1:
        raise InputError(f"x: expected 16 samples or more, got {len(x)}")
    approximation = _mirrored(x - x.mean(), most)
    before, level = float(approximation.std()), 0
    while level < most:
        approximation = _split(approximation, h)[0]
        after = float(approximation.std()) / sqrt(2.0) ** (
            level + 1
        )  # the transform keeps energy, half the samples hold it
        if after > (1.0 - gain) * before:
            break
        before, level = after, level + 1
    return max(level, 1)


def _filter(wavelet: str) -> FloatArray:
    if wavelet not in _FILTERS:
        raise InputError(f"wavelet: expected one of {', '.join(_FILTERS)}, got {wavelet!r}")
    return _FILTERS[wavelet]


def _split(x: FloatArray, h: FloatArray) -> tuple[FloatArray, FloatArray]:
    g = h[::-1] * (-1.0) ** np.arange(len(h))  # the high-pass filter that is orthogonal to h
    shifted = [np.roll(x, -k)[::2] for k in range(len(h))]
    approximation = sum((a * s for a, s in zip(h, shifted, strict=True)), np.zeros(len(x) // 2))
    detail = sum((a * s for a, s in zip(g, shifted, strict=True)), np.zeros(len(x) // 2))
    return approximation, detail


def _join(approximation: FloatArray, detail: FloatArray, h: FloatArray) -> FloatArray:
    g = h[::-1] * (-1.0) ** np.arange(len(h))
    x = np.zeros(2 * len(approximation))
    for k in range(len(h)):  # the transpose of the orthogonal map above
        spread = np.zeros_like(x)
        spread[::2] = h[k] * approximation + g[k] * detail
        x += np.roll(spread, k)
    return x


def _mirrored(x: FloatArray, level: int) -> FloatArray:
    """The signal and its mirror image, as a period of a length the transform takes."""
    missing = -len(x) % 2**level  # at most half the log, as 2**level is an eighth of it or less
    half = np.concatenate((x, x[::-1][:missing]))
    return np.concatenate((half, half[::-1]))


def _block_std(x: FloatArray, block: int) -> float:
    return float(x[: len(x) // block * block].reshape(-1, block).mean(axis=1).std())
