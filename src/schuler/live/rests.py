"""Measurements at rest of a stream: the batch run's detector over the last seconds, its noise learnt so far."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.filtering.measurements import MeasurementSchedule, merged
from schuler.live.columns import Columns
from schuler.navigation.aids.aiding import rest_measurements
from schuler.navigation.aids.rest import horizontal_speeds
from schuler.navigation.sections import AidingSection
from schuler.recording.series import GnssSeries, ImuSeries
from schuler.sensors.spec import ImuSpec
from schuler.standstill.detectors import window_samples
from schuler.standstill.stationarity import StaticIntervals, interval_mask, quiet_bias, static_intervals
from schuler.standstill.thresholds import noise_at_rest

_EVERY_S = 0.5  # how often the last seconds are searched [s]
_LEARN_S = 60.0  # how often noise at rest is learnt from the samples so far [s]
_SHARE = 0.1  # of the samples so far that is taken to be at rest, as of a log
_GOES_ON = ("bias", "learnt_at", "searched_at", "cursors", "until", "vetoed", "fast")
_AT_REST = ("zero_velocity", "zero_rate", "gravity", "earth_rate")


class RestMeasurements:
    """Maker of zero-velocity, zero-rotation, gravity and Earth-rate measurements.

    A rest counts once it has lasted ``aiding.rest.min_s``, and a window and a half of the detector longer; then it
    makes its measurements from its beginning, late by so much. It is none while GNSS sees motion in it.

    Parameters
    ----------
    aiding : AidingSection
    spec : ImuSpec
    imu : ImuSeries, optional
        Samples so far, in which noise at rest is learnt.
    """

    def __init__(self, aiding: AidingSection, spec: ImuSpec, imu: ImuSeries | None) -> None:
        self._aids = [
            AidingSection(rest=aiding.rest, **{n: getattr(aiding, n)}) for n in _AT_REST if getattr(aiding, n)
        ]
        self._spec, self.section = spec, aiding.rest
        self.noise: tuple[FloatArray, FloatArray] | None = None
        self.bias = np.zeros(3)
        self.learnt_at = self.searched_at = -np.inf
        self.cursors: list[float] = []  # of the rest that goes on: times from which on each aid measures [s]
        self.until = -np.inf  # how far it was seen [s]
        self.vetoed = False  # GNSS has seen motion in it
        self.fast: list[float] = []  # times at which GNSS saw motion, the newest [s]
        if self._aids and imu is not None:
            self._learn(imu)

    @property
    def wanted(self) -> bool:
        """Whether anything is measured at rest."""
        return bool(self._aids)

    def see(self, gnss: GnssSeries) -> None:
        """Remember when GNSS sees motion, at the newest fixes."""
        if not self._aids:
            return
        t, speed, sigma = horizontal_speeds(gnss)
        fast = t[speed > self.section.max_speed_m_s + 3.0 * sigma]
        self.fast = sorted({*self.fast, *fast.tolist()})[-200:]

    def see_speed(self, t: float, speed: float, sigma: float) -> None:
        """Remember the horizontal speed of a fix and its 1-sigma, as :meth:`see` would."""
        if speed > self.section.max_speed_m_s + 3.0 * sigma:
            self.fast = [*self.fast[-199:], t]

    def extend(self, samples: Columns) -> MeasurementSchedule:
        """Measurements that the newest samples complete."""
        if not self._aids:
            return MeasurementSchedule.empty()
        newest = float(samples["t"][-1])
        if newest - self.learnt_at >= _LEARN_S:
            self._learn(ImuSeries(samples["t"].copy(), samples["rate"].copy(), samples["force"].copy()))
        if self.noise is None or newest - self.searched_at < _EVERY_S:
            return MeasurementSchedule.empty()
        s, blocks = self.section, [getattr(a, n).block_s for a in self._aids for n in _AT_REST[1:] if getattr(a, n)]
        back = max([s.min_s, *blocks]) + 4.0 * s.window_s
        since = max(self.searched_at, float(samples["t"][0])) - back
        self.searched_at = newest
        first = int(np.searchsorted(samples["t"], since))
        t, rate, force = (samples[name][first:].copy() for name in ("t", "rate", "force"))
        imu = ImuSeries(t, rate, force)
        try:
            intervals = static_intervals(
                imu, min_s=s.min_s, window_s=s.window_s, margin=s.margin, noise=self.noise, gyro_bias=self.bias
            )
        except InputError:  # too few samples yet
            return MeasurementSchedule.empty()
        W = max(2, round(s.window_s * imu.rate_hz))
        parts = []
        for a, b in intervals.index.tolist():
            goes_on = b == len(imu)
            stop = b - W if goes_on else b
            if stop - a >= 2:
                parts += self._measured(imu, intervals, a, stop)
            if not goes_on:
                self.cursors, self.vetoed = [], False
        if not len(intervals):
            self.cursors, self.vetoed = [], False
        return merged(*parts)

    def document(self) -> dict[str, Any]:
        """What goes on from one block of samples to the next, for files."""
        noise = None if self.noise is None else np.vstack(self.noise)
        return {**{name: getattr(self, name) for name in _GOES_ON}, "noise": noise}

    def restore(self, document: dict[str, Any]) -> None:
        """Go on from a :meth:`document`."""
        for name in _GOES_ON:
            setattr(self, name, document[name])
        noise = document["noise"]
        self.noise = None if noise is None else (noise[0], noise[1])

    def _measured(self, imu: ImuSeries, intervals: StaticIntervals, a: int, stop: int) -> list[MeasurementSchedule]:
        """Measurements of one rest that were not made before, and how far they go."""
        start, end = float(imu.t[a]), float(imu.t[stop - 1])
        if end <= self.until:
            return []
        if not self.cursors:
            start = max(start, self.until)
            self.cursors = [start] * len(self._aids)
        self.until = end
        self.vetoed |= any(start <= t <= end for t in self.fast)
        if self.vetoed:
            return []
        made = []
        for k, aid in enumerate(self._aids):
            first = int(np.searchsorted(imu.t, self.cursors[k] - 1e-9))
            if stop - first < 2:
                continue
            index = np.array([[first, stop]], dtype=np.int64)
            part = replace(
                intervals, start=np.array([self.cursors[k]]), stop=np.array([end]), index=index,
                mask=interval_mask(index, len(imu)),
            )  # fmt: skip
            schedule = merged(*rest_measurements(imu, part, aid, self._spec))
            if not len(schedule):
                continue
            last = float(schedule.t[-1])
            if aid.zero_velocity is not None:
                self.cursors[k] = last + 1.0 / aid.zero_velocity.rate_hz
            else:
                self.cursors[k] = float(imu.t[min(int(np.searchsorted(imu.t, last + 1e-9)), len(imu) - 1)])
            made.append(schedule)
        return made

    def _learn(self, imu: ImuSeries) -> None:
        """Noise at rest and gyro bias from the quietest samples so far; a louder rest than before is none."""
        self.learnt_at = float(imu.t[-1])
        try:
            noise = noise_at_rest(imu, self.section.window_s)
            bias = quiet_bias(imu, window_samples(imu, self.section.window_s), _SHARE, [])
        except InputError:  # too short yet, or an axis that never changes
            return
        if self.noise is None or _loudness(noise) <= _loudness(self.noise):
            self.noise, self.bias = noise, bias


def _loudness(noise: tuple[FloatArray, FloatArray]) -> float:
    return float(np.log(noise[0]).sum() + np.log(noise[1]).sum())
