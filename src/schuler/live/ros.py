"""A live run on messages of ROS 2: what the node in ``ros2/schuler_ros`` does, without ROS.

Messages are taken by the names of their fields, so any objects will do: those of rclpy, or those of a library that
reads bags. What is to be sent is given as numbers by the path of the field.
"""

from __future__ import annotations

import json
import math
from collections import Counter, deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.live.clock import SourceClock
from schuler.live.decoders.base import fix_of
from schuler.live.messages import Event, Health, ImuSample, Solution, Speed
from schuler.live.navigator import LiveNavigator
from schuler.live.topics import odometry_of
from schuler.navigation.config import NavigationConfig
from schuler.navigation.sections import change_entry
from schuler.recording.formats.ros_fields import Fields, fix_fields
from schuler.recording.formats.ros_messages import LAYOUTS, Messages
from schuler.recording.formats.ros_stamps import unix_ns
from schuler.recording.formats.ros_tables import gnss_table
from schuler.recording.io.hint_texts import axes_matrix
from schuler.recording.io.hints import ReadHints
from schuler.timebase import UNIX_TO_GPS_S, gps_from_unix

_PATH = Path("ROS")
_NS = 1_000_000_000
#: Parameters that are not entries of the configuration, with their defaults.
PARAMETERS: Mapping[str, Any] = {
    "config": "", "calibration": "", "state": "", "state_every_s": 60.0, "lag_s": 10.0, "output_rate_hz": 10.0,
    "imu_axes": "FLU", "map_frame": "map", "publish_tf": True,
}  # fmt: skip
_LEVELS: Mapping[Health, int] = {"ok": 0, "coasting": 1, "doubtful": 1, "aligning": 1, "failed": 2}
_SOLVED = 0  # NavSatStatus: there is a fix


@dataclass(frozen=True)
class Sending:
    """A message to be sent.

    Attributes
    ----------
    name : {"odometry", "fix", "transform"}
    stamp_ns : int
        Unix time, or that of simulated time. [ns]
    fields : dict
        Numbers by the path of the field, shape (1,) each.
    texts : dict of str to str
        Texts by the path of the field.
    """

    name: str
    stamp_ns: int
    fields: Fields
    texts: dict[str, str]


