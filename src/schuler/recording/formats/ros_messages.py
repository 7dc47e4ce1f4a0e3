"""Layouts of the ROS messages that are read, and their columns out of many messages at once.

The types are fixed by ROS, so the definitions that bags carry are not compiled: a file never runs code. Messages that
differ in nothing but their numbers are one NumPy record array; they are serialised as CDR (ROS 2, OMG DDS-RTPS 10.2,
"plain CDR": every number aligned to its size behind the four bytes of encapsulation) or as ROS 1 does (packed).
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from schuler.exceptions import FileFormatError

Encoding = Literal["cdr", "ros1", "json"]

_XYZ, _XYZW = ("x", "y", "z"), ("x", "y", "z", "w")
_COV6 = 36


def _triple(path: str) -> list[tuple[str, str]]:
    return [(f"{path}.{axis}", "<f8") for axis in _XYZ]


def _quaternion(path: str) -> list[tuple[str, str]]:
    return [(f"{path}.{axis}", "<f8") for axis in _XYZW]


def _array(path: str, n: int) -> list[tuple[str, str]]:
    return [(f"{path}.{k}", "<f8") for k in range(n)]


_HEADER = [("header", "header")]
_POSE = [*_triple("position"), *_quaternion("orientation")]
_TWIST = [*_triple("linear"), *_triple("angular")]


def _under(prefix: str, fields: list[tuple[str, str]]) -> list[tuple[str, str]]:
    return [(f"{prefix}.{name}", kind) for name, kind in fields]


#: Fields of each type in order: name, and a NumPy type, ``header`` or ``string``.
LAYOUTS: dict[str, list[tuple[str, str]]] = {
    "sensor_msgs/Imu": [
        *_HEADER, *_quaternion("orientation"), *_array("orientation_covariance", 9), *_triple("angular_velocity"),
        *_array("angular_velocity_covariance", 9), *_triple("linear_acceleration"),
        *_array("linear_acceleration_covariance", 9),
    ],
    "sensor_msgs/NavSatFix": [
        *_HEADER, ("status.status", "i1"), ("status.service", "<u2"), ("latitude", "<f8"), ("longitude", "<f8"),
        ("altitude", "<f8"), *_array("position_covariance", 9), ("position_covariance_type", "u1"),
    ],
    "nav_msgs/Odometry": [
        *_HEADER, ("child_frame_id", "string"), *_under("pose.pose", _POSE), *_array("pose.covariance", _COV6),
        *_under("twist.twist", _TWIST), *_array("twist.covariance", _COV6),
    ],
    "geometry_msgs/PoseStamped": [*_HEADER, *_under("pose", _POSE)],
    "geometry_msgs/PoseWithCovarianceStamped": [
        *_HEADER, *_under("pose.pose", _POSE), *_array("pose.covariance", _COV6),
    ],
    "geometry_msgs/TransformStamped": [
        *_HEADER, ("child_frame_id", "string"), *_triple("transform.translation"), *_quaternion("transform.rotation"),
    ],
    "geometry_msgs/TwistStamped": [*_HEADER, *_under("twist", _TWIST)],
    "geometry_msgs/TwistWithCovarianceStamped": [
        *_HEADER, *_under("twist.twist", _TWIST), *_array("twist.covariance", _COV6),
    ],
    "std_msgs/String": [("data", "string")],
}  # fmt: skip


@dataclass(frozen=True)
class Messages:
    """Columns of the messages of one topic.

    Attributes
    ----------
    stamp_ns : ndarray of int64, shape (n,)
        Stamps of the header; the time of recording if the type has none. [ns]
    log_ns : ndarray of int64, shape (n,)
        When the message was recorded. [ns]
    values : dict of str to ndarray, shape (n,)
        Numbers by the path of the field, ``"angular_velocity.x"``.
    texts : dict of str to list of str
        Different values of each text field, in order of appearance.
    """

    stamp_ns: np.ndarray[Any, np.dtype[np.int64]]
    log_ns: np.ndarray[Any, np.dtype[np.int64]]
    values: dict[str, np.ndarray[Any, np.dtype[Any]]]
    texts: dict[str, list[str]]

    def stack(self, path: str, keys: Sequence[str | int] = _XYZ) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Columns ``path.key`` side by side. Shape (n, len(keys))."""
        return np.stack([self.values[f"{path}.{key}"] for key in keys], axis=1).astype(np.float64)


