"""Recordings as bags of ROS 2 and as MCAP files, for RViz, Foxglove, PlotJuggler and filters that run under ROS."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from schuler import files, frames, rotation, units
from schuler.exceptions import InputError
from schuler.recording.formats.registry import needs
from schuler.recording.formats.ros_messages import encode
from schuler.recording.formats.ros_recording import OWN_FORMAT, OWN_TOPIC, TOPICS
from schuler.recording.formats.ros_tables import ENU, FLU
from schuler.recording.recording import Recording
from schuler.timebase import UNIX_TO_GPS_S, calendar, gps_from_calendar, leap_days

#: Parts of a recording that are written.
HELD = ("imu", "gnss", "reference", "odometer")
_STATUS = {1: 2, 2: 2, 3: 1, 4: 2, 5: 0, 6: 0, 7: 0}  # NavSatStatus of our qualities
_NS = 1_000_000_000
_MOST_NS = 9.2e18  # of 63 bits [ns]
_Bag = list[tuple[str, str, np.ndarray[Any, np.dtype[np.int64]], list[bytes]]]


def write_mcap(recording: Recording, path: Path) -> list[Path]:
    """Write one MCAP file of ROS 2 messages.

    Returns
    -------
    list of Path
        The file.

    Raises
    ------
    InputError
        If there is nothing that is written, or times are before 1970.
    MissingExtraError
        Without rosbags.

    Notes
    -----
    Topics: ``/imu/data`` (rates, forward-left-up; increments as mean rates in the middle of their intervals),
    ``/gnss/fix`` and ``/gnss/velocity`` (east-north-up), ``/odometer``, ``/reference/odometry`` (poses east-north-up
    about the reference's first position, which ``/schuler`` names). Stamps are Unix time (UTC) if the recording knows
    its date, else its own clock. Not kept are the number of satellites, the kind of fix beyond NavSatStatus,
    temperatures, and what is not named here.
    """
    with files.replacing(path) as temporary, files.temporary_folder(temporary.parent) as folder:
        _write(recording, folder / "bag", "mcap")
        (made,) = (folder / "bag").glob("*.mcap")
        os.replace(made, temporary)
    return [Path(path)]


def write_bag(recording: Recording, path: Path, storage: str = "sqlite3") -> list[Path]:
    """Write a bag of ROS 2, which is a folder.

    Parameters
    ----------
    recording : Recording
    path : Path
        The folder; it must not exist.
    storage : {"sqlite3", "mcap"}

    Returns
    -------
    list of Path
        The files in it.

    Raises
    ------
    InputError
        As :func:`write_mcap`, or if the folder exists.
    MissingExtraError
        Without rosbags.
    """
    if storage not in ("sqlite3", "mcap"):
        raise InputError(f"storage: expected sqlite3 or mcap, got {storage!r}")
    if path.exists():
        raise InputError(f"{path} exists; a bag is a folder and is not written over: remove it, or name another")
    with files.new_folder(path) as folder:
        bag = folder / path.name  # the writer makes a folder itself
        _write(recording, bag, storage)
        for file in bag.iterdir():
            file.rename(folder / file.name)
        bag.rmdir()
    return sorted(path.iterdir())


def _write(recording: Recording, path: Path, storage: str) -> None:
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise needs("rosbags", "rosbag", "writing ROS bags") from error
    bag = _messages(recording)
    types = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(path, version=9, storage_plugin=StoragePlugin[storage.upper()]) as writer:
        connections = [
            writer.add_connection(topic, kind.replace("/", "/msg/"), typestore=types) for topic, kind, _, _ in bag
        ]
        stamps = np.concatenate([ns for _, _, ns, _ in bag])
        owners = np.repeat(np.arange(len(bag)), [len(ns) for _, _, ns, _ in bag])
        places = np.concatenate([np.arange(len(ns)) for _, _, ns, _ in bag])
        for k in np.argsort(stamps, kind="stable"):
            owner = int(owners[k])
            writer.write(connections[owner], int(stamps[k]), bag[owner][3][int(places[k])])


def _messages(recording: Recording) -> _Bag:
    """Topic, type, stamps and serialised messages of everything that is written."""
    unix = _UnixTime(recording)
    bag: _Bag = []

    def add(part: str, kind: str, t: Any, values: dict[str, Any], frame: str, **texts: str) -> None:
        ns = unix.of(np.asarray(t))
        bag.append((TOPICS[part], kind, ns, encode(kind, ns, values, {"header.frame_id": frame, **texts})))

    if recording.imu is not None:
        imu, t = recording.imu.rates(), recording.imu.t
        if recording.imu.kind == "increment":
            t = t - 0.5 * recording.imu.increments().dt  # where a mean rate is the rate but for terms of second order
        values: dict[str, Any] = {"orientation_covariance.0": -1.0, "orientation.w": 1.0}  # -1: there is no orientation
        values |= _fields("angular_velocity", imu.gyro @ FLU) | _fields("linear_acceleration", imu.accel @ FLU)
        add("imu", "sensor_msgs/Imu", t, values, "imu_link")
    if (gnss := recording.gnss) is not None:
        quality = np.zeros(len(gnss), dtype=int) if gnss.quality is None else gnss.quality
        values = {
            "status.status": [_STATUS.get(int(q), 0) for q in quality], "status.service": 1,
            "latitude": gnss.llh[:, 0] / units.DEG, "longitude": gnss.llh[:, 1] / units.DEG, "altitude": gnss.llh[:, 2],
            "position_covariance_type": 3, **_matrix("position_covariance", ENU @ gnss.cov_r_n @ ENU),
        }  # fmt: skip
        add("gnss", "sensor_msgs/NavSatFix", gnss.t, values, "gnss_link")
        if gnss.v_n is not None and gnss.cov_v_n is not None:
            cov = np.zeros((len(gnss), 6, 6))
            cov[:, :3, :3] = ENU @ gnss.cov_v_n @ ENU
            values = _fields("twist.twist.linear", gnss.v_n @ ENU) | _matrix("twist.covariance", cov)
            add("velocity", "geometry_msgs/TwistWithCovarianceStamped", gnss.t, values, "enu")
    if (odometer := recording.odometer) is not None:
        values = {"twist.twist.linear.x": odometer.speed, "twist.covariance.0": odometer.sigma**2}
        add("odometer", "geometry_msgs/TwistWithCovarianceStamped", odometer.t, values, "base_link")
    origin = None
    if (reference := recording.reference) is not None:
        origin = reference.llh[0]
        C_ne = frames.C_en(origin).T
        values = _fields("pose.pose.position", frames.ned_from_ecef(reference.r_eb_e, origin) @ ENU)
        if reference.q_eb is not None:
            C_nb = C_ne @ rotation.dcm_from_quat(reference.q_eb)
            q = rotation.quat_from_dcm(ENU @ C_nb @ FLU)
            values |= {f"pose.pose.orientation.{axis}": q[:, k] for k, axis in enumerate("wxyz")}
            if reference.v_eb_e is not None:
                v_b = np.einsum("nji,jk,nk->ni", C_nb, C_ne, reference.v_eb_e)
                values |= _fields("twist.twist.linear", v_b @ FLU)
        add("reference", "nav_msgs/Odometry", reference.t, values, "map", child_frame_id="imu_link")
    if not bag:
        raise InputError(f"{recording.metadata.name} has none of: {', '.join(HELD)}")
    document = {
        "format": OWN_FORMAT, "time": recording.metadata.time.scale, "name": recording.metadata.name,
        "origin": None if origin is None else origin.tolist(), "notes": list(recording.metadata.notes),
    }  # fmt: skip
    first = np.array([min(int(ns[0]) for _, _, ns, _ in bag)])
    texts = {"data": json.dumps(document)}
    bag.append((OWN_TOPIC, "std_msgs/String", first, encode("std_msgs/String", first, {}, texts)))
    return bag


class _UnixTime:
    """Unix nanoseconds of the times of a recording, or its own clock's if that is all it has."""

    def __init__(self, recording: Recording) -> None:
        base = recording.metadata.time
        self.name, self.shift, self.gps = recording.metadata.name, 0, base.scale == "gps"
        if base.scale != "local":
            self.shift = round((base.epoch_gps_s + UNIX_TO_GPS_S) * 1e3) * 1_000_000

    def of(self, t: Any) -> np.ndarray[Any, np.dtype[np.int64]]:
        """Nanoseconds. Shape (n,)."""
        ns = np.round(t * 1e9)
        if np.abs(ns).max(initial=0.0) + abs(self.shift) > _MOST_NS:
            raise InputError(f"{self.name}: stamps of ROS end in the year 2262, got {np.abs(t).max():.6g} s")
        ns = ns.astype(np.int64) + self.shift
        if self.gps:
            import datetime as dt

            days = leap_days(calendar(float(ns.max()) / _NS - UNIX_TO_GPS_S).date())
            steps = [
                round(gps_from_calendar(dt.datetime(*day)) + count + UNIX_TO_GPS_S) * _NS
                for count, day in enumerate(days, 1)
            ]
            ns = ns - np.searchsorted(steps, ns, side="right") * _NS
        if ns.min() < 0:
            raise InputError(
                f"{self.name}: stamps of ROS are not negative, got {ns.min() / _NS:.3f} s; shift the recording"
            )
        return np.asarray(ns, dtype=np.int64)


def _fields(stem: str, vectors: Any) -> dict[str, Any]:
    return {f"{stem}.{axis}": vectors[:, k] for k, axis in enumerate("xyz")}


def _matrix(stem: str, matrices: Any) -> dict[str, Any]:
    n = matrices.shape[1]
    return {f"{stem}.{k}": matrices[:, k // n, k % n] for k in range(n * n)}
