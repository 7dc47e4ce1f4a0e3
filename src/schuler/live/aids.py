"""Measurements of a live run: fixes and readings as they come, constraints and rests from the samples so far.

What a log's aids take from all of it, these take from what came so far; everything else is the batch run's own code
(:mod:`schuler.navigation.aids`). Where the two part: docs/live.md.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.filtering.measurements import MeasurementSchedule, merged
from schuler.gnss.ranges import Ranges
from schuler.live.columns import Columns
from schuler.live.messages import Fix, Heading, Height, Speed
from schuler.live.rests import RestMeasurements
from schuler.live.weighing import Weighing
from schuler.navigation.aids.aiding import Sources, aiding_schedule, no_slip_options
from schuler.navigation.aids.vehicle import SMOOTHING_S, no_slip, weaker_without_fixes
from schuler.navigation.config import NavigationConfig
from schuler.navigation.inputs.gnss_faults import held
from schuler.navigation.inputs.preparation import prepared_gnss, with_late_velocities
from schuler.navigation.sections import AidingSection
from schuler.recording.series import GnssSeries, ImuSeries, OdometerSeries, ScalarSeries
from schuler.sensors.spec import ImuSpec

REMEMBERED_S = 300.0  # of the samples from which medians and the noise at rest are taken [s]
_HELD_FIXES = 40  # newest fixes from which it is seen that each is repeated
_NO_IMU = ImuSeries(np.zeros(1), np.zeros((1, 3)), np.zeros((1, 3)))  # these aids look at none


class LiveAids:
    """Maker of a live run's measurements.

    Parameters
    ----------
    config : NavigationConfig
    spec : ImuSpec
    start : float
        Time of the initial state. [s]
    origin : float
        Start of the stream, from which known places count their time. [s]
    imu : ImuSeries, optional
        Samples so far, as the aids take them, to learn from.
    interval_s : float
        Sample interval. [s]
    clocks : tuple of str
        Receiver clocks that are states, in the order of these, for ranges.
    """

    def __init__(
        self,
        config: NavigationConfig,
        spec: ImuSpec,
        start: float,
        origin: float,
        imu: ImuSeries | None,
        interval_s: float,
        clocks: tuple[str, ...] = (),
    ) -> None:
        self.config, self.spec, self.start, self.origin, self.interval_s = config, spec, start, origin, interval_s
        self.clocks = clocks
        self.samples = Columns(t=0, rate=3, force=3)
        self.fixes: list[Fix] = []  # the newest
        self.last_used: dict[str, float] = {}  # times of the readings that are thinned out [s]
        off = config.gnss.model_copy(update={"coupling": "off"})
        aiding = config.aiding
        self._of_fixes = config.model_copy(update={"aiding": AidingSection()})
        self._of_readings = {
            name: config.model_copy(update={"gnss": off, "aiding": AidingSection(**{name: getattr(aiding, name)})})
            for name in ("odometer", "heading", "barometer", "fixes")
        }
        self.rests = RestMeasurements(aiding, spec, imu)
        self._weighed: Weighing | None = None
        self._motion = Columns(t=0, force=2)  # smoothed specific force across and along
        self.constraints = 0  # times of the non-holonomic constraints that are done
        if aiding.non_holonomic is not None and imu is not None:
            self._remember_motion(imu, aiding.non_holonomic.rate_hz)

    def known_places(self) -> MeasurementSchedule:
        """Fixes at places that the configuration states."""
        return self._of("fixes", Sources(_NO_IMU)) if self.config.aiding.fixes is not None else _none()

    def fix(self, fixes: Sequence[Fix], series: GnssSeries, notes: list[str]) -> MeasurementSchedule:
        """Position and velocity of fixes; none of those that say nothing new.

        Parameters
        ----------
        fixes : sequence of Fix
            One, or several where :meth:`takes_together` says so.
        series : GnssSeries
            The same as a series.
        notes : list of str
            Gets a sentence on what they were not taken for.

        Raises
        ------
        InputError
            If they tell no position, or lack what the configuration asks for.
        """
        t = fixes[0].t
        before = self.fixes[-1] if self.fixes else None
        self.fixes += fixes
        del self.fixes[:-_HELD_FIXES]
        if self.rests.wanted:
            self.rests.see(series if series.v_n is not None else series_of(_ordered(self.fixes)))
        if self.config.gnss.coupling != "loose":
            return _none()
        if before is not None and before.t < t and np.array_equal(before.llh, fixes[0].llh):
            if held(series_of(_ordered(self.fixes)))[0][-1]:
                return _none()
            both = prepared_gnss(series_of([before, fixes[0]]), self._of_fixes, notes)
            series = both.where(both.t == t)
        else:
            series = prepared_gnss(series, self._of_fixes, notes)
        if not len(series) or self._is_too_soon("gnss", t, self.config.gnss.every_s - 1e-6):
            return _none()
        schedule, _ = aiding_schedule(Sources(_NO_IMU, series), self._of_fixes, self.spec, self.start, self.origin)
        return with_late_velocities(schedule, self.config.gnss.velocity_delay_s, self.start, [])

    def ranges(self, ranges: Ranges, notes: list[str]) -> MeasurementSchedule:
        """Pseudoranges and range rates of satellites.

        Parameters
        ----------
        ranges : Ranges
            Prepared. Those of a clock that is no state are left out.
        notes : list of str
            Gets a sentence on these.
        """
        states = np.array([self.clocks.index(name) if name in self.clocks else -1 for name in ranges.groups] or [-1])
        clock = states[ranges.group]
        without = ranges.used & (clock < 0)
        if without.any():
            missing = ", ".join(name for name in ranges.groups if name not in self.clocks)
            notes.append(f"ranges of {missing} are left out: when the run started, there were none of this clock")
        of_state = replace(ranges.where(clock >= 0), group=clock[clock >= 0], groups=self.clocks)
        if len(of_state.t):
            self.last_used["ranges"] = float(of_state.t.max())
        schedule, _ = aiding_schedule(
            Sources(_NO_IMU, ranges=of_state), self._of_fixes, self.spec, self.start, self.origin
        )
        return schedule

    def usual_fix(self, fix: Fix) -> MeasurementSchedule | None:
        """Position and velocity of a fix in one compiled call, if it is as usual; otherwise None and nothing is taken.

        Usual is a fix later than the one before and elsewhere, of finite numbers and covariances, by a configuration
        that takes every one of them at its stamp. The numbers are those of :meth:`fix`.
        """
        gnss, before = self.config.gnss, self.fixes[-1] if self.fixes else None
        if gnss.coupling != "loose" or gnss.every_s or gnss.velocity_delay_s or fix.t <= self.start + 1e-6:
            return None
        if before is None or not before.t < fix.t or (before.llh == fix.llh).all():
            return None
        if (gnss.quality is not None and fix.quality not in gnss.quality) or (fix.v_n is None) != (fix.cov_v_n is None):
            return None
        if self.rests.wanted and fix.v_n is None:
            return None
        if self._weighed is None:
            self._weighed = Weighing(gnss)
        schedule = self._weighed.schedule(fix)
        if schedule is None:
            return None
        self.fixes.append(fix)
        del self.fixes[:-_HELD_FIXES]
        self.last_used["gnss"] = fix.t
        if self.rests.wanted and fix.v_n is not None and fix.cov_v_n is not None:
            speed, variance = math.hypot(fix.v_n[0], fix.v_n[1]), max(fix.cov_v_n[0, 0], fix.cov_v_n[1, 1])
            self.rests.see_speed(fix.t, speed, math.sqrt(variance))
        return schedule

    def takes_together(self, fixes: Sequence[Fix]) -> bool:
        """Whether fixes in order of time, each at another place than the one before, may be taken at once."""
        before = self.fixes[-1] if self.fixes else None
        new = before is None or (before.t < fixes[0].t and not np.array_equal(before.llh, fixes[0].llh))
        return new and self.config.gnss.every_s == 0.0

    def reading(self, message: Speed | Heading | Height) -> MeasurementSchedule:
        """Measurement of an odometer, heading or height; none if the configuration does not use it."""
        aiding, t = self.config.aiding, np.array([message.t])
        if isinstance(message, Speed):
            if aiding.odometer is None:
                return _none()
            least = (1.0 - 1e-3) / aiding.odometer.rate_hz  # stamps jitter by a thousandth
            if self._is_too_soon("odometer", message.t, least):
                return _none()
            sigma = _sigma(message, aiding.odometer.sigma_m_s, "sigma_m_s of aiding.odometer")
            series = OdometerSeries(t, np.array([message.speed]), sigma)
            return self._of("odometer", Sources(_NO_IMU, odometer=series))
        section = aiding.heading if isinstance(message, Heading) else aiding.barometer
        if section is None:
            return _none()
        if isinstance(message, Heading):
            stated = None if aiding.heading is None else aiding.heading.sigma_deg
            sigma = _sigma(message, stated, "sigma_deg of aiding.heading")
            return self._of("heading", Sources(_NO_IMU, heading=ScalarSeries(t, np.array([message.value]), sigma)))
        stated = None if aiding.barometer is None else aiding.barometer.sigma_m
        sigma = _sigma(message, stated, "sigma_m of aiding.barometer")
        return self._of("barometer", Sources(_NO_IMU, height=ScalarSeries(t, np.array([message.value]), sigma)))

    @property
    def watches(self) -> bool:
        """Whether anything is measured by the samples themselves."""
        return self.config.aiding.non_holonomic is not None or self.rests.wanted

    def extend(self, t: FloatArray, rate: FloatArray, force: FloatArray) -> MeasurementSchedule:
        """Take samples; the constraints and measurements at rest that they complete. Shapes (n,), (n, 3), (n, 3)."""
        if not len(t) or not self.watches:
            return _none()
        self.samples.append(t=t, rate=rate, force=force)
        made = merged(self._constraints(), self.rests.extend(self.samples))
        self.samples.drop_before(float(t[-1]) - REMEMBERED_S)
        self._motion.drop_before(float(t[-1]) - REMEMBERED_S)
        return made.where(made.t > self.start + 1e-6)

    def resume(self, t: float) -> None:
        """Go on at a time after a pause at one place, with what was learnt of the noise."""
        self.start, self.constraints = t, 0
        self.samples.drop(len(self.samples))
        self.rests.cursors, self.rests.vetoed = [], False

    def document(self) -> dict[str, Any]:
        """What goes on from one message to the next, for files."""
        fixes = [{f.name: getattr(fix, f.name) for f in fields(fix)} for fix in self.fixes]
        return {
            "start": self.start, "origin": self.origin, "interval_s": self.interval_s, "clocks": list(self.clocks),
            "fixes": fixes,
            "samples": self.samples.document(), "motion": self._motion.document(), "constraints": self.constraints,
            "last_used": dict(self.last_used), "rests": self.rests.document(),
        }  # fmt: skip

    @classmethod
    def restored(cls, config: NavigationConfig, spec: ImuSpec, document: dict[str, Any]) -> LiveAids:
        """The aids of a :meth:`document`."""
        d = document
        aids = cls(config, spec, d["start"], d["origin"], None, d["interval_s"], tuple(d["clocks"]))
        aids.fixes = [Fix(**fix) for fix in d["fixes"]]
        aids.samples.restore(d["samples"])
        aids._motion.restore(d["motion"])
        aids.constraints, aids.last_used = d["constraints"], dict(d["last_used"])
        aids.rests.restore(d["rests"])
        return aids

    def _is_too_soon(self, name: str, t: float, least: float) -> bool:
        """Whether a reading is nearer to the newest one used than ``least`` [s]; that is remembered."""
        last = self.last_used.get(name, -np.inf)
        if abs(t - last) < least:
            return True
        self.last_used[name] = max(t, last)
        return False

    def _of(self, name: str, sources: Sources) -> MeasurementSchedule:
        config = self._of_readings[name]
        return aiding_schedule(sources, config, self.spec, self.start, self.origin)[0]

    def _window(self) -> int:
        return max(2, round(SMOOTHING_S / self.interval_s))

    def _remember_motion(self, imu: ImuSeries, rate_hz: float) -> None:
        """Smoothed forces of the samples before the start, for their medians."""
        rows = Columns(t=0, rate=3, force=3)
        rates = imu.rates()
        rows.append(t=rates.t, rate=rates.gyro, force=rates.accel)
        times = np.arange(float(imu.t[0]), float(imu.t[-1]), 1.0 / rate_hz)
        t, _, across, along = _smoothed(rows, times, self._window())
        self._motion.append(t=t, force=np.column_stack((across, along)))

    def _constraints(self) -> MeasurementSchedule:
        """Non-holonomic constraints whose half second is complete."""
        section = self.config.aiding.non_holonomic
        if section is None:
            return _none()
        step = 1.0 / section.rate_hz
        newest = float(self.samples["t"][-1])
        count = int((newest - self.start) / step) + 1
        k = np.arange(self.constraints, max(count, self.constraints), dtype=np.float64)
        times: FloatArray = self.start + step + step * k
        t, turn, across, along = _smoothed(self.samples, times, self._window())
        if not len(t):
            return _none()
        self.constraints += len(t)
        fresh = t > (self._motion["t"][-1] if len(self._motion) else -np.inf)
        self._motion.append(t=t[fresh], force=np.column_stack((across, along))[fresh])
        usual = np.median(self._motion["force"], axis=0)
        made = no_slip(t, (turn, across - usual[0], along - usual[1]), **no_slip_options(section))
        fixes = np.sort([self.start, *(fix.t for fix in self.fixes), self.last_used.get("ranges", self.start)])
        return weaker_without_fixes(made, section.unaided_factor, fixes)


def series_of(fixes: Sequence[Fix]) -> GnssSeries:
    """Fixes as a series; with velocities where all have one.

    Raises
    ------
    InputError
        If a fix is none, or their times do not increase.
    """
    velocity = all(f.v_n is not None and f.cov_v_n is not None for f in fixes)
    quality = all(f.quality is not None for f in fixes)
    return GnssSeries(
        np.array([f.t for f in fixes]),
        np.array([f.llh for f in fixes], dtype=np.float64).reshape(-1, 3),
        np.array([f.cov_r_n for f in fixes], dtype=np.float64).reshape(-1, 3, 3),
        np.array([f.v_n for f in fixes], dtype=np.float64) if velocity else None,
        np.array([f.cov_v_n for f in fixes], dtype=np.float64) if velocity else None,
        np.array([f.quality for f in fixes], dtype=np.int64) if quality else None,
    )


def _ordered(fixes: Sequence[Fix]) -> list[Fix]:
    return sorted(fixes, key=lambda fix: fix.t)


def _smoothed(rows: Columns, times: FloatArray, window: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Means over a centred window at the times for which it is complete; see ``smoothed_motion``. Shapes (m,)."""
    at = np.searchsorted(rows["t"], times)
    complete = at + window // 2 < len(rows)
    times, at = times[complete], at[complete]
    means = np.empty((len(at), 3))
    rate, force = rows["rate"], rows["force"]
    for i, k in enumerate(at.tolist()):
        first = max(k - (window - 1) // 2, 0)
        part = slice(first, first + window)
        means[i] = rate[part, 2].mean(), force[part, 1].mean(), force[part, 0].mean()
    return times, means[:, 0], means[:, 1], means[:, 2]


def _sigma(message: Speed | Heading | Height, stated: float | None, entry: str) -> FloatArray:
    if message.sigma is None and stated is None:
        raise InputError(f"expected a 1-sigma with the reading or in {entry}; got neither")
    return np.array([1.0 if message.sigma is None else message.sigma])  # one that is stated is put in its place


def _none() -> MeasurementSchedule:
    return MeasurementSchedule.empty()