def plain_type(name: str) -> str:
    """``sensor_msgs/Imu`` of ``sensor_msgs/msg/Imu``."""
    return name.replace("/msg/", "/")


def decode(
    kind: str, raw: Sequence[bytes], log_ns: Sequence[int], encoding: Encoding, topic: str, path: Path
) -> Messages:
    """Columns of the serialised messages of one topic.

    Parameters
    ----------
    kind : str
        Type, one of :data:`LAYOUTS`.
    raw : sequence of bytes
    log_ns : sequence of int
        [ns]
    encoding : {"cdr", "ros1", "json"}
    topic : str
    path : Path
        For messages.

    Raises
    ------
    FileFormatError
        At the first message that is not of the layout of its type.
    """
    layout = LAYOUTS[kind]
    try:
        logged = np.asarray(log_ns, dtype=np.int64)
    except (TypeError, OverflowError, ValueError):  # of a damaged table
        text = f"{topic}: a message has no time at which it was logged; is the bag damaged?"
        raise FileFormatError(text, path) from None
    if encoding == "json":
        return _decode_json(layout, raw, logged, topic, path)
    groups: dict[tuple[int, ...], list[int]] = {}
    for k, data in enumerate(raw):
        try:
            key = (len(data), *_string_lengths(layout, data, encoding))
        except (struct.error, ValueError) as error:
            raise _fault(topic, k, kind, len(data), path) from error
        groups.setdefault(key, []).append(k)
    n = len(raw)
    stamps = np.zeros(n, dtype=np.int64)
    columns: dict[str, np.ndarray[Any, np.dtype[Any]]] = {
        name: np.empty(n, dtype=form) for name, form in layout if form not in ("header", "string")
    }
    texts: dict[str, list[str]] = {}
    has_header = layout[0][1] == "header"
    for key, rows in groups.items():
        dtype, size = _record(layout, key[1:], encoding)
        if size > key[0] or key[0] - size > 8:  # padding at the end is allowed
            raise _fault(topic, rows[0], kind, key[0], path)
        blob = b"".join(raw[k][:size] for k in rows)
        table = np.frombuffer(blob, dtype=dtype)
        for name in columns:
            columns[name][rows] = table[name]
        if has_header:
            stamps[rows] = table["sec"].astype(np.int64) * 1_000_000_000 + table["nanosec"]
        for name in dtype.names or ():
            if name.startswith("text "):
                texts_of = texts.setdefault(name.removeprefix("text "), [])
                for value in np.unique(table[name]):
                    text = bytes(value).rstrip(b"\x00").decode("utf-8", "replace")
                    if text not in texts_of:
                        texts_of.append(text)
    return Messages(stamps if has_header else logged, logged, columns, texts)


def encode(
    kind: str, stamp_ns: np.ndarray[Any, np.dtype[np.int64]], values: dict[str, Any], texts: dict[str, str]
) -> list[bytes]:
    """Messages of a type in CDR (little endian), one for each stamp; fields that are not given are zero.

    Parameters
    ----------
    kind : str
    stamp_ns : ndarray of int64, shape (n,)
        [ns]
    values : dict
        Numbers by the path of the field, shape (n,) or one for all.
    texts : dict
        Text fields; the header's is ``header.frame_id``.
    """
    layout = LAYOUTS[kind]
    written = {name: text.encode() + b"\x00" for name, text in texts.items()}
    names = ["header.frame_id" if form == "header" else name for name, form in layout if form in ("header", "string")]
    dtype, size = _record(layout, tuple(len(written[name]) for name in names), "cdr")
    table = np.zeros(len(stamp_ns), dtype=dtype)
    raw = table.view(np.uint8).reshape(len(stamp_ns), size)
    raw[:, :4] = (0, 1, 0, 0)  # encapsulation: CDR, little endian
    if layout[0][1] == "header":
        table["sec"], table["nanosec"] = np.divmod(stamp_ns, 1_000_000_000)
    for name in names:
        table[f"length {name}"], table[f"text {name}"] = len(written[name]), written[name]
    for name, value in values.items():
        table[name] = value
    blob = table.tobytes()
    return [blob[k * size : (k + 1) * size] for k in range(len(stamp_ns))]


