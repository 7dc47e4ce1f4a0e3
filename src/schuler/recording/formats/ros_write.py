"""Recordings as bags of ROS 2 and as MCAP files, for RViz, Foxglove, PlotJuggler and filters that run under ROS."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from schuler import files, frames, rotation
from schuler.exceptions import InputError
from schuler.recording.formats.registry import needs
from schuler.recording.formats.ros_fields import fix_fields, imu_fields, odometry_fields, speed_fields, velocity_fields
from schuler.recording.formats.ros_messages import encode
from schuler.recording.formats.ros_recording import OWN_FORMAT, OWN_TOPIC, TOPICS
from schuler.recording.formats.ros_stamps import unix_ns
from schuler.recording.recording import Recording

#: Parts of a recording that are written.
HELD = ("imu", "gnss", "reference", "odometer")
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
    base, name = recording.metadata.time, recording.metadata.name
    bag: _Bag = []

    def add(part: str, kind: str, t: Any, values: dict[str, Any], frame: str, **texts: str) -> None:
        ns = unix_ns(np.asarray(t), base, name)
        bag.append((TOPICS[part], kind, ns, encode(kind, ns, values, {"header.frame_id": frame, **texts})))

    if recording.imu is not None:
        imu, t = recording.imu.rates(), recording.imu.t
        if recording.imu.kind == "increment":
            t = t - 0.5 * recording.imu.increments().dt  # where a mean rate is the rate but for terms of second order
        add("imu", "sensor_msgs/Imu", t, imu_fields(imu.gyro, imu.accel), "imu_link")
    if (gnss := recording.gnss) is not None:
        quality = np.zeros(len(gnss), dtype=int) if gnss.quality is None else gnss.quality
        add("gnss", "sensor_msgs/NavSatFix", gnss.t, fix_fields(gnss.llh, gnss.cov_r_n, quality), "gnss_link")
        if gnss.v_n is not None and gnss.cov_v_n is not None:
            values = velocity_fields(gnss.v_n, gnss.cov_v_n)
            add("velocity", "geometry_msgs/TwistWithCovarianceStamped", gnss.t, values, "enu")
    if (odometer := recording.odometer) is not None:
        values = speed_fields(odometer.speed, odometer.sigma)
        add("odometer", "geometry_msgs/TwistWithCovarianceStamped", odometer.t, values, "base_link")
    origin = None
    if (reference := recording.reference) is not None:
        origin = reference.llh[0]
        C_ne = frames.C_en(origin).T
        C_nb = None if reference.q_eb is None else C_ne @ rotation.dcm_from_quat(reference.q_eb)
        v_n = None if reference.v_eb_e is None else reference.v_eb_e @ C_ne.T
        values = odometry_fields(frames.ned_from_ecef(reference.r_eb_e, origin), C_nb, v_n)
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
