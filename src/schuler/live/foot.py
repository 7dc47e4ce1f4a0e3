"""Live walk of an IMU on a shoe: the filter and the smoother of ``filter.smooth = "stride"``, on a stream."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from schuler import earth, frames, units
from schuler.arrays import ArrayLike, FloatArray
from schuler.exceptions import ConfigError, InputError
from schuler.filtering.engine import FilterOptions
from schuler.filtering.error_model import ecef_from_ned_states
from schuler.filtering.initial_state import InitialState
from schuler.filtering.states import StateLayout
from schuler.live.columns import Columns
from schuler.live.events import EventLog
from schuler.live.messages import Event, EventKind, Health, ImuBlock, ImuSample, Message, Solution
from schuler.live.run import solution
from schuler.live.stamps import Stamps
from schuler.navigation.foot.alignment import align_foot, walk_start
from schuler.navigation.foot.by_stride import filter_stride, long_rest_cut
from schuler.navigation.foot.clipping import Clips, clip_noise, clip_sentences, gyro_clips, restored
from schuler.navigation.foot.config import FootConfig
from schuler.navigation.foot.motion import in_motion, motion_level, noise_in_motion, spike_doubts
from schuler.navigation.foot.rests import detect_rests, zero_velocities
from schuler.navigation.foot.run import foot_layout, residual_speeds
from schuler.navigation.foot.strides import residual_doubts
from schuler.navigation.result import NavigationResult
from schuler.recording.io.checks import MAX_FORCE, MAX_RATE
from schuler.recording.series import ImuSeries, Increments, Kind
from schuler.standstill.gait import stride_period
from schuler.standstill.intervals import Rests

_WORKED_S = 0.2  # samples of so long are worked off together [s]
_LEARNT_STRIDES = 6  # of walking, from which the gait is known
_LEAST_RATE = 0.7  # RMS of somebody who shuffles: less is none who walks [rad/s]
_COLLECTED_S = 60.0  # kept until the gait is known [s]
_EARLY_S = 1.0  # left out behind a start that cannot be levelled
_NO_GAIT_S = 1.5  # stands for a stride where nothing repeats
_WITHOUT_REST_S = 60.0  # after which a walk without a stance is none any more [s]
_STRIDES_WITHOUT_REST = 3.0  # after which the solution coasts
_WALKED_M_S = 2.0  # 1-sigma of the speed over a pause of the stream [m/s]
_FEW_SAMPLES = 3  # make no interval of a median
_JUDGED = 20  # newest strides that are judged, beside the first three


@dataclass
class _Walk:
    """A walk under way.

    Attributes
    ----------
    layout : StateLayout
    state : InitialState
        At the end of the newest complete piece.
    psd : (ndarray, ndarray), shapes (3,)
    in_rest : bool
        The newest piece ended within a long rest, or is the start: the rest at its end is yet to be cut.
    smoothed : NavigationResult, optional
        The newest complete piece.
    residual, speed : list of float
        Speed left at stances, and of strides. [m/s]
    """

    layout: StateLayout
    state: InitialState
    psd: tuple[FloatArray, FloatArray]
    in_rest: bool = True
    smoothed: NavigationResult | None = None
    residual: list[float] = field(default_factory=list)
    speed: list[float] = field(default_factory=list)

    @property
    def t(self) -> float:
        """End of the newest piece. [s]"""
        return self.state.nav.t


class LiveFoot:
    """Walk of an IMU on a shoe from a stream: it learns the gait, aligns, and then navigates stride by stride.

    A piece of the walk from stance to stance is filtered, smoothed and final once the next stance is known for certain,
    about two strides later; the numbers are those of :func:`~schuler.navigation.foot.navigate_foot` with
    ``filter.smooth = "stride"`` and the gait that was learnt, :attr:`config`. In between :meth:`solution` predicts.
    Nothing that comes raises an error: what is not used is said as an :class:`~schuler.live.Event`.

    Parameters
    ----------
    config : FootConfig, dict, or path of a TOML file, optional
        Detector thresholds ``motion`` and numbers; ``filter.smooth`` is always ``stride``.
    kind : {"rate", "increment"}
        Of the samples, which come in SI and body axes.
    on_event : callable, optional
        Called with every :class:`~schuler.live.Event`.
    on_stride : callable, optional
        Called with the smoothed :class:`~schuler.navigation.NavigationResult` of every piece, the health, and the time
        of the newest sample.

    Raises
    ------
    ConfigError
        If the configuration is wrong, or asks for a threshold that looks at all of a log.

    Examples
    --------
    ``walk = LiveFoot("shoe.toml")``, ``walk.imu_many(t, gyro, accel)`` for what comes, ``walk.solution()`` whenever
    wanted, ``walk.finish()`` at the end.
    """

    def __init__(
        self,
        config: FootConfig | dict[str, Any] | Path | str | None = None,
        *,
        kind: Kind = "rate",
        on_event: Callable[[Event], None] | None = None,
        on_stride: Callable[[NavigationResult, Health, float], None] | None = None,
    ) -> None:
        given = FootConfig() if config is None else FootConfig.checked(config)
        if given.detector.threshold in ("time", "noise"):
            raise ConfigError(
                f"detector.threshold = '{given.detector.threshold}' looks at a log from its beginning; live, give "
                "'motion' or a number"
            )
        smooth = given.filter.model_copy(update={"smooth": "stride"})
        #: The configuration, with the gait and the noise that were learnt as soon as they are.
        self.config = given.model_copy(update={"filter": smooth})
        self.kind: Kind = kind
        self.on_event, self.on_stride = on_event, on_stride
        self._events = EventLog()
        self._samples = Columns(t=0, gyro=3, accel=3)
        self._stamps = Stamps(given.sensor.max_gap_s)
        self._worked_at = -math.inf
        self._largest = np.zeros(3)  # rates so far [rad/s]
        self._is_learnt = False
        self._walk: _Walk | None = None
        self._health: Health = "aligning"
        self._newest: tuple[float, Solution] | None = None

    # -- what comes -----------------------------------------------------------------------------------------------

    def imu(self, t: float, gyro: ArrayLike, accel: ArrayLike) -> None:
        """Take one sample; time [s], shapes (3,), as :class:`~schuler.recording.ImuSeries` has them."""
        self.imu_many([t], [np.asarray(gyro)], [np.asarray(accel)])

    def imu_many(self, t: ArrayLike, gyro: ArrayLike, accel: ArrayLike) -> None:
        """Take consecutive samples at once; shapes (n,), (n, 3), (n, 3)."""
        rows = [np.asarray(x, dtype=np.float64) for x in (t, gyro, accel)]
        rows = self._possible(rows)
        while len(rows[0]):
            taken, sentence, resumed = self._stamps.judge(rows[0])
            if sentence:
                self._say("imu", sentence, "stamps")
            t_, gyro_, accel_ = (x[:resumed][taken[:resumed]] for x in rows)
            self._samples.append(t=t_, gyro=gyro_, accel=accel_)
            if resumed < len(rows[0]):
                self._break_off(float(rows[0][resumed]), "the stream of the IMU pauses or its clock steps")
            rows = [x[resumed:] for x in rows]
        if len(self._samples) and not abs(self._last - self._worked_at) < _WORKED_S:
            self._worked_at = self._last
            self._work()

    def take(self, message: Message) -> None:
        """Take a message: samples; others are of no use to a walk, and said once."""
        if isinstance(message, ImuSample):
            self.imu(message.t, message.gyro, message.accel)
        elif isinstance(message, ImuBlock):
            self.imu_many(message.t, message.gyro, message.accel)
        else:
            self._say("measurement", f"{type(message).__name__}: left out, a walk takes an IMU only", "message")

    def finish(self) -> None:
        """End the stream: the walk up to its last sample is filtered and smoothed, as that of a log."""
        self._work(ended=True)

    # -- what is asked for ----------------------------------------------------------------------------------------

    def solution(self) -> Solution | None:
        """Solution at the newest sample, from the newest complete stride on; None before the start."""
        walk = self._walk
        if walk is None or not len(self._samples):
            return None
        if self._newest is None or self._newest[0] != self._last:
            imu, clips = self._series()
            part, state = self._increments(imu, walk.t, self._last), walk.state
            if part is not None:
                state = self._filtered(walk, part, (imu, clips, self._rests(imu)), smoother=False).state_at(-1)
            nav, T = state.nav, ecef_from_ned_states(state.nav.llh, walk.layout.size)
            at = np.concatenate((nav.q_eb, nav.v_eb_e, nav.r_eb_e))
            self._newest = self._last, solution(nav.t, at, T @ state.P @ T.T, self._health)
        return self._newest[1]

    def smoothed(self) -> Solution | None:
        """Solution at the end of the newest complete stride; None before there is one."""
        if self._walk is None or self._walk.smoothed is None:
            return None
        return stride_solutions(self._walk.smoothed, self._health, self._last)[-1]

    @property
    def health(self) -> Health:
        """``aligning`` until the gait and the start are known; ``coasting`` after three strides without a stance."""
        return self._health

    @property
    def events(self) -> list[Event]:
        """The newest thousand events."""
        return list(self._events.newest)

    # -- work -----------------------------------------------------------------------------------------------------

    @property
    def _last(self) -> float:
        return float(self._samples["t"][-1])

    @property
    def _cycle_s(self) -> float:
        return self.config.detector.cycle_s or _NO_GAIT_S

    def _possible(self, rows: list[FloatArray]) -> list[FloatArray]:
        """Samples without those that no IMU gives."""
        scale = 1.0 if self.kind == "rate" else self.config.sensor.max_gap_s  # of the longest interval
        with np.errstate(invalid="ignore"):
            good = (np.abs(rows[1]) < MAX_RATE * scale).all(axis=1) & (np.abs(rows[2]) < MAX_FORCE * scale).all(axis=1)
        if not good.all():
            self._say("imu", f"IMU samples left out: {int((~good).sum())} not finite or impossible", "values")
            rows = [x[good] for x in rows]
        return rows

    def _raw(self) -> ImuSeries:
        """Samples of the newest strides."""
        s = self._samples
        return ImuSeries(s["t"].copy(), s["gyro"].copy(), s["accel"].copy(), self.kind)

    def _series(self) -> tuple[ImuSeries, Clips]:
        """The same with the hidden angles of clipped gyroscopes put back, and these."""
        imu = self._raw()
        if len(imu) < _FEW_SAMPLES:
            return imu, gyro_clips(imu, np.zeros(3))
        self._largest = np.maximum(self._largest, np.abs(imu.rates().gyro).max(axis=0))
        clips = gyro_clips(imu, self._largest)
        return restored(imu, clips), clips

    def _increments(self, imu: ImuSeries, start: float, stop: float) -> Increments | None:
        """Intervals of the samples within a span, None where there are none. [s]"""
        if len(imu) < _FEW_SAMPLES or stop - start < 1e-9:
            return None
        increments = imu.increments(order=self.config.sensor.rate_order)
        keep = (increments.t - increments.dt >= start - 1e-6) & (increments.t <= stop + 1e-9)
        return increments.between(start, stop) if keep.any() else None

    def _rests(self, imu: ImuSeries) -> Rests:
        return detect_rests(
            imu, self.config.detector, gravity=self._gravity, rest_s=self.config.alignment.rest_s,
            period_s=0.0,  # the configuration's, if there is a gait
        )  # fmt: skip

    @property
    def _place(self) -> FloatArray:
        place = self.config.place
        return np.array([place.lat_deg * units.DEG, place.lon_deg * units.DEG, place.height_m])

    @property
    def _gravity(self) -> float:
        return float(np.linalg.norm(earth.gravity_ned(self._place[0], self._place[2])))

    @property
    def _certain_s(self) -> float:
        """Time after which rests do not change any more by what comes: the next stance belongs to it. [s]"""
        section = self.config.detector
        return 1.5 * self._cycle_s + section.window + section.min_rest_s + section.bridge_s + 0.1

    def _work(self, *, ended: bool = False) -> None:
        """Go on with what has come."""
        if self._walk is None:
            self._begin(ended)
        walk = self._walk
        if walk is None:
            return
        imu, clips = self._series()
        rests = self._rests(imu)
        certain = math.inf if ended else self._last - self._certain_s
        cuts, in_rest = self._cuts(rests, walk, certain)
        if ended:
            cuts = [*(t for t in cuts if t < self._last - 1e-9), self._last]
        for start, stop in pairwise([walk.t, *cuts]):
            if (part := self._increments(imu, start, stop)) is not None:
                self._complete(walk, part, (imu, clips, rests))
        walk.in_rest = in_rest if cuts else walk.in_rest
        self._newest = None
        self._judge(walk, rests)
        if self._last - walk.t > _WITHOUT_REST_S:
            self._break_off(self._last, f"no stance for {_WITHOUT_REST_S:g} s")
            return
        self._samples.drop_before(walk.t - 2.0 * self._cycle_s - self._certain_s - 1.0)

    def _cuts(self, rests: Rests, walk: _Walk, certain: float) -> tuple[list[float], bool]:
        """Times at which pieces end, as :func:`schuler.navigation.foot.by_stride.rest_cuts` has them, and whether the
        rest of the last one goes on.
        """
        t, cuts, in_rest = rests.t, [], walk.in_rest
        for first, stop in rests.index.tolist():
            last = stop - 1
            if t[last] <= walk.t + 1e-9:
                continue
            if t[first] <= walk.t + 1e-9:  # the rest in which the newest piece ended
                if not walk.in_rest:
                    continue
                first = int(np.searchsorted(t, walk.t - 1e-9))
            if t[first] > certain:
                break
            so_far = min(last, int(np.searchsorted(t, certain, side="right")) - 1)
            while (cut := long_rest_cut(t, first, so_far)) is not None:
                cuts.append(float(t[cut]))
                first, in_rest = cut, True
            if t[last] > certain:
                break
            cuts.append(float(t[(first + last) // 2]))
            in_rest = False
        return [cut for cut in cuts if cut > walk.t + 1e-9], in_rest

    def _filtered(
        self, walk: _Walk, part: Increments, seen: tuple[ImuSeries, Clips, Rests], *, smoother: bool
    ) -> NavigationResult:
        """Piece of the walk, filtered with the rests and clips that the samples around it show."""
        (imu, clips, rests), section = seen, self.config.filter
        within = (imu.t[clips.index[:, 0]] > part.start) & (imu.t[clips.index[:, 1]] <= part.t[-1])
        hidden = clip_noise(imu.between(part.start, float(part.t[-1])), clips.where(within))
        options = FilterOptions(
            covariance_rate_hz=section.covariance_rate_hz, record_s=section.record_s, smoother=smoother
        )
        psd = walk.psd[0] + hidden, walk.psd[1]
        return filter_stride(
            part, zero_velocities(imu, rests, self.config), walk.state, walk.layout, psd, options
        )  # fmt: skip

    def _complete(self, walk: _Walk, part: Increments, seen: tuple[ImuSeries, Clips, Rests]) -> None:
        """Filter and smooth a piece, and go on from its end."""
        filtered = self._filtered(walk, part, seen, smoother=True)
        walk.smoothed, walk.state = filtered.smooth(), filtered.state_at(-1)
        walk.residual += residual_speeds(filtered, self.config.stride.min_motion_s).tolist()
        r = walk.smoothed.trajectory.r_eb_e
        length = float(np.hypot(*frames.ned_from_ecef(r[-1:], frames.llh_from_ecef(r[0]))[0, :2]))
        if length >= self.config.stride.min_length_m:
            walk.speed.append(length / (float(part.t[-1]) - part.start))
        del walk.residual[3:-_JUDGED], walk.speed[:-_JUDGED]
        if self.on_stride is not None:
            self.on_stride(walk.smoothed, self._health, self._last)

    def _judge(self, walk: _Walk, rests: Rests) -> None:
        """Health from the strides: doubtful as the verdict of a log is."""
        doubts = residual_doubts(np.array(walk.residual), np.array(walk.speed))
        since = self._last - (float(rests.stop[-1]) if len(rests) else walk.t)
        health: Health = "ok"
        if doubts:
            health = "doubtful"
        elif since > _STRIDES_WITHOUT_REST * self._cycle_s:
            health = "coasting"
        if health != self._health:
            reason = doubts[0] if doubts else f"{since:.1f} s since the last stance"
            text = f"{self._health} becomes {health}" + ("" if health == "ok" else f": {reason}")
            self._health = health
            self._say("health", text, health)

    # -- start ----------------------------------------------------------------------------------------------------

    def _begin(self, ended: bool) -> None:
        """Learn the gait, and start at the first rest of what was collected, if it has come to its end."""
        if len(self._samples) < _FEW_SAMPLES:
            return
        if not self._is_learnt and not self._learn(self._raw(), ended):
            self._samples.drop_before(self._last - _COLLECTED_S)
            return
        imu, config = self._series()[0], self.config
        notes: list[str] = []
        begin, layout = math.nan, foot_layout(config)
        try:
            rests = self._rests(imu)
            increments = imu.increments(order=config.sensor.rate_order)
            begin = walk_start(imu.rates(), rests, increments, config, self._gravity, notes)
            if not ended and begin + config.alignment.rest_s + self._certain_s > self._last:
                return
            state = align_foot(imu, rests, begin, self._place, layout, config, notes)
        except InputError as error:  # too few samples, no rest, or one that is none
            self._say("start", f"waits for a rest: {error}", "waits")
            self._samples.drop_before(self._last - _COLLECTED_S if math.isnan(begin) else begin + _EARLY_S)
            return
        gyro_psd, accel_psd, _ = noise_in_motion(imu, config.sensor, self._gravity)
        self._walk = _Walk(layout, state, (gyro_psd, accel_psd))
        for note in notes:
            self._say("start", note, note)

    def _learn(self, imu: ImuSeries, ended: bool) -> bool:
        """Take stride and noise from the motion so far; whether there is enough of it."""
        stride, moving_s = stride_period(imu), float(in_motion(imu).sum()) * imu.interval
        enough_s = _COLLECTED_S / 2.0 if stride is None else _LEARNT_STRIDES * stride
        if not ended and (moving_s < enough_s or motion_level(imu, self._gravity)[1] < _LEAST_RATE):
            return False
        gyro_psd, accel_psd, note = noise_in_motion(imu, self.config.sensor, self._gravity)
        noise = {
            "gyro_noise_deg_s_rthz": math.sqrt(gyro_psd[0]) / units.DEG,
            "accel_noise_m_s2_rthz": math.sqrt(accel_psd[0]),
        }
        detector = self.config.detector.model_copy(update={"cycle_s": self.config.detector.cycle_s or stride})
        sensor = self.config.sensor.model_copy(update=noise)
        self.config = self.config.model_copy(update={"detector": detector, "sensor": sensor})
        self._is_learnt = True
        gait = "nothing repeats like a gait" if detector.cycle_s is None else f"strides of {detector.cycle_s:.2f} s"
        self._say("start", gait + (f"; {note}" if note else ""), "learnt")
        for texts in (spike_doubts(imu), *clip_sentences(imu, gyro_clips(imu))):
            for text in texts:
                self._say("imu", text, text)
        return True

    def _break_off(self, t: float, reason: str) -> None:
        """End the walk; the next one starts where it was last, as uncertain as the time since makes it. [s]"""
        last, walk = self.solution(), self._walk
        self._samples.drop(len(self._samples))
        self._walk, self._newest, self._worked_at = None, None, -math.inf
        if walk is None or last is None:
            return
        away = max(t - last.t, 0.0)
        lat, lon, height = last.llh
        place = {"lat_deg": lat / units.DEG, "lon_deg": lon / units.DEG, "height_m": height}
        heading = {
            "heading_deg": last.rpy_nb[2] / units.DEG,
            "heading_sigma_deg": min(math.hypot(last.sigma_psi_n[2], _LEAST_RATE * away) / units.DEG, 180.0),
        }
        far = math.hypot(float(np.max(last.sigma_r_n)), _WALKED_M_S * away)
        parts = {"place": place, "alignment": heading, "filter": {"position_sigma_m": far}}
        self.config = self.config.model_copy(
            update={name: getattr(self.config, name).model_copy(update=part) for name, part in parts.items()}
        )
        self._health = "aligning"
        self._say("health", f"{reason}: the walk goes on at the next rest, {far:.1f} m uncertain (1 sigma)", "broken")

    def _say(self, kind: EventKind, text: str, sort: str) -> None:
        t = self._last if len(self._samples) else math.nan
        event = self._events.add(t, kind, text, sort)
        if event is not None and self.on_event is not None:
            self.on_event(event)


def stride_solutions(result: NavigationResult, health: Health, newest: float) -> list[Solution]:
    """Solutions of a smoothed piece at its records.

    Parameters
    ----------
    result : NavigationResult
    health : str
    newest : float
        Newest sample of the stream: each is smoothed with a lag up to there. [s]
    """
    s = result.states
    nav = np.concatenate((s.q_eb, s.v_eb_e, s.r_eb_e), axis=1)
    return [
        solution(float(t), nav[k], result.covariance_e[k], health, newest - float(t)) for k, t in enumerate(s.t)
    ]  # fmt: skip
