"""Rests of a log that is still being made: found while it grows, each stretch looked at a few times only."""

from __future__ import annotations

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, IntArray, as_floats
from schuler.calibration.field.rests import field_rests
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries, Kind
from schuler.standstill import detectors
from schuler.standstill.stationarity import StaticIntervals

_TICK_S = 0.5  # length of the windows that tell resting from turning at once
_FIRST_S = 6.0  # log needed before the noise at rest can be told from it
_LEARN_S = 30.0  # and the part of it, the latest, that it is looked for in
_LOUD = 0.5  # noise at a rest below this share of what was taken for noise: that was no rest


class LiveRests:
    """A growing log and its rests.

    Windows of half a second tell at once whether the sensor rests. The rests themselves are those of
    :func:`schuler.calibration.field.rests.field_rests`, run over what came after the last rest that is over. Noise at
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
        self._open: tuple[int, int] | None = None  # and the one that may go on
        self._seen = 0  # samples whose windows were looked at
        self._still_from: int | None = None
        self._limit = 0.0

    def __len__(self) -> int:
        return self._n

    def add(self, t: ArrayLike, gyro: ArrayLike, accel: ArrayLike) -> None:
        """Append one sample or a block of them, as of :class:`schuler.recording.series.ImuSeries`.

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
        """Of the last sample. [s]"""
        return float(self._t[self._n - 1]) if self._n else 0.0

    @property
    def begin(self) -> float:
        """Of the first sample. [s]"""
        return float(self._t[0]) if self._n else 0.0

    def series(self, first: int = 0) -> ImuSeries:
        """The log so far, from a sample on."""
        return ImuSeries(
            self._t[first : self._n].copy(), self._x[first : self._n, :3].copy(), self._x[first : self._n, 3:].copy(),
            self._kind,
        )  # fmt: skip

    def still_s(self) -> float:
        """How long the sensor has been resting; 0 while it turns, or until the first rest is known. [s]"""
        if self._noise is None:
            return 0.0
        h = self._interval()
        W = max(2, round(_TICK_S / h))
        while self._seen + W <= self._n:
            part = slice(self._seen, self._seen + W)
            x = self._x[part] if self._kind == "rate" else self._x[part] / h
            sigma = np.concatenate((self._noise[1], self._noise[0]))
            quiet = np.all(x.var(axis=0) < self._limit * sigma**2)
            slow = np.linalg.norm(x[:, :3].mean(axis=0) - self._bias) < detectors.MAX_RATE
            if not (quiet and slow):
                self._still_from = None
            elif self._still_from is None:
                self._still_from = self._seen
            self._seen += W
        return 0.0 if self._still_from is None else self.time - float(self._t[self._still_from])

    def first_rest(self) -> bool:
        """Whether there was a rest to learn noise and bias from; to be asked again while there was none."""
        if self._noise is None and self._n > 1 and self.time - self.begin >= _FIRST_S:
            found = field_rests(self.series(int(np.searchsorted(self._t[: self._n], self.time - _LEARN_S))))
            if len(found):
                self._noise, self._bias = (found.sigma_f, found.sigma_w), found.gyro_bias
                self._limit = found.threshold
        return self._noise is not None

    def rests(self) -> StaticIntervals:
        """Rests of the log so far, the one that goes on included."""
        first = self._index[-1][1] if self._index else 0
        part = self.series(first)
        if self._noise is None or part.t[-1] - part.t[0] < 1.0:
            return self._intervals()
        # the mean rate of the first rest has G f of its pose in it: beside that rest it is given only if they disagree
        found = field_rests(part, noise=self._noise, gyro_bias=self._bias if first else None)
        if not (first or len(found)):
            found = field_rests(part, noise=self._noise, gyro_bias=self._bias)
        if self._learnt_from(found):
            # what was taken for the first rest was none: everything anew, with the noise of this one
            self._index, first = [], 0
            found = field_rests(self.series(), noise=self._noise)
        elif not (len(found) or self._index):
            self._noise, self._open, self._still_from, self._seen = None, None, None, self._n
            return self._intervals()
        if not first and len(found):
            self._bias = found.gyro_bias
        spans = [(first + int(a), first + int(b)) for a, b in found.index]
        # over is what another rest follows; the last one is looked at again with what comes
        self._index += spans[:-1]
        self._open = spans[-1] if spans else None
        return self._intervals()

    def _learnt_from(self, found: StaticIntervals) -> bool:
        """Noise and bias from the longest rest, if it is so much quieter than the noise known that this is none."""
        if not len(found) or self._noise is None:
            return False
        a, b = found.index[int(np.argmax(found.duration))]
        part = self.series(self._n - len(found.mask)).rates()
        noise = part.accel[a:b].std(axis=0), part.gyro[a:b].std(axis=0)
        if not all(
            np.all(new < _LOUD * old) and np.all(new > 0.0) for new, old in zip(noise, self._noise, strict=True)
        ):
            return False
        self._noise, self._bias = noise, part.gyro[a:b].mean(axis=0)
        self._still_from, self._seen = None, 0
        return True

    def _intervals(self) -> StaticIntervals:
        spans = self._index + ([self._open] if self._open else [])
        index: IntArray = np.array(spans, dtype=np.int64).reshape(-1, 2)
        mask = np.zeros(self._n, dtype=bool)
        for a, b in spans:
            mask[a:b] = True
        f, omega = (np.full(3, np.nan), np.full(3, np.nan)) if self._noise is None else self._noise
        return StaticIntervals(
            self._t[index[:, 0]], self._t[index[:, 1] - 1], index, mask, np.zeros(self._n), 1.0, "field, live", _TICK_S,
            f, omega, self._bias,
        )  # fmt: skip

    def _interval(self) -> float:
        m = min(self._n, 200)
        return float(np.median(np.diff(self._t[:m])))