class RosRun:
    """A live run fed with messages of ROS.

    Parameters
    ----------
    parameters : mapping
        Those of :data:`PARAMETERS`, and entries of the configuration by dotted names (``imu.catalogue``), over those of
        the file that ``config`` names.

    Attributes
    ----------
    navigator : LiveNavigator
    options : dict
        Parameters that are no entries of the configuration.
    left_out : Counter
        Messages of no use, by a phrase that says why.

    Raises
    ------
    ConfigError, InputError
        If a parameter is wrong.
    """

    def __init__(self, parameters: Mapping[str, Any]) -> None:
        self.options = {**PARAMETERS, **{name: v for name, v in parameters.items() if name in PARAMETERS}}
        entries = [(name, value) for name, value in parameters.items() if "." in name]
        strange = [name for name in parameters if name not in PARAMETERS and "." not in name]
        # what every node of ROS has
        if strange := [name for name in strange if name not in ("use_sim_time", "start_type_description_service")]:
            raise InputError(
                f"parameter {strange[0]!r}: expected one of {', '.join(PARAMETERS)}, or SECTION.KEY of a configuration"
            )
        config = _config(str(self.options["config"]), entries)
        rate = float(self.options["output_rate_hz"])
        if not 0.0 < rate <= 10_000.0:
            raise InputError(f"output_rate_hz: expected solutions in a second up to 10000, got {rate:g}")
        self._interval_s = 1.0 / rate
        self._C_bs = axes_matrix(str(self.options["imu_axes"]))
        self._clock, self._next_t = SourceClock(), -math.inf
        self._origin: FloatArray | None = None
        self._frame = "imu_link"
        self._events: deque[Event] = deque(maxlen=1000)
        self.left_out: Counter[str] = Counter()
        state = Path(str(self.options["state"]))
        calibration = str(self.options["calibration"]) or None
        if self.options["state"] and state.is_file():
            self.navigator = LiveNavigator.load(state, calibration=calibration)
            if (self.navigator.config, self.navigator.lag_s) != (config, float(self.options["lag_s"])):
                raise InputError(f"{state}: it was saved with another configuration or lag_s: give those, or remove it")
            self._clock.base, self.navigator.on_event = self.navigator.time, self._events.append
        else:
            self.navigator = LiveNavigator.from_config(
                config, calibration=calibration, lag_s=float(self.options["lag_s"]), kind="rate",
                on_event=self._events.append,
            )  # fmt: skip

    def imu(self, message: Any) -> list[Sending]:
        """Take a ``sensor_msgs/Imu``; what is to be sent then."""
        t = self._time(message)
        if t is None:
            return []
        self._frame = str(message.header.frame_id) or self._frame
        rate, force = message.angular_velocity, message.linear_acceleration
        gyro, accel = np.array([rate.x, rate.y, rate.z]), np.array([force.x, force.y, force.z])
        self.navigator.take(ImuSample(t, self._C_bs @ gyro, self._C_bs @ accel))
        return self._due(t)

    def fix(self, message: Any) -> None:
        """Take a ``sensor_msgs/NavSatFix``; one without a fix or without a covariance is left out."""
        t = self._time(message)
        if t is None:
            return
        try:
            table = gnss_table(columns_of("sensor_msgs/NavSatFix", message), np.array([t]), None, _PATH, [])
        except InputError:
            self.left_out["messages of a receiver without a fix"] += 1
            return
        for fix in fix_of(table, ReadHints(), self.left_out):
            self.navigator.take(fix)

    def odometry(self, message: Any) -> None:
        """Take the forward speed of a ``nav_msgs/Odometry`` of wheels, with its variance where that is positive."""
        t = self._time(message)
        if t is None:
            return
        variance = float(message.twist.covariance[0])
        sigma = math.sqrt(variance) if variance > 0.0 else None
        self.navigator.take(Speed(t, float(message.twist.twist.linear.x), sigma))

    def diagnostics(self) -> tuple[int, str, dict[str, str]]:
        """Level (0 good, 1 warning, 2 error), sentence and numbers of a ``diagnostic_msgs/DiagnosticStatus``."""
        health, solution = self.navigator.health, self.navigator.solution()
        values: dict[str, str] = {"health": health}
        if solution is not None:
            values |= {
                "sigma_horizontal_m": f"{math.hypot(*solution.sigma_r_n[:2].tolist()):.3f}",
                "sigma_vertical_m": f"{solution.sigma_r_n[2]:.3f}",
            }  # fmt: skip
        if self.left_out:
            values["left_out"] = json.dumps(dict(self.left_out))
        return _LEVELS[health], health, values

    def events(self) -> Iterator[Event]:
        """Events since they were asked for last."""
        while self._events:
            yield self._events.popleft()

    def save(self) -> None:
        """Save the run where ``state`` says, if it does."""
        if self.options["state"]:
            self.navigator.time = self._clock.base
            self.navigator.save(Path(str(self.options["state"])))

    def _time(self, message: Any) -> float | None:
        """Time of a message on the axis of the run; none, and counted, if its stamp is none. [s]"""
        ns = stamp_of(message)
        if ns <= 0:
            self.left_out["messages without a stamp"] += 1
            return None
        try:
            return self._seconds(ns)
        except InputError:
            self.left_out["messages on another clock than those before"] += 1
            return None

    def _seconds(self, ns: int) -> float:
        """Time on the axis of the run of a stamp: Unix time, else simulated time or that since boot. [s]"""
        if ns < int(UNIX_TO_GPS_S) * _NS:
            return self._clock.local(ns / _NS)
        leaps = round(float(gps_from_unix(np.array([ns / _NS]))[0]) - (ns / _NS - UNIX_TO_GPS_S))
        gps_ns = ns - int(UNIX_TO_GPS_S) * _NS + leaps * _NS
        return (gps_ns - round(self._clock.epoch_of(float(gps_ns // _NS))) * _NS) / _NS

    def _due(self, t: float) -> list[Sending]:
        if self._next_t - 2.0 * self._interval_s <= t < self._next_t - 1e-6 * self._interval_s:
            return []
        self._next_t = (math.floor(t / self._interval_s + 1e-6) + 1.0) * self._interval_s
        solution = self.navigator.solution()
        return [] if solution is None else self._sendings(solution)

    def _sendings(self, solution: Solution) -> list[Sending]:
        assert self._clock.base is not None
        ns = int(unix_ns(np.array([solution.t]), self._clock.base, "live")[0])
        if self._origin is None:
            self._origin = solution.llh
        map_frame = str(self.options["map_frame"])
        pose = odometry_of(solution, self._origin)
        frame = {"header.frame_id": map_frame, "child_frame_id": self._frame}
        cov = np.diag(solution.sigma_r_n**2)[None]
        fields = fix_fields(solution.llh[None], cov, [0]) | {"status.status": [_SOLVED]}
        made = [
            Sending("odometry", ns, pose, frame), Sending("fix", ns, fields, {"header.frame_id": self._frame}),
        ]  # fmt: skip
        if self.options["publish_tf"]:
            parts = {"pose.pose.position": "transform.translation", "pose.pose.orientation": "transform.rotation"}
            moved = {
                f"{parts[path.rpartition('.')[0]]}.{path[-1]}": value
                for path, value in pose.items()
                if path.rpartition(".")[0] in parts
            }
            made.append(Sending("transform", ns, moved, frame))
        return made


def columns_of(kind: str, message: Any) -> Messages:
    """Columns of one message of a type of ROS, by the names of its fields. Shape (1,) each."""
    values: dict[str, np.ndarray[Any, np.dtype[Any]]] = {}
    for path, form in LAYOUTS[kind]:
        if form not in ("header", "string"):
            values[path] = np.array([_at(message, path)], dtype=form)
    ns = np.array([stamp_of(message)], dtype=np.int64)
    return Messages(ns, ns, values, {})


def stamp_of(message: Any) -> int:
    """Stamp of a message's header. [ns]"""
    stamp = message.header.stamp
    return int(stamp.sec) * _NS + int(stamp.nanosec)


def fill(message: Any, sending: Sending) -> Any:
    """Fill a message of ROS with what is to be sent, and return it."""
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(sending.stamp_ns, _NS)
    numbers = {path: np.asarray(value).reshape(-1)[0].item() for path, value in sending.fields.items()}
    for path, value in (numbers | sending.texts).items():
        *parents, last = path.split(".")
        place = message
        for name in parents:
            place = getattr(place, name)
        if last.isdecimal():
            place[int(last)] = value
        else:
            # fields of ROS are typed: a number given as whole may be one of float64
            setattr(place, last, float(value) if isinstance(getattr(place, last), float) else value)
    return message


def _at(message: Any, path: str) -> Any:
    for name in path.split("."):
        message = message[int(name)] if name.isdecimal() else getattr(message, name)
    return message


def _config(path: str, entries: list[tuple[str, Any]]) -> NavigationConfig:
    if path:
        return NavigationConfig.load(path, entries)
    data: dict[str, Any] = {}
    for key, value in entries:
        change_entry(data, key, value)
    return NavigationConfig.checked(data)