def _string_lengths(layout: list[tuple[str, str]], data: bytes, encoding: Encoding) -> list[int]:
    """Lengths of the texts of a message, which are at its beginning in all types read."""
    if encoding == "cdr":
        if data[:2] != b"\x00\x01":
            raise ValueError("not plain little-endian CDR")
        at = 4
    else:
        at = 0
    lengths = []
    for _, form in layout:
        if form == "header":
            at += 8 if encoding == "cdr" else 12
        elif form != "string":
            break
        at += -at % 4 if encoding == "cdr" else 0
        (length,) = struct.unpack_from("<I", data, at)
        at += 4 + length
        if at > len(data):
            raise ValueError("a text reaches beyond the message")
        lengths.append(length)
    return lengths


def _record(layout: list[tuple[str, str]], lengths: Sequence[int], encoding: Encoding) -> tuple[np.dtype[Any], int]:
    """NumPy type of messages whose texts have these lengths, and their size. [byte]"""
    names: list[str] = []
    formats: list[str] = []
    offsets: list[int] = []
    at = 4 if encoding == "cdr" else 0
    left = list(lengths)

    def add(name: str, form: str) -> None:
        nonlocal at
        size = np.dtype(form).itemsize
        if encoding == "cdr" and not form.startswith("S"):
            at += -(at - 4) % size
        names.append(name)
        formats.append(form)
        offsets.append(at)
        at += size

    for name, form in layout:
        if form in ("header", "string"):
            text = "header.frame_id" if form == "header" else name
            if form == "header":
                if encoding == "ros1":
                    add("seq", "<u4")
                add("sec", "<i4" if encoding == "cdr" else "<u4")
                add("nanosec", "<u4")
            add(f"length {text}", "<u4")
            if length := left.pop(0):
                add(f"text {text}", f"S{length}")
        else:
            add(name, form)
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": at}), at


def _decode_json(layout: list[tuple[str, str]], raw: Sequence[bytes], logged: Any, topic: str, path: Path) -> Messages:
    columns = {name: np.zeros(len(raw)) for name, form in layout if form not in ("header", "string")}
    stamps, texts = np.zeros(len(raw), dtype=np.int64), dict[str, list[str]]()
    for k, data in enumerate(raw):
        try:
            message = json.loads(data)
            for name, form in layout:
                if form == "header":
                    stamp = message["header"]["stamp"]
                    nanoseconds = next(stamp[key] for key in ("nanosec", "nsec", "nsecs") if key in stamp)
                    stamps[k] = int(stamp["sec"] if "sec" in stamp else stamp["secs"]) * 1_000_000_000 + int(
                        nanoseconds
                    )
                elif form == "string":
                    text = str(message.get(name, ""))
                    if text not in texts.setdefault(name, []):
                        texts[name].append(text)
                else:
                    columns[name][k] = float(_at(message, name))
        except (ValueError, KeyError, IndexError, TypeError, StopIteration, OverflowError, RecursionError) as error:
            raise FileFormatError(
                f"{topic}: message {k + 1} is not the JSON its type calls for ({error})", path
            ) from error
    has_header = layout[0][1] == "header"
    return Messages(stamps if has_header else logged, logged, columns, texts)


def _at(message: Any, path: str) -> Any:
    for key in path.split("."):
        message = message[int(key)] if isinstance(message, list) else message[key]
    return message


def _fault(topic: str, k: int, kind: str, size: int, path: Path) -> FileFormatError:
    return FileFormatError(
        f"{topic}: message {k + 1} of {size} bytes is no {kind} as ROS defines it: the file is damaged, or the type is "
        "one of the logger's own",
        path,
    )
