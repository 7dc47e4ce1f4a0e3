"""A recording of ROS topics: inertial measurements, fixes with their velocity, poses as reference, wheel speed.

Conventions of ROS (REP 103, 105, 145): bodies forward-left-up, local frames east-north-up, quaternions with the scalar
last that turn body to local axes, acceleration as specific force, stamps in Unix time.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.formats.ros_messages import LAYOUTS, Encoding, Messages, decode
from schuler.recording.formats.ros_tables import gnss_table, imu_table, odometer_table, reference_table
from schuler.recording.io import parts
from schuler.recording.io.hint_texts import parse_origin, parse_streams
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.parts import Table
from schuler.recording.io.streams import Stream, choose, stream_of
from schuler.recording.recording import Recording
from schuler.timebase import UNIX_TO_GPS_S, WEEK_S, TimeBase, gps_from_unix

#: Part of a recording that the messages of a type can be.
PARTS = {
    "sensor_msgs/Imu": "imu",
    "sensor_msgs/NavSatFix": "gnss",
    "nav_msgs/Odometry": "reference",
    "geometry_msgs/PoseStamped": "reference",
    "geometry_msgs/PoseWithCovarianceStamped": "reference",
    "geometry_msgs/TransformStamped": "reference",
    "geometry_msgs/TwistStamped": "velocity",
    "geometry_msgs/TwistWithCovarianceStamped": "velocity",
}
#: Topic on which our own bags say what ROS messages cannot, as JSON in a std_msgs/String.
OWN_TOPIC, OWN_FORMAT = "/schuler", "schuler/bag/1"
#: Topics of our own bags by part.
TOPICS = {
    "imu": "/imu/data", "gnss": "/gnss/fix", "velocity": "/gnss/velocity", "reference": "/reference/odometry",
    "odometer": "/odometer",
}  # fmt: skip
_HINTS = parts.GNSS_HINTS | {"axes", "streams", "origin", "time", "sigma_speed"}
_NS = 1_000_000_000


@dataclass
class Topic:
    """Messages of one topic as they stand in a bag.

    Attributes
    ----------
    name, kind : str
        Topic, and type as ``package/Type``.
    encoding : str
        "cdr", "ros1", "json", or another that is not read.
    wanted : bool
        Whether the messages are kept.
    raw : list of bytes
    log_ns : list of int
        Times of recording. [ns]
    other : int
        Number of messages that were not looked at.
    """

    name: str
    kind: str
    encoding: str
    wanted: bool
    raw: list[bytes] = field(default_factory=list)
    log_ns: list[int] = field(default_factory=list)
    other: int = 0

    def decoded(self, path: Path) -> Messages:
        """Columns of the messages."""
        encoding: Encoding = self.encoding  # type: ignore[assignment]
        return decode(self.kind, self.raw, self.log_ns, encoding, self.name, path)


def streams_of(path: Path, topics: Iterable[Topic]) -> list[Stream]:
    """Streams of topics, on the stamps of their headers where they are read, else the times of recording."""
    streams = []
    for topic in topics:
        part = PARTS.get(topic.kind, "") if topic.wanted else ""
        if topic.raw and topic.kind in LAYOUTS:
            ns = topic.decoded(path).stamp_ns
            ns = ns if ns.any() else np.asarray(topic.log_ns, dtype=np.int64)
        else:
            ns = np.asarray(topic.log_ns, dtype=np.int64)
        if len(ns):
            streams.append(stream_of(topic.name, topic.kind, ns / _NS, part))
        else:
            streams.append(Stream(topic.name, topic.kind, topic.other, part=part))
    return sorted(streams, key=lambda s: s.name)


def recording_of(
    path: Path,
    topics: list[Topic],
    hints: ReadHints,
    notes: list[str],
    what: str,
    sources: Iterable[Path] | None = None,
) -> Recording:
    """Recording of the topics of a bag.

    Parameters
    ----------
    path : Path
    topics : list of Topic
    hints : ReadHints
        ``streams`` chooses topics for ``imu``, ``gnss``, ``velocity`` (of GNSS, east-north-up), ``reference`` (poses)
        and ``odometer`` (forward speed of a twist). An only IMU and an only fix topic are taken unasked. A reference
        needs ``origin``. ``axes`` if the IMU's are not forward-left-up; ``time`` "local" or "gps-unix" if stamps are
        not Unix time; hints of GNSS logs.
    notes : list of str
        Stamps of the container.
    what : str
        For messages.
    sources : iterable of Path, optional
        Files that were read.

    Raises
    ------
    FileFormatError, InputError
        If no topic can be read, several could be meant, or values are impossible.
    """
    parts.check_hints(path, hints, _HINTS, what)
    chosen = parse_streams(hints.streams)
    own = _own_document(path, topics)
    by_name = {topic.name: topic for topic in topics if topic.wanted and topic.raw}  # a channel may be empty
    if own is not None:
        chosen = {**{part: name for part, name in TOPICS.items() if name in by_name}, **chosen}
    available = _available(topics, chosen)
    taken: dict[str, Messages] = {}
    for part in ("imu", "gnss", "velocity", "reference", "odometer"):
        stream = choose(available[part], part, chosen, alone=part in ("imu", "gnss"))
        if stream is None:
            continue
        messages = by_name[stream.name].decoded(path)
        frame = "/".join(messages.texts.get("header.frame_id", []))
        notes.append(f"{part}: {stream.name} ({stream.kind}{f', frame {frame}' if frame else ''}).")
        taken[part] = messages
    left = [s for s in available["reference"] if "reference" not in chosen and "reference" not in taken]
    if left:
        names = ", ".join(f"{s.name} ({s.kind})" for s in left)
        notes.append(f"Poses were not read: {names}; streams='reference=...' with origin=... takes one as reference.")
    if not set(taken) & {"imu", "gnss", "reference", "odometer"}:
        listing = ", ".join(f"{t.name} ({t.kind}, {t.encoding})" for t in topics) or "none"
        raise FileFormatError(f"no topic of an IMU, of fixes or of a chosen reference; topics: {listing}", path)
    seconds, base = _times(taken, hints.time or ("local" if own and own["time"] == "local" else None), notes)
    tables: dict[str, Table] = {}
    if "imu" in taken:
        tables["imu"] = imu_table(taken["imu"], seconds["imu"], path, notes, hints)
    if "gnss" in taken:
        velocity = (taken["velocity"], seconds["velocity"]) if "velocity" in taken else None
        tables["gnss"] = gnss_table(taken["gnss"], seconds["gnss"], velocity, path, notes)
    elif "velocity" in taken:
        raise InputError(f"{path}: streams names a velocity, but there are no fixes to go with it")
    if "reference" in taken:
        origin = parse_origin(hints.origin) or (None if own is None else own["origin"])
        if origin is None:
            raise InputError(f"{path}: poses are in a local frame: say where its zero is, origin='LAT,LON,HEIGHT'")
        tables["reference"] = reference_table(taken["reference"], seconds["reference"], origin, path, notes)
    if "odometer" in taken:
        tables["odometer"] = odometer_table(taken["odometer"], seconds["odometer"], path, notes, hints)
    return parts.assemble(path, tables, hints, base, notes, sources)


def _available(topics: list[Topic], chosen: dict[str, str | None]) -> dict[str, list[Stream]]:
    """Candidates of each part; a twist can be the velocity of the fixes or, if named so, an odometer."""
    plain = [Stream(t.name, t.kind, len(t.raw), part=PARTS.get(t.kind, "")) for t in topics if t.wanted]
    plain += [Stream(t.name, t.kind, len(t.log_ns) or t.other) for t in topics if not t.wanted]
    by_part = {part: [s for s in plain if s.part == part] for part in ("imu", "gnss", "velocity", "reference")}
    speeds = [*by_part["velocity"], *(s for s in plain if s.kind == "nav_msgs/Odometry")]
    by_part["odometer"] = [Stream(s.name, s.kind, s.count, part="odometer") for s in speeds]
    for part in by_part:
        if part in chosen:  # names the wrong topic: the message shows what it is
            by_part[part] += [Stream(s.name, s.kind, s.count) for s in plain if s not in by_part[part]]
    return by_part


def _own_document(path: Path, topics: list[Topic]) -> dict[str, Any] | None:
    """Metadata of a bag written by this package; ``None`` for others."""
    for topic in topics:
        if topic.name == OWN_TOPIC and topic.kind == "std_msgs/String" and topic.raw:
            texts = topic.decoded(path).texts.get("data", [])
            try:
                document = json.loads(texts[0])
                if document["format"] == OWN_FORMAT:
                    origin = document.get("origin")
                    return {
                        "time": str(document["time"]),
                        "origin": None if origin is None else tuple(map(float, origin)),
                    }
            except (ValueError, KeyError, IndexError, TypeError, RecursionError) as error:
                raise FileFormatError(f"{OWN_TOPIC}: what schuler wrote there is damaged ({error!r})", path) from error
    return None


def _times(taken: dict[str, Messages], stated: str | None, notes: list[str]) -> tuple[dict[str, FloatArray], TimeBase]:
    """Seconds of the messages of each part on one time base."""
    ns = {}
    for part, messages in taken.items():
        ns[part] = messages.stamp_ns
        if not messages.stamp_ns.any():
            ns[part] = messages.log_ns
            notes.append(f"{part}: the headers have no stamps; the times of recording were taken, with their jitter.")
    first = min(int(values.min()) for values in ns.values())
    kind = stated or ("unix" if first >= UNIX_TO_GPS_S * _NS else "local")
    if kind not in ("unix", "utc-unix", "gps-unix", "local"):
        raise InputError(f"time: stamps of ROS are unix, gps-unix or local, got {stated!r}")
    if kind == "local":
        zero = first // _NS * _NS if first >= UNIX_TO_GPS_S * _NS else 0
        if stated is None:
            notes.append("Stamps are no Unix time (simulated time, or since boot); taken as the log's own clock.")
        elif zero:
            notes.append(f"{zero // _NS} s were taken off all stamps.")
        return {part: (values - zero) / _NS for part, values in ns.items()}, TimeBase("local")
    if first < UNIX_TO_GPS_S * _NS:
        raise InputError(f"stamps start at {first / _NS:.3f} s, before GPS time began: say time='local'")
    leaps = {part: np.zeros(len(values), dtype=np.int64) for part, values in ns.items()}
    if kind != "gps-unix":
        leaps = {
            p: np.round(gps_from_unix(v / _NS) - (v / _NS - UNIX_TO_GPS_S)).astype(np.int64) for p, v in ns.items()
        }
        most = max(int(values.max()) for values in leaps.values())
        notes.append(f"Unix (UTC) stamps were turned to GPS time; {most} leap seconds were added.")
    gps = {part: values - int(UNIX_TO_GPS_S) * _NS + leaps[part] * _NS for part, values in ns.items()}
    start = min(int(values.min()) for values in gps.values()) // (int(WEEK_S) * _NS) * int(WEEK_S)
    return {part: (values - start * _NS) / _NS for part, values in gps.items()}, TimeBase("gps", float(start))
