"""Live navigation of a stream with the configuration of a log: alignment, aids, late measurements, health."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import FileFormatError, InputError
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import merged
from schuler.filtering.states import StateLayout
from schuler.live.checks import check_live, checked
from schuler.live.collection import JUDGED_S, Collection
from schuler.live.events import EventLog
from schuler.live.intake import Intake
from schuler.live.messages import (
    Broadcast,
    Event,
    EventKind,
    Fix,
    Heading,
    Health,
    Height,
    ImuBlock,
    ImuSample,
    Measurement,
    Message,
    SatelliteEpoch,
    Solution,
    Speed,
)
from schuler.live.queue import SIZE, Queue
from schuler.live.readings import imu_readings
from schuler.live.run import LiveRun, solution
from schuler.live.satellites import LiveSatellites
from schuler.live.smoothing import smoothed
from schuler.live.stamps import Stamps
from schuler.live.start import start
from schuler.live.warm import LONGEST_S, Kept, stands
from schuler.navigation.config import NavigationConfig
from schuler.navigation.navigator_file import read_document, write_document
from schuler.navigation.start.alignment import aligned_sentence
from schuler.recording.io.own import time_document, time_from
from schuler.recording.series import Kind
from schuler.timebase import TimeBase

_BLOCK_S = 1.0  # samples of so long are filtered together, unless the solution is asked for before [s]
_COLLECTED_S = 0.2  # the same before the start [s]
_JUDGE_S = 1.0  # how often health is judged [s]

#: Format and version of the files of :meth:`LiveNavigator.save`.
STATE_FORMAT = "schuler/live/3"


class LiveNavigator:
    """Navigation of a stream: it aligns itself, and then runs the filter of the configuration on what comes.

    Messages are given in the order of their arrival; every one has its own stamp. Measurements that come up to
    ``lag_s`` late are put where they belong, and the filter runs again from there, so that the numbers are those of a
    run that had them in time. Nothing that comes raises an error: what is not used is said as an
    :class:`~schuler.live.Event`.

    Make one with :meth:`from_config` or :meth:`load`.

    Examples
    --------
    ``live = LiveNavigator.from_config("drive.toml")``, ``live.imu(t, gyro, accel)`` for every sample, ``live.fix(...)``
    for every fix, ``live.solution()`` whenever wanted.
    """

    _collection: Collection | None
    _run: LiveRun | None
    _kept: Kept | None  # parameters of the run before a pause

    def __init__(
        self,
        config: NavigationConfig,
        *,
        calibration: CalibrationResult | Path | str | None = None,
        lag_s: float = 10.0,
        smoother_lag_s: float | None = None,
        kind: Kind | None = None,
        on_event: Callable[[Event], None] | None = None,
    ) -> None:
        if not (math.isfinite(lag_s) and 0.0 < lag_s <= 600.0):
            raise InputError(f"lag_s: expected a time up to 600 s that measurements may come late, got {lag_s!r}")
        if smoother_lag_s is not None and not 0.0 < smoother_lag_s <= 60.0:
            raise InputError(f"smoother_lag_s: expected a lag of the smoother up to 60 s, got {smoother_lag_s!r}")
        check_live(config)
        self.config, self.lag_s, self.smoother_lag_s, self.kind = config, lag_s, smoother_lag_s, kind
        self._calibration = calibration
        self._readings = imu_readings(config, kind)
        #: Called with every event.
        self.on_event = on_event
        self._events = EventLog()
        self._queue = Queue()
        self._satellites = LiveSatellites(config) if config.gnss.coupling == "tight" else None
        self._health: Health = "aligning"
        self._stood_still = False
        self._intake = Intake(self._satellites, self._say)
        #: Meaning of zero seconds, for whoever knows it; saved with the state.
        self.time: TimeBase | None = None
        self._begin()

    @classmethod
    def from_config(
        cls,
        config: NavigationConfig | dict[str, Any] | Path | str,
        *,
        calibration: CalibrationResult | Path | str | None = None,
        lag_s: float = 10.0,
        smoother_lag_s: float | None = None,
        kind: Kind | None = None,
        on_event: Callable[[Event], None] | None = None,
    ) -> LiveNavigator:
        """A live run of a configuration that navigates logs.

        Parameters
        ----------
        config : NavigationConfig, dict, or path of a TOML file
            Loose or tight coupling, or GNSS for the alignment only. Noise is not tuned live: give what ``schuler
            tune`` found.
        calibration : CalibrationResult or path, optional
            Calibration of this unit, instead of ``imu.calibration`` of the configuration.
        lag_s : float
            How late a measurement may come. [s]
        smoother_lag_s : float, optional
            Lag of :meth:`smoothed`, up to 60; memory and the time in which measurements may come late are as long at
            least. [s]
        kind : {"rate", "increment"}, optional
            Samples come in SI and forward-right-down axes, as the series of a recording have them, and are of this
            kind. None: they come in units, axes and kind of ``[recording.imu]``.
        on_event : callable, optional
            Called with every :class:`~schuler.live.Event`.

        Raises
        ------
        ConfigError
            If the configuration is wrong, or asks for what a live run has not.
        """
        return cls(
            NavigationConfig.checked(config), calibration=calibration, lag_s=lag_s, smoother_lag_s=smoother_lag_s,
            kind=kind, on_event=on_event,
        )  # fmt: skip

    # -- what comes -----------------------------------------------------------------------------------------------

    def imu(self, t: float, gyro: ArrayLike, accel: ArrayLike, temperature: float = math.nan) -> None:
        """Take one sample.

        Parameters
        ----------
        t : float
            Of validity for rates, of the end of the interval for increments. [s]
        gyro, accel : array_like, shape (3,)
            In the units and axes of ``[recording.imu]``.
        temperature : float
            [degC]
        """
        if self._queue.put(t, gyro, accel, temperature, self._span_s):
            self._work()

    def imu_many(self, t: ArrayLike, gyro: ArrayLike, accel: ArrayLike, temperature: ArrayLike | None = None) -> None:
        """Take consecutive samples at once; shapes (n,), (n, 3), (n, 3), (n,)."""
        t = np.asarray(t, dtype=np.float64)
        queue, n = self._queue, len(t)
        T: ArrayLike = math.nan if temperature is None else temperature
        if 0 < n <= SIZE:
            if not queue.has_room(n):
                self._work()
            if queue.put_rows(t, gyro, accel, T, self._span_s):
                self._work()
            return
        columns = np.asarray(gyro), np.asarray(accel), np.broadcast_to(np.asarray(T), n)
        for first in range(0, n, SIZE):
            part = slice(first, first + SIZE)
            g, a, T = (x[part] for x in columns)
            self.imu_many(t[part], g, a, T)

    def fix(
        self,
        t: float,
        llh: ArrayLike,
        cov_r_n: ArrayLike,
        v_n: ArrayLike | None = None,
        cov_v_n: ArrayLike | None = None,
        quality: int | None = None,
    ) -> None:
        """Take a GNSS solution of the antenna; see :class:`~schuler.live.Fix`."""
        fix = Fix(
            float(t), np.asarray(llh, dtype=np.float64), np.asarray(cov_r_n, dtype=np.float64),
            None if v_n is None else np.asarray(v_n, dtype=np.float64),
            None if cov_v_n is None else np.asarray(cov_v_n, dtype=np.float64), quality,
        )  # fmt: skip
        self.take(fix)

    def speed(self, t: float, speed: float, sigma: float | None = None) -> None:
        """Take a reading of an odometer; see :class:`~schuler.live.Speed`."""
        self.take(Speed(float(t), float(speed), sigma))

    def heading(self, t: float, value: float, sigma: float | None = None) -> None:
        """Take a heading; see :class:`~schuler.live.Heading`."""
        self.take(Heading(float(t), float(value), sigma))

    def height(self, t: float, value: float, sigma: float | None = None) -> None:
        """Take a height; see :class:`~schuler.live.Height`."""
        self.take(Height(float(t), float(value), sigma))

    def take(self, message: Message) -> None:
        """Take a message of any kind."""
        if isinstance(message, ImuSample):
            temperature = math.nan if message.temperature is None else message.temperature
            self.imu(message.t, message.gyro, message.accel, temperature)
        elif isinstance(message, ImuBlock):
            self.imu_many(message.t, message.gyro, message.accel, message.temperature)
        elif self._is_of_use(message) and self._queue.put_message(message):
            self._work()

    def _is_of_use(self, message: Measurement) -> bool:
        """Whether the coupling is by such messages: a tight one by ranges, the others by fixes."""
        if self._satellites is None:
            return not isinstance(message, SatelliteEpoch | Broadcast)
        return not isinstance(message, Fix)

    # -- what is asked for ----------------------------------------------------------------------------------------

    def solution(self) -> Solution | None:
        """Solution at the newest sample, with everything that came so far; None before the alignment.

        Sigmas are those of the last propagation of the covariance, a tenth of a second ago at most with the defaults.
        """
        self._work()
        if self._run is None:
            return None
        self._run.filter.run()
        arrays = self._run.filter.state.arrays
        return solution(float(arrays.times[0]), arrays.nav, arrays.P, self._health)

    def smoothed(self) -> Solution | None:
        """Solution ``smoother_lag_s`` before the newest sample, by the batch smoother with all that came so far.

        None while the run is younger.

        Raises
        ------
        InputError
            If the run was made without ``smoother_lag_s``.
        """
        if self.smoother_lag_s is None:
            raise InputError("smoothed: the run has no smoother; make it with smoother_lag_s")
        self._work()
        if self._run is None:
            return None
        self._run.filter.run()
        state = smoothed(self._run.filter, self.smoother_lag_s)
        if state is None:
            return None
        nav, P = state
        at = np.concatenate((nav.q_eb, nav.v_eb_e, nav.r_eb_e))
        return solution(nav.t, at, P, self._health, self.smoother_lag_s)

    @property
    def health(self) -> Health:
        """Health of the solution; ``aligning`` before there is one."""
        return self._health

    @property
    def events(self) -> list[Event]:
        """The newest thousand events."""
        self._work()
        return list(self._events.newest)

    @property
    def initial(self) -> InitialState | None:
        """Initial state of the run, as aligned; None before."""
        self._work()
        return None if self._run is None else self._run.initial

    @property
    def layout(self) -> StateLayout | None:
        """States of the filter; None before the alignment."""
        self._work()
        return None if self._run is None else self._run.filter.layout

    @property
    def parameters(self) -> FloatArray:
        """Parameter estimates, order of the layout. Shape (m,)."""
        return self._running().filter.state.arrays.est.copy()

    @property
    def covariance(self) -> FloatArray:
        """Covariance at its last propagation, navigation errors in north-east-down axes. Shape (n, n)."""
        return self._running().covariance_n

    def _running(self) -> LiveRun:
        self._work()
        if self._run is None:
            raise InputError("the run is not aligned yet, so there are no estimates; ask `health` first")
        self._run.filter.run()
        return self._run

    # -- files ----------------------------------------------------------------------------------------------------

    def save(self, path: Path | str) -> Path:
        """Write everything that goes on from here, so that :meth:`load` goes on with the same numbers.

        Parameters
        ----------
        path : Path or str
            Its file appears complete or not at all: a power cut leaves the one before.
        """
        self._work()
        return write_document(path, self._document(), STATE_FORMAT)

    @classmethod
    def load(
        cls,
        path: Path | str,
        *,
        calibration: CalibrationResult | Path | str | None = None,
        stood_still: bool = False,
        on_event: Callable[[Event], None] | None = None,
    ) -> LiveNavigator:
        """A live run that :meth:`save` wrote.

        Parameters
        ----------
        path : Path or str
        calibration : CalibrationResult or path, optional
            The one that was given to :meth:`from_config`, if one was.
        stood_still : bool
            The vehicle has not moved since, and the IMU stayed on: after a pause of up to an hour the run goes on at
            its place and attitude, if it stood there. Otherwise it aligns anew, with the biases of before.
        on_event : callable, optional
            As of :meth:`from_config`: files hold no functions.

        Raises
        ------
        FileFormatError
            If the file is of another kind or version, or damaged.
        InputError
            If the calibration is another one than the run was started with.
        """
        document = read_document(path, STATE_FORMAT)
        try:
            config = NavigationConfig.parse(document["config"], str(path))
            live = cls(
                config, calibration=calibration, lag_s=document["lag_s"], smoother_lag_s=document["smoother_lag_s"],
                kind=document["kind"], on_event=on_event,
            )  # fmt: skip
            live._restore(document)
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            raise FileFormatError(f"holds no live run: {error}", path) from None
        live._stood_still = stood_still
        live._say("state", f"goes on from the state of {live._newest:.3f} s", "restored")
        return live

    def _document(self) -> dict[str, Any]:
        """Everything that goes on, as plain data and arrays."""
        run, stamps = self._run, self._stamps
        return {
            "config": self.config.model_dump(mode="json", exclude_unset=True),
            "lag_s": self.lag_s,
            "smoother_lag_s": self.smoother_lag_s,
            "kind": self.kind,
            "time": None if self.time is None else time_document(self.time),
            "calibration": None if run is None else run.provenance,
            "temperature": math.nan if run is None else run.temperature,
            "stamps": [stamps.last, stamps.other, stamps.count],
            "newest": self._newest,
            "stepped_until": self._intake.stepped_until,
            "health": self._health,
            "collection": None if self._collection is None else self._collection.document(),
            "kept": None if self._kept is None else self._kept._asdict(),
            "satellites": None if self._satellites is None else self._satellites.document(),
            "run": None if run is None else run.document(),
        }

    def _restore(self, document: dict[str, Any]) -> None:
        """Go on from a document of the run's configuration."""
        self._stamps.last, self._stamps.other, self._stamps.count = document["stamps"]
        self._newest, self._health = document["newest"], document["health"]
        self._intake.stepped_until = document["stepped_until"]
        self.time = None if document["time"] is None else time_from(document["time"])
        if document["collection"] is None:
            self._collection = None
        elif self._collection is not None:
            self._collection.restore(document["collection"])
        self._kept = None if document["kept"] is None else Kept(**document["kept"])
        if self._satellites is not None:
            self._satellites.restore(document["satellites"])
        run, provenance, temperature = (document[name] for name in ("run", "calibration", "temperature"))
        if run is not None:
            self._run = LiveRun.restored(
                run, provenance, temperature, self.config, self._calibration, self._readings.kind
            )

    # -- inside ---------------------------------------------------------------------------------------------------

    def _begin(self) -> None:
        """Collect anew: nothing is aligned."""
        self._stamps = Stamps(self.config.imu.max_gap_s)
        self._collection = Collection(self.config, self._readings.kind)
        self._run = None
        self._obstacle = ""
        self._kept = None
        self._newest = math.nan  # time of the newest sample, on the GNSS clock [s]

    @property
    def _span_s(self) -> float:
        """Samples of so long are filtered together. [s]"""
        return _COLLECTED_S if self._run is None else _BLOCK_S

    @property
    def _interval_s(self) -> float:
        """Sample interval, before the alignment a usual one. [s]"""
        return 0.01 if self._run is None else self._run.preparation.recent.interval_s

    def _work(self) -> None:
        """Take what is in the queue."""
        if not self._queue:
            return
        rows, waiting = self._queue.empty()
        if self._run is not None and self._collection is None and self._take_usual(self._run, rows, waiting):
            return
        if self._run is not None and self._stamps.continues(rows[:, 0]):
            # measurements before the samples they are of: the filter does not go back for them
            newest = float(rows[-1, 0]) + self.config.imu.clock_shift_s if len(rows) else self._newest
            self._intake.take([message for _, message in waiting], newest, self._run, self._collection)
            self._take(rows)
            return
        first = 0
        for count, message in waiting:
            self._take(rows[first:count])
            self._intake.take([message], self._newest, self._run, self._collection)
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
        self._newest = float(rows[-1, 0]) + self.config.imu.clock_shift_s
        for _, message in waiting:
            made = run.aids.usual_fix(message) if isinstance(message, Fix) and message.t <= self._newest else None
            if made is None:
                self._intake.take([message], self._newest, self._run, self._collection)
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
                self._say("imu", f"{int(bad.sum())} IMU samples left out that no sensor reads", "impossible")
                rows, x = rows[~bad], x[~bad]
            taken, sentence, resumed = self._stamps.judge(x[:, 0])
            if sentence:
                self._say("imu", sentence, "stamps")
            x = x if taken.all() else x[taken]
            if len(x):
                self._extend(x)
            if resumed >= len(rows):
                return
            self._restart(
                f"the IMU goes on at {rows[resumed, 0]:.3f} s, which does not continue {self._newest:.3f} s",
                float(rows[resumed, 0]) + self.config.imu.clock_shift_s,
            )
            rows = rows[resumed:]

    def _extend(self, x: FloatArray) -> None:
        """Take samples that follow those before. Shape (n, 8)."""
        self._newest = float(x[-1, 0]) + self.config.imu.clock_shift_s
        if self._collection is not None:
            self._collection.extend(t=x[:, 0], gyro=x[:, 1:4], accel=x[:, 4:7], temperature=x[:, 7])
            if self._run is None:
                self._collection.forget()
                if self._satellites is not None:
                    self._satellites.forget(float(self._collection.imu["t"][0]) - 1.0)
                if self._collection.is_due():
                    self._start()
                return
        run = self._run
        assert run is not None
        samples, sentences = run.preparation.take(x[:, 0], x[:, 1:4], x[:, 4:7], x[:, 7])
        for sentence in sentences:
            self._say("imu", sentence, "bridged")
        run.filter.extend(samples)
        self._intake.apply(run, run.aids.extend(samples.t, samples.rate, samples.force))
        self._filter(run)
        if self._collection is not None and self._run is run and self._newest > run.initial.nav.t + JUDGED_S:
            self._start()
            self._collection = None

    def _judge(self, run: LiveRun) -> None:
        """Let go of what is too old, and say when the health changes."""
        health = run.judge()
        if run.is_broken:
            self._restart("the filter failed: its numbers are none")
        elif health != self._health:
            self._say("health", f"{self._health} becomes {health}", f"health {health}")
            self._health = health

    def _start(self) -> None:
        """Align over what came so far, and filter from there to the newest sample.

        Done again when the fixes that judge the heading of a log are there too; nothing changes if they confirm it.
        """
        collection = self._collection
        assert collection is not None
        before, satellites = self._run, self._satellites
        oldest = float(collection.imu["t"][0]) - 1.0
        try:
            begun = start(
                collection, self.config, self._calibration, self._readings.kind, self.lag_s, self.smoother_lag_s,
                None if before is None else before.initial, self._kept,
                None if satellites is None else satellites.ranges(oldest),
            )  # fmt: skip
        except InputError as error:
            if str(error) != self._obstacle and before is None:
                self._obstacle = str(error)
                self._say("start", f"not aligned yet: {error}", "obstacle")
            return
        if begun is None:
            return
        for sentence in begun.sentences:
            self._say("imu", sentence, "bridged")
        self._run = run = begun.run
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
        self._say("start", f"{'' if before is None else 'the start is revised: '}{sentence}", "aligned")
        self._judge(run)

    def _restart(self, reason: str, goes_on: float = math.nan) -> None:
        """Give up the present run and begin anew, with what it knew where the IMU goes on after a pause [s]."""
        run, kept, health, stood = self._run, self._kept, self._health, False
        if run is not None and health in ("ok", "coasting"):
            nav, P = run.filter.state.navigation, run.covariance_n
            # the clock of a receiver is another one after a pause: only an alignment finds it
            stood = self._stood_still and self._satellites is None and 0.0 < goes_on - nav.t <= LONGEST_S
            stood, kept = stood and stands(nav, P), run.kept
        if kept is not None and not 0.0 < goes_on - kept.t <= LONGEST_S:
            kept = None
        self._stood_still = False
        self._intake.stepped_until = goes_on + self.lag_s if goes_on < self._newest else -math.inf
        if run is None:
            self._say("clock", f"{reason}; collecting begins anew", "restart")
        self._begin()
        if self._satellites is not None:
            self._satellites.epochs = []
        self._kept = kept
        if run is None:
            return
        if stood:
            self._run = run.after_rest(self.config, self._readings.kind, goes_on)
            self._collection, self._newest = None, goes_on
            self._say("health", f"{reason}; it stood still, and goes on where it was", "restart")
            return
        addition = ", with the biases of before" if kept is not None else ""
        self._say("health", f"{health} becomes aligning: {reason}; alignment begins anew{addition}", "restart")
        self._health = "aligning"

    def _say(self, kind: EventKind, text: str, sort: str) -> None:
        """Say an event; one of a sort that was said just now is counted, and the number said with the next."""
        event = self._events.add(self._newest, kind, text, sort)
        if event is not None and self.on_event is not None:
            self.on_event(event)
