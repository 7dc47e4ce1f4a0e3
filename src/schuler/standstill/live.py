"""Rests of a log that is still growing; each part of it is searched a few times only."""

from __future__ import annotations

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, IntArray, as_floats
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries, Kind
from schuler.standstill import detectors
from schuler.standstill.rests import field_rests
from schuler.standstill.stationarity import StaticIntervals, interval_mask

_WINDOW_S = 0.5  # windows that tell resting from turning at once
_FIRST_S = 6.0  # shortest log that the noise at rest is estimated from
_LEARN_S = 30.0  # latest part of the log that is searched for the first rest
_LOUD = 0.5  # noise of a rest below this share of the first one's: the first was no rest


class LiveRests:
    """A growing log and its rests.

    Windows of half a second tell at once whether the sensor rests. The rests themselves are those of
    :func:`schuler.standstill.rests.field_rests`, run over what came after the last rest that is over. Noise at
    rest and gyro bias are taken from the first rest.

    Parameters
    ----------
    kind : {"rate", "increment"}
        Of the samples.
    """

    def __init__(self, kind: Kind = "rate") -> None:
        self._kind: Kind = kind
        self._t, self._x, self._n = np.empty(4096), np.empty((4096, 6)), 0
        self._noise: tuple[FloatArray, FloatArray] | None = None
        self._bias = np.zeros(3)
        self._index: list[tuple[int, int]] = []  # rests that are over
        self._open: tuple[int, int] | None = None  # the last one, which may go on
        self._tested = 0  # samples whose windows were tested
        self._rest_start: int | None = None
        self._limit = 0.0

    def __len__(self) -> int:
        return self._n

    def add(self, t: ArrayLike, gyro: ArrayLike, accel: ArrayLike) -> None:
        """Append one sample or a block of them, in the form of :class:`schuler.recording.series.ImuSeries`.

        Raises
        ------
        InputError
            If shapes disagree, a value is not finite, or time does not increase.
        """
        t = np.atleast_1d(as_floats(t, "t"))
        m = len(t)
        x = np.empty((m, 6))
        for k, (value, name) in enumerate(((gyro, "gyro"), (accel, "accel"))):
            x[:, 3 * k : 3 * k + 3] = as_floats(np.atleast_2d(np.asarray(value, dtype=np.float64)), name, (m, 3))
        if not m:
            return
        last = self._t[self._n - 1] if self._n else -np.inf
        if not (t[0] > last and np.all(np.diff(t) > 0.0)):
            raise InputError(f"t: expected times that increase, got {t[0]:.6f} s after {last:.6f} s or steps back")
        if self._n + m > len(self._t):
            size = 2 * (self._n + m)
            self._t, self._x = np.resize(self._t, size), np.resize(self._x, (size, 6))
        self._t[self._n : self._n + m], self._x[self._n : self._n + m] = t, x
        self._n += m

    @property
    def time(self) -> float:
        """Time of the last sample. [s]"""
        return float(self._t[self._n - 1]) if self._n else 0.0

    @property
    def begin(self) -> float:
        """Time of the first sample. [s]"""
        return float(self._t[0]) if self._n else 0.0

    def series(self, first: int = 0) -> ImuSeries:
        """The log so far, from a sample on."""
        return ImuSeries(
            self._t[first : self._n].copy(), self._x[first : self._n, :3].copy(), self._x[first : self._n, 3:].copy(),
            self._kind,
        )  # fmt: skip

    def still_s(self) -> float:
        """Time for which the sensor has been resting; 0 while it turns, or before the first rest. [s]"""
        if self._noise is None:
            return 0.0
        h = self._interval()
        W = max(2, round(_WINDOW_S / h))
        while self._tested + W <= self._n:
            part = slice(self._tested, self._tested + W)
            x = self._x[part] if self._kind == "rate" else self._x[part] / h
            sigma = np.concatenate((self._noise[1], self._noise[0]))
            quiet = np.all(x.var(axis=0) < self._limit * sigma**2)
            slow = np.linalg.norm(x[:, :3].mean(axis=0) - self._bias) < detectors.MAX_RATE
            if not (quiet and slow):
                self._rest_start = None
            elif self._rest_start is None:
                self._rest_start = self._tested
            self._tested += W
        return 0.0 if self._rest_start is None else self.time - float(self._t[self._rest_start])

    def first_rest(self) -> bool:
        """Whether there was a rest to estimate noise and bias from; call again while there was none."""
        if self._noise is None and self._n > 1 and self.time - self.begin >= _FIRST_S:
            rests = field_rests(self.series(int(np.searchsorted(self._t[: self._n], self.time - _LEARN_S))))
            if len(rests):
                self._noise, self._bias = (rests.sigma_f, rests.sigma_w), rests.gyro_bias
                self._limit = rests.threshold
        return self._noise is not None

    def rests(self) -> StaticIntervals:
        """Rests of the log so far, the one that goes on included."""
        first = self._index[-1][1] if self._index else 0
        part = self.series(first)
        if self._noise is None or part.t[-1] - part.t[0] < 1.0:
            return self._intervals()
        # the mean rate of the first rest contains G f of its pose: it is given beside that rest only if they disagree
        rests = field_rests(part, noise=self._noise, gyro_bias=self._bias if first else None)
        if not (first or len(rests)):
            rests = field_rests(part, noise=self._noise, gyro_bias=self._bias)
        if self._relearn_noise(rests):
            # the first rest was none: search the complete log with the noise of this one
            self._index, first = [], 0
            rests = field_rests(self.series(), noise=self._noise)
        elif not (len(rests) or self._index):
            self._noise, self._open, self._rest_start, self._tested = None, None, None, self._n
            return self._intervals()
        if not first and len(rests):
            self._bias = rests.gyro_bias
        spans = [(first + int(a), first + int(b)) for a, b in rests.index]
        # a rest is over when another follows; the last one is searched again with later samples
        self._index += spans[:-1]
        self._open = spans[-1] if spans else None
        return self._intervals()

    def _relearn_noise(self, rests: StaticIntervals) -> bool:
        """Take noise and bias from the longest rest if it is so much quieter that the first was none."""
        if not len(rests) or self._noise is None:
            return False
        a, b = rests.index[int(np.argmax(rests.duration))]
        part = self.series(self._n - len(rests.mask)).rates()
        noise = part.accel[a:b].std(axis=0), part.gyro[a:b].std(axis=0)
        if not all(
            np.all(new < _LOUD * old) and np.all(new > 0.0) for new, old in zip(noise, self._noise, strict=True)
        ):
            return False
        self._noise, self._bias = noise, part.gyro[a:b].mean(axis=0)
        self._rest_start, self._tested = None, 0
        return True

    def _intervals(self) -> StaticIntervals:
        spans = self._index + ([self._open] if self._open else [])
        index: IntArray = np.array(spans, dtype=np.int64).reshape(-1, 2)
        f, omega = (np.full(3, np.nan), np.full(3, np.nan)) if self._noise is None else self._noise
        return StaticIntervals(
            self._t[index[:, 0]], self._t[index[:, 1] - 1], index, interval_mask(index, self._n), np.zeros(self._n),
            1.0, "field, live", _WINDOW_S, f, omega, self._bias,
        )  # fmt: skip

    def _interval(self) -> float:
        m = min(self._n, 200)
        return float(np.median(np.diff(self._t[:m])))
