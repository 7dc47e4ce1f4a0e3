"""What comes and goes in a live run as messages on topics: types of ROS 2, and JSON for what they have no word for."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from schuler import frames, rotation
from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.live.messages import (
    Broadcast,
    Event,
    Fix,
    Heading,
    Height,
    ImuBlock,
    ImuSample,
    Message,
    SatelliteEpoch,
    Solution,
    Speed,
)
from schuler.live.sentences import columns_of, json_of
from schuler.recording.formats.ros_fields import (
    Fields,
    fix_fields,
    imu_fields,
    odometry_covariances,
    odometry_fields,
    speed_fields,
    velocity_fields,
)
from schuler.recording.formats.ros_messages import encode
from schuler.recording.formats.ros_recording import OWN_FORMAT, OWN_TOPIC, TOPICS
from schuler.recording.formats.ros_stamps import unix_ns
from schuler.recording.series import Kind
from schuler.timebase import TimeBase

#: Types in JSON, by the names under which Foxglove knows them or of our own, and their members.
JSON_TYPES = {
    "foxglove.LocationFix": {
        "timestamp": "object", "frame_id": "string", "latitude": "number", "longitude": "number", "altitude": "number",
        "position_covariance": "array", "position_covariance_type": "integer",
    },
    "foxglove.Log": {
        "timestamp": "object", "level": "integer", "message": "string", "name": "string", "file": "string",
        "line": "integer",
    },
    "schuler.Solution": {},
    "schuler.Reading": {"t_s": "number", "value": "number", "sigma": "number"},
}  # fmt: skip
_TWIST = "geometry_msgs/TwistWithCovarianceStamped"
#: Topics and their types; the bytes of each source have one more, ``/source/1``, ...
KINDS = {
    OWN_TOPIC: "std_msgs/String", TOPICS["imu"]: "sensor_msgs/Imu", TOPICS["gnss"]: "sensor_msgs/NavSatFix",
    TOPICS["velocity"]: _TWIST, TOPICS["odometer"]: _TWIST, "/heading": "schuler.Reading", "/height": "schuler.Reading",
    "/schuler/solution": "schuler.Solution", "/schuler/smoothed": "schuler.Solution",
    "/schuler/location": "foxglove.LocationFix", "/schuler/odometry": "nav_msgs/Odometry",
    "/schuler/events": "foxglove.Log",
}  # fmt: skip
RAW = ""  # type of bytes as they came
_LEVELS = {"health": 3, "decoder": 3, "late": 3, "clock": 3}  # of foxglove.Log: warnings; others are information
_KNOWN = 3  # position_covariance_type: all of it is given
_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Bytes:
    """Bytes of the k-th source as they came."""

    source: int
    data: bytes


@dataclass(frozen=True, slots=True)
class Post:
    """One message on a topic.

    Attributes
    ----------
    topic : str
    stamp_ns : int
        Its own time: Unix time with GPS time, else seconds of its clock; 0 if it has none. [ns]
    data : bytes
    """

    topic: str
    stamp_ns: int
    data: bytes

    @property
    def kind(self) -> str:
        """Type: of ROS (``sensor_msgs/Imu``, in CDR), one of :data:`JSON_TYPES`, or :data:`RAW`."""
        return KINDS.get(self.topic, RAW)


Item = Message | Solution | Event | Bytes


class Topics:
    """Posts of what comes and goes.

    The odometry is of the first solution's place: its axes are east, north, up there.

    Parameters
    ----------
    kind : {"rate", "increment"}
        Of the IMU; increments are posted as mean rates at the middle of their intervals.
    """

    def __init__(self, kind: Kind) -> None:
        self._kind = kind
        self._last_t = math.nan
        self._origin: FloatArray | None = None
        self._begun = False

    def posts(self, item: Item, base: TimeBase | None) -> Iterator[Post]:
        """Posts of an item; what has no possible stamp has none.

        Parameters
        ----------
        item : Message, Solution, Event or Bytes
        base : TimeBase or None
            Of its time.
        """
        if isinstance(item, Bytes):
            yield Post(f"/source/{item.source + 1}", 0, item.data)
            return
        if isinstance(item, Event):
            stamp = _stamp(item.t, base)
            level = _LEVELS.get(item.kind, 2)
            yield _json("/schuler/events", stamp, level=level, message=item.text, name=item.kind, file="", line=0)
            return
        if base is None:
            return
        t = item.t if isinstance(item, ImuBlock) else np.array([item.t])
        try:
            with np.errstate(invalid="ignore"):
                ns = unix_ns(t, base, "live") if np.isfinite(t).all() else None
        except InputError:  # a stamp that is none, for the navigator to say
            ns = None
        if ns is None or not len(ns):
            return
        if not self._begun:
            self._begun = True
            document: dict[str, Any] = {
                "format": OWN_FORMAT,
                "time": base.scale,
                "name": "live",
                "origin": None,
                "notes": [],
            }
            text = {"data": json.dumps(document)}
            yield Post(OWN_TOPIC, int(ns[0]), encode(KINDS[OWN_TOPIC], ns[:1], {}, text)[0])
        if isinstance(item, Solution):
            yield from self._solution(item, ns, base)
        elif isinstance(item, ImuSample | ImuBlock):
            yield from self._imu(item, t, ns)
        elif not isinstance(item, SatelliteEpoch | Broadcast):  # their bytes are there
            yield from _measurement(item, ns)

    def _imu(self, item: ImuSample | ImuBlock, t: FloatArray, ns: Any) -> Iterator[Post]:
        gyro, accel = np.atleast_2d(item.gyro), np.atleast_2d(item.accel)
        if self._kind == "increment":
            dt = np.diff(t, prepend=self._last_t)
            self._last_t = float(t[-1])
            good = dt > 0.0
            dt, ns = dt[good], ns[good] - np.round(0.5e9 * dt[good]).astype(np.int64)
            gyro, accel = gyro[good] / dt[:, None], accel[good] / dt[:, None]
        yield from _ros(TOPICS["imu"], ns, imu_fields(gyro, accel), "imu_link")

    def _solution(self, solution: Solution, ns: Any, base: TimeBase) -> Iterator[Post]:
        data = json_of(solution, base).encode()
        if solution.smoother_lag_s:
            yield Post("/schuler/smoothed", int(ns[0]), data)
            return
        yield Post("/schuler/solution", int(ns[0]), data)
        if self._origin is None:
            self._origin = solution.llh
        columns = columns_of(solution)
        north, east, down = (solution.sigma_r_n**2).tolist()
        yield _json(
            "/schuler/location", int(ns[0]), frame_id="imu_link", latitude=columns["lat_deg"],
            longitude=columns["lon_deg"], altitude=columns["height_m"],
            position_covariance=[east, 0, 0, 0, north, 0, 0, 0, down], position_covariance_type=_KNOWN,
        )  # fmt: skip
        fields = odometry_of(solution, self._origin)
        yield from _ros("/schuler/odometry", ns, fields, "map", child_frame_id="imu_link")


def odometry_of(solution: Solution, origin: FloatArray) -> Fields:
    """Fields of ``nav_msgs/Odometry`` of a solution, with its 1-sigmas; shape (1,) each.

    Parameters
    ----------
    solution : Solution
    origin : ndarray, shape (3,)
        Latitude, longitude [rad], height [m] of the place whose east, north and up are the axes of the pose.
    """
    r = frames.ned_from_ecef(frames.ecef_from_llh(solution.llh[None]), origin)
    C_on = frames.C_en(origin).T @ frames.C_en(solution.llh)
    C_ob = (C_on @ rotation.dcm_from_rpy(solution.rpy_nb))[None]
    sigmas = (solution.sigma_r_n, solution.sigma_psi_n, solution.sigma_v_n)
    cov_r, cov_psi, cov_v = ((C_on * sigma**2 @ C_on.T)[None] for sigma in sigmas)
    return odometry_fields(r, C_ob, (C_on @ solution.v_eb_n)[None]) | odometry_covariances(cov_r, cov_psi, cov_v, C_ob)


def _measurement(item: Fix | Speed | Heading | Height, ns: Any) -> Iterator[Post]:
    if isinstance(item, Fix):
        fields = fix_fields(item.llh[None], item.cov_r_n[None], [item.quality or 0])
        yield from _ros(TOPICS["gnss"], ns, fields, "gnss_link")
        if item.v_n is not None and item.cov_v_n is not None:
            fields = velocity_fields(item.v_n[None], item.cov_v_n[None])
            yield from _ros(TOPICS["velocity"], ns, fields, "enu")
    elif isinstance(item, Speed):
        sigma = np.array([0.0 if item.sigma is None else item.sigma])
        yield from _ros(TOPICS["odometer"], ns, speed_fields(np.array([item.speed]), sigma), "base_link")
    else:
        topic = "/heading" if isinstance(item, Heading) else "/height"
        body = {"t_s": item.t, "value": item.value, "sigma": item.sigma}
        yield Post(topic, int(ns[0]), json.dumps(_finite(body)).encode())


def _ros(topic: str, ns: Any, fields: Fields, frame: str, **texts: str) -> Iterator[Post]:
    with np.errstate(over="ignore"):
        encoded = encode(KINDS[topic], ns, fields, {"header.frame_id": frame, **texts})
    for stamp, data in zip(ns.tolist(), encoded, strict=True):
        yield Post(topic, stamp, data)


def _json(topic: str, stamp_ns: int, **members: Any) -> Post:
    sec, nsec = divmod(stamp_ns, _NS)
    body = {"timestamp": {"sec": sec, "nsec": nsec}, **members}
    return Post(topic, stamp_ns, json.dumps(_finite(body)).encode())


def _finite(body: dict[str, Any]) -> dict[str, Any]:
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in body.items()}


def _stamp(t: float, base: TimeBase | None) -> int:
    try:
        return 0 if base is None or not math.isfinite(t) else int(unix_ns(np.array([t]), base, "live")[0])
    except InputError:
        return 0
