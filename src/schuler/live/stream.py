"""A stream that is navigated: collected, aligned over, filtered, and begun anew where that cannot go on."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import InputError
from schuler.filtering.measurements import merged
from schuler.live.checks import checked
from schuler.live.collection import JUDGED_S, Collection
from schuler.live.events import EventLog
from schuler.live.intake import Intake
from schuler.live.messages import Event, EventKind, Fix, Health, Measurement
from schuler.live.readings import imu_readings
from schuler.live.run import LiveRun
from schuler.live.satellites import LiveSatellites
from schuler.live.stamps import Stamps
from schuler.live.start import start
from schuler.live.warm import LONGEST_S, Kept, stands
from schuler.navigation.config import NavigationConfig
from schuler.navigation.start.alignment import aligned_sentence
from schuler.recording.series import Kind

_BLOCK_S = 1.0  # samples of so long are filtered together, unless the solution is asked for before [s]
_COLLECTED_S = 0.2  # the same before the start [s]
_JUDGE_S = 1.0  # how often health is judged [s]


class LiveStream:
    """Samples and measurements in the order of their arrival, from the first one to a filter that runs.

    Parameters
    ----------
    config, calibration, lag_s, smoother_lag_s, kind, on_event
        As of :meth:`schuler.live.navigator.LiveNavigator.from_config`.

    Attributes
    ----------
    run : LiveRun or None
        Once aligned.
    health : str
        ``aligning`` before.
    newest : float
        Time of the newest sample, on the GNSS clock; NaN before. [s]
    satellites : LiveSatellites or None
        With tight coupling.
    events : EventLog
    on_event : callable or None
        Called with every event.
    span_s : float
        Samples of so long are filtered together. [s]
    stood_still : bool
        The vehicle has not moved in the pause that follows.
    """

    run: LiveRun | None
    newest: float
    _collection: Collection | None
    _kept: Kept | None  # parameters of the run before a pause

    def __init__(
        self,
        config: NavigationConfig,
        calibration: CalibrationResult | Path | str | None,
        lag_s: float,
        smoother_lag_s: float | None,
        kind: Kind | None,
        on_event: Callable[[Event], None] | None,
    ) -> None:
        self.config, self._calibration, self._lag_s, self._smoother_lag_s = config, calibration, lag_s, smoother_lag_s
        self._readings = imu_readings(config, kind)
        self.on_event = on_event
        self.events = EventLog()
        self.satellites = LiveSatellites(config) if config.gnss.coupling == "tight" else None
        self.health: Health = "aligning"
        self.stood_still = False
        self.span_s = _COLLECTED_S
        self._intake = Intake(self.satellites, self.say)
        self._axes_said = self._antenna_said = False
        self._begin()

    def _begin(self) -> None:
        """Collect anew: nothing is aligned."""
        self._stamps = Stamps(self.config.imu.max_gap_s)
        self._collection = Collection(self.config, self._readings.kind)
        self.run = None
        self._obstacle = ""
        self._kept = None
        self.newest = math.nan  # time of the newest sample, on the GNSS clock [s]

    @property
    def _interval_s(self) -> float:
        """Sample interval, before the alignment a usual one. [s]"""
        return 0.01 if self.run is None else self.run.preparation.recent.interval_s

    def take(self, rows: FloatArray, waiting: Sequence[tuple[int, Measurement]]) -> None:
        """Take what came.

        Parameters
        ----------
        rows : ndarray, shape (n, 8)
            Raw samples: time, rate, specific force, temperature.
        waiting : sequence of (int, message)
            Measurements among them, each with the number of samples before it.
        """
        self._take_all(rows, waiting)
        self.span_s = _COLLECTED_S if self.run is None else _BLOCK_S

    def _take_all(self, rows: FloatArray, waiting: Sequence[tuple[int, Measurement]]) -> None:
        if self.run is not None and self._collection is None and self._take_usual(self.run, rows, waiting):
            return
        if self.run is not None and self._stamps.continues(rows[:, 0]):
            # measurements before the samples they are of: the filter does not go back for them
            newest = float(rows[-1, 0]) + self.config.imu.clock_shift_s if len(rows) else self.newest
            self._intake.take([message for _, message in waiting], newest, self.run, self._collection)
            self._take(rows)
            return
        first = 0
        for count, message in waiting:
            self._take(rows[first:count])
            self._intake.take([message], self.newest, self.run, self._collection)
            first = count
        self._take(rows[first:])

    def _take_usual(self, run: LiveRun, rows: FloatArray, waiting: Sequence[tuple[int, Measurement]]) -> bool:
        """Take samples and the messages among them by compiled functions; False, with nothing taken, if one is unusual.

        Measurements are put in first, so that the filter does not go back for them.
        """
        n, columns = len(rows), run.filter.samples
        if not n or not run.preparation.take_usual(rows, self._stamps.last, self._readings, columns):
            return False
        self._stamps.advance(float(rows[-1, 0]))
        self.newest = float(rows[-1, 0]) + self.config.imu.clock_shift_s
        for _, message in waiting:
            made = run.aids.usual_fix(message) if isinstance(message, Fix) and message.t <= self.newest else None
            if made is None:
                self._intake.take([message], self.newest, self.run, self._collection)
            else:
                self._intake.apply(run, made)
        if run.aids.watches:
            t, x = columns["t"][-n:], run.preparation.motion(n)
            self._intake.apply(run, run.aids.extend(t, x[:, :3], x[:, 3:]))
        self._filter(run)
        return True

    def _filter(self, run: LiveRun) -> None:
        """Filter up to the newest sample, and judge the run now and then."""
        run.filter.run()
        if run.filter.time >= run.judged_at + _JUDGE_S:
            self._judge(run)

    def _take(self, rows: FloatArray) -> None:
        """Take raw samples: time, rate, specific force, temperature. Shape (n, 8)."""
        while len(rows):
            x = rows
            if not self._readings.is_si:
                gyro, accel = self._readings.to_si(rows[:, 1:4], rows[:, 4:7])
                x = np.column_stack((rows[:, 0], gyro, accel, rows[:, 7]))
            bad = self._readings.impossible(x[:, 1:7], self._interval_s)
            if bad is not None:
                self.say("imu", f"{int(bad.sum())} IMU samples left out that no sensor reads", "impossible")
                rows, x = rows[~bad], x[~bad]
            taken, sentence, resumed = self._stamps.judge(x[:, 0])
            if sentence:
                self.say("imu", sentence, "stamps")
            x = x if taken.all() else x[taken]
            if len(x):
                self._extend(x)
            if resumed >= len(rows):
                return
            self._restart(
                f"the IMU goes on at {rows[resumed, 0]:.3f} s, which does not continue {self.newest:.3f} s",
                float(rows[resumed, 0]) + self.config.imu.clock_shift_s,
            )
            rows = rows[resumed:]

    def _extend(self, x: FloatArray) -> None:
        """Take samples that follow those before. Shape (n, 8)."""
        self.newest = float(x[-1, 0]) + self.config.imu.clock_shift_s
        if self._collection is not None:
            self._collection.extend(t=x[:, 0], gyro=x[:, 1:4], accel=x[:, 4:7], temperature=x[:, 7])
            if self.run is None:
                self._collection.forget()
                if self.satellites is not None:
                    self.satellites.forget(float(self._collection.imu["t"][0]) - 1.0)
                if self._collection.is_due():
                    self._start()
                return
        run = self.run
        assert run is not None
        samples, sentences = run.preparation.take(x[:, 0], x[:, 1:4], x[:, 4:7], x[:, 7])
        for sentence in sentences:
            self.say("imu", sentence, "bridged")
        run.filter.extend(samples)
        self._intake.apply(run, run.aids.extend(samples.t, samples.rate, samples.force))
        self._filter(run)
        if self._collection is not None and self.run is run and self.newest > run.initial.nav.t + JUDGED_S:
            self._start()
            self._collection = None

    def _judge(self, run: LiveRun) -> None:
        """Let go of what is too old; say when the health changes, and once what a claim does not hold.

        Attitudes are known no better than the sensors' axes; positions may be the antenna's.
        """
        health = run.judge()
        if run.is_broken:
            self._restart("the filter failed: its numbers are none")
        elif health != self.health:
            self.say("health", f"{self.health} becomes {health}", f"health {health}")
            self.health = health
        if health == "ok" and not self._axes_said:
            for sentence in run.axes_note():
                self.say("imu", sentence, "axes")
                self._axes_said = True
        if health == "ok" and not self._antenna_said:
            for sentence in run.antenna_note(self.config):
                self.say("measurement", sentence, "antenna")
                self._antenna_said = True

    def _start(self) -> None:
        """Align over what came so far, and filter from there to the newest sample.

        Done again when the fixes that judge the heading of a log are there too; nothing changes if they confirm it.
        """
        collection = self._collection
        assert collection is not None
        before, satellites = self.run, self.satellites
        oldest = float(collection.imu["t"][0]) - 1.0
        try:
            begun = start(
                collection, self.config, self._calibration, self._readings.kind, self._lag_s, self._smoother_lag_s,
                None if before is None else before.initial, self._kept,
                None if satellites is None else satellites.ranges(oldest),
            )  # fmt: skip
        except InputError as error:
            if str(error) != self._obstacle and before is None:
                self._obstacle = str(error)
                self.say("start", f"not aligned yet: {error}", "obstacle")
            return
        if begun is None:
            return
        for sentence in begun.sentences:
            self.say("imu", sentence, "bridged")
        self.run = run = begun.run
        intake = self._intake
        usable = None if satellites is None else satellites.ranges(oldest, usable=True)
        schedules = [intake.measurements(run.aids, [m], checked(m)) for m in collection.messages]
        intake.apply(
            run,
            merged(
                run.aids.known_places(),
                *schedules,
                intake.range_measurements(run.aids, usable),
                run.aids.extend(begun.samples.t, begun.samples.rate, begun.samples.force),
            ),
        )
        run.filter.run()
        sentence = aligned_sentence(run.initial, "as the batch run does", float(collection.imu["t"][0]))
        self.say("start", f"{'' if before is None else 'the start is revised: '}{sentence}", "aligned")
        self._judge(run)

    def _restart(self, reason: str, goes_on: float = math.nan) -> None:
        """Give up the present run and begin anew, with what it knew where the IMU goes on after a pause [s]."""
        run, kept, health, stood = self.run, self._kept, self.health, False
        if run is not None and health in ("ok", "coasting"):
            nav, P = run.filter.state.navigation, run.covariance_n
            # the clock of a receiver is another one after a pause: only an alignment finds it
            stood = self.stood_still and self.satellites is None and 0.0 < goes_on - nav.t <= LONGEST_S
            stood, kept = stood and stands(nav, P), run.kept
        if kept is not None and not 0.0 < goes_on - kept.t <= LONGEST_S:
            kept = None
        self.stood_still = False
        self._intake.stepped_until = goes_on + self._lag_s if goes_on < self.newest else -math.inf
        if run is None:
            self.say("clock", f"{reason}; collecting begins anew", "restart")
        self._begin()
        if self.satellites is not None:
            self.satellites.epochs = []
        self._kept = kept
        if run is None:
            return
        if stood:
            self.run = run.after_rest(self.config, self._readings.kind, goes_on)
            self._collection, self.newest = None, goes_on
            self.say("health", f"{reason}; it stood still, and goes on where it was", "restart")
            return
        addition = ", with the biases of before" if kept is not None else ""
        self.say("health", f"{health} becomes aligning: {reason}; alignment begins anew{addition}", "restart")
        self.health = "aligning"

    def restore(self, document: dict[str, Any]) -> None:
        """Go on from a document of the run's configuration."""
        self._stamps.last, self._stamps.other, self._stamps.count = document["stamps"]
        self.newest, self.health = document["newest"], document["health"]
        self._intake.stepped_until = document["stepped_until"]
        if document["collection"] is None:
            self._collection = None
        elif self._collection is not None:
            self._collection.restore(document["collection"])
        self._kept = None if document["kept"] is None else Kept(**document["kept"])
        if self.satellites is not None:
            self.satellites.restore(document["satellites"])
        run, provenance, temperature = (document[name] for name in ("run", "calibration", "temperature"))
        if run is not None:
            self.run = LiveRun.restored(
                run, provenance, temperature, self.config, self._calibration, self._readings.kind
            )
        self.span_s = _COLLECTED_S if self.run is None else _BLOCK_S

    def document(self) -> dict[str, Any]:
        """Everything that goes on, as plain data and arrays."""
        run, stamps = self.run, self._stamps
        return {
            "calibration": None if run is None else run.provenance,
            "temperature": math.nan if run is None else run.temperature,
            "stamps": [stamps.last, stamps.other, stamps.count],
            "newest": self.newest,
            "stepped_until": self._intake.stepped_until,
            "health": self.health,
            "collection": None if self._collection is None else self._collection.document(),
            "kept": None if self._kept is None else self._kept._asdict(),
            "satellites": None if self.satellites is None else self.satellites.document(),
            "run": None if run is None else run.document(),
        }

    def say(self, kind: EventKind, text: str, sort: str) -> None:
        """Say an event; one of a sort that was said just now is counted, and the number said with the next."""
        event = self.events.add(self.newest, kind, text, sort)
        if event is not None and self.on_event is not None:
            self.on_event(event)
