"""Live navigation of a stream with the configuration of a log: alignment, aids, late measurements, health."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import FileFormatError, InputError
from schuler.filtering.initial_state import InitialState
from schuler.filtering.states import StateLayout
from schuler.live.checks import check_live
from schuler.live.messages import (
    Broadcast,
    Event,
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
from schuler.live.run import LiveRun
from schuler.live.smoothing import smoothed
from schuler.live.stream import LiveStream
from schuler.navigation.config import NavigationConfig
from schuler.navigation.navigator_file import read_document, write_document
from schuler.recording.io.own import time_document, time_from
from schuler.recording.series import Kind
from schuler.timebase import TimeBase

#: Format and version of the files of :meth:`LiveNavigator.save`.
STATE_FORMAT = "schuler/live/4"


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
        self._queue = Queue()
        self._stream = LiveStream(config, calibration, lag_s, smoother_lag_s, kind, on_event)
        #: Meaning of zero seconds, for whoever knows it; saved with the state.
        self.time: TimeBase | None = None

    @property
    def on_event(self) -> Callable[[Event], None] | None:
        """Called with every event."""
        return self._stream.on_event

    @on_event.setter
    def on_event(self, call: Callable[[Event], None] | None) -> None:
        self._stream.on_event = call

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
        if self._queue.put(t, gyro, accel, temperature, self._stream.span_s):
            self._work()

    def imu_many(self, t: ArrayLike, gyro: ArrayLike, accel: ArrayLike, temperature: ArrayLike | None = None) -> None:
        """Take consecutive samples at once; shapes (n,), (n, 3), (n, 3), (n,)."""
        t = np.asarray(t, dtype=np.float64)
        queue, n = self._queue, len(t)
        T: ArrayLike = math.nan if temperature is None else temperature
        if 0 < n <= SIZE:
            if not queue.has_room(n):
                self._work()
            if queue.put_rows(t, gyro, accel, T, self._stream.span_s):
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
        if self._stream.satellites is None:
            return not isinstance(message, SatelliteEpoch | Broadcast)
        return not isinstance(message, Fix)

    # -- what is asked for ----------------------------------------------------------------------------------------

    def solution(self) -> Solution | None:
        """Solution at the newest sample, with everything that came so far; None before the alignment.

        Sigmas are those of the last propagation of the covariance, a tenth of a second ago at most with the defaults.
        """
        run = self._aligned()
        if run is None:
            return None
        run.filter.run()
        arrays = run.filter.state.arrays
        return run.solution(float(arrays.times[0]), arrays.nav, arrays.P, self._stream.health)

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
        run = self._aligned()
        if run is None:
            return None
        run.filter.run()
        state = smoothed(run.filter, self.smoother_lag_s)
        if state is None:
            return None
        nav, P = state
        at = np.concatenate((nav.q_eb, nav.v_eb_e, nav.r_eb_e))
        return run.solution(nav.t, at, P, self._stream.health, self.smoother_lag_s)

    @property
    def health(self) -> Health:
        """Health of the solution; ``aligning`` before there is one."""
        return self._stream.health

    @property
    def events(self) -> list[Event]:
        """The newest thousand events."""
        self._work()
        return list(self._stream.events.newest)

    @property
    def initial(self) -> InitialState | None:
        """Initial state of the run, as aligned; None before."""
        run = self._aligned()
        return None if run is None else run.initial

    @property
    def layout(self) -> StateLayout | None:
        """States of the filter; None before the alignment."""
        run = self._aligned()
        return None if run is None else run.filter.layout

    @property
    def parameters(self) -> FloatArray:
        """Parameter estimates, order of the layout. Shape (m,)."""
        return self._running().filter.state.arrays.est.copy()

    @property
    def covariance(self) -> FloatArray:
        """Covariance at its last propagation, navigation errors in north-east-down axes. Shape (n, n)."""
        return self._running().claimed_covariance_n

    def _running(self) -> LiveRun:
        run = self._aligned()
        if run is None:
            raise InputError("the run is not aligned yet, so there are no estimates; ask `health` first")
        run.filter.run()
        return run

    def _aligned(self) -> LiveRun | None:
        """The run with everything that came; None before the alignment."""
        self._work()
        return self._stream.run

    def _work(self) -> None:
        """Take what is in the queue."""
        if self._queue:
            self._stream.take(*self._queue.empty())

    # -- files ----------------------------------------------------------------------------------------------------

    def save(self, path: Path | str) -> Path:
        """Write everything that goes on from here, so that :meth:`load` goes on with the same numbers.

        Parameters
        ----------
        path : Path or str
            Its file appears complete or not at all: a power cut leaves the one before.
        """
        self._work()
        document = {
            "config": self.config.model_dump(mode="json", exclude_unset=True),
            "lag_s": self.lag_s,
            "smoother_lag_s": self.smoother_lag_s,
            "kind": self.kind,
            "time": None if self.time is None else time_document(self.time),
        }
        return write_document(path, document | self._stream.document(), STATE_FORMAT)

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
            live.time = None if document["time"] is None else time_from(document["time"])
            live._stream.restore(document)
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            raise FileFormatError(f"holds no live run: {error}", path) from None
        stream = live._stream
        stream.stood_still = stood_still
        stream.say("state", f"goes on from the state of {stream.newest:.3f} s", "restored")
        return live
