"""Static poses: what every method that needs a sensor at rest starts from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from schuler.arguments import explains_arguments
from schuler.arrays import ArrayLike, FloatArray, IntArray, as_floats
from schuler.calibration.magnetometer.calibrate import magnetic_means
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged
from schuler.recording.series import ImuSeries
from schuler.standstill.stationarity import StaticIntervals, static_intervals
from schuler.units import G0

_ARRAYS = ("f", "omega", "sigma_f", "sigma_omega", "start", "stop")


@dataclass(frozen=True, eq=False, repr=False)
class Poses(Abridged):
    """Means of a sensor over intervals at rest.

    Attributes
    ----------
    f : ndarray, shape (n, 3)
        Mean specific force as measured. [m/s^2]
    omega : ndarray, shape (n, 3)
        Mean angular rate as measured. [rad/s]
    sigma_f, sigma_omega : ndarray, shape (n, 3)
        1-sigma uncertainty of the means. [m/s^2], [rad/s]
    start, stop : ndarray, shape (n,)
        Times of each interval. [s]
    temperature : ndarray, shape (n,), or None
        [degC]
    index : ndarray of int, shape (n, 2), or None
        First sample and the one after the last in the log.
    magnetometer : (ndarray, ndarray), shapes (n, 3), (n,), or None
        Mean readings of a magnetometer and their 1 sigma. [T]
    parts : (Poses, Poses) or None
        Means over the first and the second half of each interval, to hold claims against.
    """

    f: FloatArray
    omega: FloatArray
    sigma_f: FloatArray
    sigma_omega: FloatArray
    start: FloatArray
    stop: FloatArray
    temperature: FloatArray | None = None
    index: IntArray | None = field(default=None)
    parts: tuple[Poses, Poses] | None = field(default=None)
    magnetometer: tuple[FloatArray, FloatArray] | None = field(default=None)

    def __post_init__(self) -> None:
        n = len(as_floats(self.f, "f", (None, 3)))
        for name in ("f", "omega", "sigma_f", "sigma_omega"):
            object.__setattr__(self, name, as_floats(getattr(self, name), name, (n, 3)))
        for name in ("start", "stop"):
            object.__setattr__(self, name, as_floats(getattr(self, name), name, (n,)))
        if (self.sigma_f <= 0.0).any() or (self.sigma_omega <= 0.0).any():
            raise InputError("sigma_f, sigma_omega: expected positive numbers; a pose without any noise is stuck")

    def __len__(self) -> int:
        return len(self.f)

    @property
    def duration(self) -> FloatArray:
        """Length of each interval. [s]"""
        return np.asarray(self.stop - self.start)

    @property
    def up(self) -> FloatArray:
        """Measured direction of the specific force, up, as unit vectors in sensor axes. Shape (n, 3)."""
        return np.asarray(self.f / np.linalg.norm(self.f, axis=1, keepdims=True))

    def of(self, which: ArrayLike) -> Poses:
        """Some of the poses, by index or mask."""
        k = np.asarray(which)
        return Poses(
            self.f[k], self.omega[k], self.sigma_f[k], self.sigma_omega[k], self.start[k], self.stop[k],
            None if self.temperature is None else self.temperature[k], None if self.index is None else self.index[k],
            None if self.parts is None else (self.parts[0].of(k), self.parts[1].of(k)),
            None if self.magnetometer is None else (self.magnetometer[0][k], self.magnetometer[1][k]),
        )  # fmt: skip


def joined(several: Sequence[Poses]) -> Poses:
    """Poses of several logs as one, in that order; ``index`` is dropped, temperature if one of them has none.

    Raises
    ------
    InputError
        If there are none.
    """
    if not several:
        raise InputError("several: expected poses of one log or more, got none")
    if len(several) == 1:
        return several[0]
    warm = [p.temperature for p in several]
    temperature = None if any(T is None for T in warm) else np.concatenate([T for T in warm if T is not None])
    f, omega, sigma_f, sigma_omega, start, stop = (np.concatenate([getattr(p, n) for p in several]) for n in _ARRAYS)
    halves = [p.parts for p in several if p.parts is not None]
    parts = (joined([h[0] for h in halves]), joined([h[1] for h in halves])) if len(halves) == len(several) else None
    magnetic = [p.magnetometer for p in several if p.magnetometer is not None]
    m = None
    if len(magnetic) == len(several):
        m = (np.concatenate([x for x, _ in magnetic]), np.concatenate([s for _, s in magnetic]))
    return Poses(f, omega, sigma_f, sigma_omega, start, stop, temperature, parts=parts, magnetometer=m)


@explains_arguments
def poses_of(
    imu: ImuSeries,
    intervals: StaticIntervals | Sequence[tuple[float, float]] | None = None,
    *,
    min_s: float = 1.0,
    trim_s: float = 0.0,
    noise: tuple[ArrayLike, ArrayLike] | None = None,
    gravity: float = G0,
) -> Poses:
    """Means over the intervals at rest of a log.

    Parameters
    ----------
    imu : ImuSeries
    intervals : StaticIntervals, sequence of (start, stop) [s], optional
        None: found by :func:`schuler.standstill.stationarity.static_intervals`.
    min_s : float
        Shorter intervals are not looked for. [s]
    trim_s : float
        Left out at both ends of each interval, for settling. [s]
    noise : (array_like, array_like), optional
        N of gyroscopes [rad/s/sqrt(Hz)] and accelerometers [m/s^2/sqrt(Hz)], shape () or (3,), for the uncertainty of
        means; None: from the scatter of means over tenths of each interval.
    gravity : float
        Local gravity, for the detector. [m/s^2]

    Returns
    -------
    Poses

    Raises
    ------
    InputError
        If no interval is left, or one holds fewer than 20 samples.
    """
    rates = imu.rates()
    if intervals is None:
        intervals = static_intervals(rates, min_s=min_s, gravity=gravity)
    if isinstance(intervals, StaticIntervals):
        spans = [(float(a), float(b)) for a, b in zip(intervals.start, intervals.stop, strict=True)]
    else:
        spans = [(float(a), float(b)) for a, b in intervals]
    index: list[tuple[int, int]] = []
    for start, stop in spans:
        a = int(np.searchsorted(rates.t, start + trim_s - 1e-9))
        b = int(np.searchsorted(rates.t, stop - trim_s + 1e-9, side="right"))
        if b - a < 20:
            raise InputError(
                f"intervals: expected 20 samples or more in {start:.2f}..{stop:.2f} s"
                f"{f' less {trim_s:g} s at both ends' if trim_s else ''}, got {max(b - a, 0)}; stay longer in each pose"
            )
        index.append((a, b))
    if not index:
        raise InputError(
            "imu: no interval at rest was found; put the unit down for some seconds in each pose, or give intervals"
        )
    complete = _means(rates, index, noise)
    if min(b - a for a, b in index) < 40:
        return complete
    middle = [(a + b) // 2 for a, b in index]
    first = _means(rates, [(a, m) for (a, _), m in zip(index, middle, strict=True)], noise)
    second = _means(rates, [(m, b) for (_, b), m in zip(index, middle, strict=True)], noise)
    return replace(complete, parts=(first, second))


def _means(rates: ImuSeries, index: list[tuple[int, int]], noise: tuple[ArrayLike, ArrayLike] | None) -> Poses:
    """Means over spans of samples."""
    f: list[FloatArray] = []
    omega: list[FloatArray] = []
    sigma_f: list[FloatArray] = []
    sigma_omega: list[FloatArray] = []
    T: list[float] = []
    for a, b in index:
        duration = (b - a) / rates.rate_hz
        for x, mean, sigma, k in ((rates.accel, f, sigma_f, 1), (rates.gyro, omega, sigma_omega, 0)):
            part = x[a:b]
            mean.append(part.mean(axis=0))
            if noise is not None:
                sigma.append(np.broadcast_to(np.asarray(noise[k], dtype=np.float64), (3,)) / np.sqrt(duration))
            else:
                sigma.append(sample_mean_sigma(part))
        if rates.temperature is not None:
            T.append(float(rates.temperature[a:b].mean()))
    spans_used = np.array([(rates.t[a], rates.t[b - 1]) for a, b in index])
    return Poses(
        np.array(f), np.array(omega), np.array(sigma_f), np.array(sigma_omega), spans_used[:, 0], spans_used[:, 1],
        np.array(T) if T else None, np.array(index), magnetometer=magnetic_means(rates, index),
    )  # fmt: skip


def sample_mean_sigma(x: FloatArray) -> FloatArray:
    """Uncertainty of the mean of a piece of a log, from ten part means or from samples, whichever is larger."""
    m = len(x) // 10
    parts = x[: 10 * m].reshape(10, m, 3).mean(axis=1)
    coloured = parts.std(axis=0, ddof=1) / np.sqrt(10.0)
    white = x.std(axis=0, ddof=1) / np.sqrt(len(x))
    return np.asarray(np.maximum(np.maximum(coloured, white), 1e-300))
