"""Recent IMU samples of a live run, and what they say of the next: lost ones before it, or a reading that is none."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.navigation.inputs.preparation import MISSING, PAUSE, bridging_noise
from schuler.navigation.inputs.spikes import IN_A_ROW, SPIKE
from schuler.recording.io.checks import MAX_FORCE, MAX_RATE
from schuler.recording.series import ImuSeries

SPAN_S = 60.0  # of the samples that tell how far a bridge may be off [s]
_MOST = 20_000  # samples
_FOR_INTERVAL = 100  # samples whose median spacing is the sample interval
_FEWEST = 10  # samples from which their own motion says how bad a bridge is
_UNKNOWN = (0.3, 3.0)  # 1-sigma of a bridge before that: what vehicles do [rad/s], [m/s^2]
_TIMES = 4.0  # the largest so far, that a spike is beyond at least; forgotten over ...
_FORGOTTEN_S = 10.0  # ... [s]


class Sample(NamedTuple):
    """One interval as the filter takes it; its rates are unknown by ``gyro`` and ``accel``, constant over it."""

    t: float
    dt: float
    dtheta: FloatArray
    dv: FloatArray
    gyro: float = 0.0
    accel: float = 0.0


class RecentSamples:
    """The last minute of a live IMU.

    Parameters
    ----------
    interval_s : float
        Nominal sample interval. [s]
    """

    def __init__(self, interval_s: float) -> None:
        self.interval_s = interval_s
        self.keep = math.exp(-interval_s / _FORGOTTEN_S)  # of the largest from one sample to the next
        self.rows = np.zeros((min(max(round(SPAN_S / interval_s), 2 * _FEWEST), _MOST), 8))  # t, dt, dtheta, dv
        self.largest = np.zeros(3)  # rate, specific force; how many of the last samples were spikes
        self.count = np.zeros(1, dtype=np.int64)

    def checked(
        self, t: float, dt: float, dtheta: FloatArray, dv: FloatArray, bridge: bool, refuse: bool = True
    ) -> tuple[Sample, str]:
        """A sample with lost ones before it bridged and a spike taken out, and a sentence on that or nothing.

        Parameters
        ----------
        t, dt : float
            End and length of its interval. [s]
        dtheta, dv : ndarray, shape (3,)
        bridge : bool
            False takes increments for those of all the interval, however long.
        refuse : bool
            Refuse what no sensor can have read; a stream goes on without it, as without a spike.

        Raises
        ------
        InputError
            If no sensor can have read it.
        """
        length = max(dt, self.interval_s)  # stamps that jitter make no rates
        rate, force = _size(dtheta) / length, _size(dv) / length
        beyond = rate > MAX_RATE or force > MAX_FORCE
        if beyond and refuse:
            raise InputError(
                f"the sample at {t:.6f} s has {rate:.3g} rad/s and {force:.3g} m/s^2, beyond any sensor "
                f"({MAX_RATE:g} rad/s, {MAX_FORCE:.0f} m/s^2): leave it out, the next one bridges it. If all are so, "
                "expected are increments in rad and m/s over the sample's interval"
            )
        sample, sentence = Sample(t, dt, dtheta, dv), ""
        if bridge and not beyond and dt > MISSING * self.interval_s and self.count[0]:
            sample, sentence = self._bridged(sample)
        elif bridge:
            sample, sentence = self._without_spike(sample, rate, force)
        row = self.rows[self.count[0] % len(self.rows)]
        row[0], row[1], row[2:5], row[5:8] = t, dt, sample.dtheta, sample.dv
        self.count += 1
        return sample, sentence

    def checked_block(
        self, t: FloatArray, dt: FloatArray, dtheta: FloatArray, dv: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, list[str]]:
        """Consecutive samples, as :meth:`checked` would have them one by one with ``bridge``, refusing none.

        Parameters
        ----------
        t, dt : ndarray, shape (n,)
        dtheta, dv : ndarray, shape (n, 3)

        Returns
        -------
        dtheta, dv : ndarray, shape (n, 3)
        unknown : ndarray, shape (n, 2)
            1-sigma of the rates over a bridge. [rad/s], [m/s^2]
        sentences : list of str
        """
        n, unknown = len(t), np.zeros((len(t), 2))
        length = np.maximum(dt, self.interval_s)
        rate, force = np.abs(dtheta).max(axis=1) / length, np.abs(dv).max(axis=1) / length
        usual = np.all(dt <= MISSING * self.interval_s) and rate.max() <= SPIKE[0] and force.max() <= SPIKE[1]
        if not usual:
            dtheta, dv, sentences = dtheta.copy(), dv.copy(), []
            for i in range(n):
                sample, sentence = self.checked(float(t[i]), float(dt[i]), dtheta[i], dv[i], True, refuse=False)
                dtheta[i], dv[i], unknown[i] = sample.dtheta, sample.dv, (sample.gyro, sample.accel)
                sentences += [sentence] if sentence else []
            return dtheta, dv, unknown, sentences
        kept = slice(max(n - len(self.rows), 0), n)
        rows = (self.count[0] + np.arange(n)[kept]) % len(self.rows)
        self.rows[rows] = np.column_stack((t, dt, dtheta, dv))[kept]
        keep = self.keep ** np.arange(n - 1, -1, -1)
        for i, x in enumerate((rate, force)):
            self.largest[i] = max(float(np.max(keep * x)), float(keep[0]) * self.keep * self.largest[i])
        self.largest[2] = 0.0
        self.count += n
        return dtheta, dv, unknown, []

    def is_spike(self, rate: float, force: float) -> bool:
        """Whether a single reading of so large components is no motion, after those so far. [rad/s], [m/s^2]"""
        return any(x > SPIKE[i] and x > _TIMES * self.largest[i] for i, x in enumerate((rate, force)))

    def _bridged(self, sample: Sample) -> tuple[Sample, str]:
        """A late sample with what it does not cover, as in a batch run."""
        t, dt, dtheta, dv, *_ = sample
        last = self._ordered(_FOR_INTERVAL)
        h = float(np.median(last[:, 1])) if len(last) >= 2 * _FEWEST else self.interval_s
        if dt <= MISSING * h:
            return sample, ""
        missing, sentence = dt / h - 1.0, ""
        rates = last[:, 2:] / last[:, 1:2]
        usual = float(np.median(np.linalg.norm(rates[-5:, 3:], axis=1))) * h
        if np.linalg.norm(dv) < usual * math.sqrt(dt / h):  # see `preparation.refilled`
            dtheta = dtheta + 0.5 * missing * (rates[-1, :3] * h + dtheta)
            dv = dv + 0.5 * missing * (rates[-1, 3:] * h + dv)
            sentence = f"{t:.3f} s: {round(missing)} IMU samples lost, {missing * h:.3f} s; filled with the mean rate"
        if dt <= PAUSE * h:
            return Sample(t, dt, dtheta, dv), sentence
        return Sample(t, dt, dtheta, dv, *self._bridging_noise(dt)), sentence

    def _bridging_noise(self, length: float) -> tuple[float, float]:
        """Error of bridging so long a pause, from bridging pieces of the recent samples. [rad/s], [m/s^2]"""
        rows = self._ordered(len(self.rows))
        if len(rows) < _FEWEST:
            return _UNKNOWN
        series = ImuSeries(rows[:, 0], rows[:, 2:5], rows[:, 5:8], "increment")
        piece = min(length, 0.5 * (rows[-1, 0] - rows[0, 0]))
        while True:
            try:
                gyro, accel = bridging_noise(series, piece)
                break
            except InputError:  # no stretch as long without a pause
                if piece <= 2.0 * series.interval:
                    return _UNKNOWN
                piece *= 0.5
        longer = math.sqrt(length / piece)  # motion nobody saw goes on as a random walk
        return gyro * longer, accel * longer

    def _without_spike(self, sample: Sample, rate: float, force: float) -> tuple[Sample, str]:
        """A sample with the rate before it, or none, in place of a reading that is no motion, and its uncertainty."""
        keep = self.keep
        spikes = [
            x > limit or (self.largest[2] < IN_A_ROW and x > SPIKE[i] and x > _TIMES * self.largest[i])
            for i, (x, limit) in enumerate(((rate, MAX_RATE), (force, MAX_FORCE)))
        ]
        self.largest[2] = self.largest[2] + 1.0 if any(spikes) else 0.0
        if not any(spikes):
            self.largest[0] = max(rate, keep * self.largest[0])
            self.largest[1] = max(force, keep * self.largest[1])
            return sample, ""
        read, unknown = [sample.dtheta, sample.dv], [0.0, 0.0]
        what = f"{sample.t:.3f} s: a single reading of {rate:.3g} rad/s, {force:.3g} m/s^2 is no motion; "
        if self.count[0]:
            before = self.rows[(self.count[0] - 1) % len(self.rows)]
            usual = [before[2:5] * (sample.dt / before[1]), before[5:8] * (sample.dt / before[1])]
            sentence = what + "the one before is repeated, uncertain by the difference"
        else:
            usual = [np.zeros(3), np.zeros(3)]
            sentence = what + "it is the first, and left out, uncertain by its size"
        for i in (0, 1):
            if spikes[i]:
                unknown[i] = float(np.linalg.norm(read[i] - usual[i])) / sample.dt
                read[i] = usual[i]
        return Sample(sample.t, sample.dt, read[0], read[1], unknown[0], unknown[1]), sentence

    def _ordered(self, most: int) -> FloatArray:
        """The newest rows in order of time."""
        k, size = int(self.count[0]), len(self.rows)
        n = min(k, size, most)
        ordered: FloatArray = self.rows[(np.arange(k - n, k)) % size]
        return ordered


def _size(x: FloatArray) -> float:
    """Largest component."""
    return max(abs(float(x[0])), abs(float(x[1])), abs(float(x[2])))
