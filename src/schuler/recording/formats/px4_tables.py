"""Tables of PX4's topics in SI: IMU, GNSS, and the autopilot's own estimate."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from schuler import rotation, units
from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import FileFormatError
from schuler.recording.io import columns, parts
from schuler.recording.io.checks import unit_quaternions
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.parts import Table
from schuler.timebase import UNIX_TO_GPS_S, gps_from_unix

#: RTKLIB's quality of fix_type: 3D, differential, float, fixed, extrapolated.
QUALITY = {3: 5, 4: 4, 5: 2, 6: 1, 8: 7}
_NO_VELOCITY = 1000.0  # 1-sigma of a velocity that is not valid [m/s]
_TILED = 0.2  # of the interval: increments that leave no more open follow each other
_LATEST_UNIX = 4.0e9  # of the year 2096 [s]
_RELATIVE, _FORCE_RELATIVE = "timestamp_time_relative", "accelerometer_timestamp_relative"
_INVALID = 0x7FFFFFFF  # RELATIVE_TIMESTAMP_INVALID of sensor_combined
_US, _DEG7, _MM = 1e-6, 1e-7, 1e-3
#: Columns of the topics of a log by ``name:instance``.
Log = dict[str, dict[str, Any]]


def imu_table(path: Path, log: Log, name: str, notes: list[str]) -> Table:
    """IMU of a stream: ``sensor_combined:0``, ``vehicle_imu:0``, or ``sensor_gyro:0`` with ``sensor_accel:0``.

    Parameters
    ----------
    path : Path
        For messages.
    log : dict
    name : str
        Name of the stream.
    notes : list of str
        Takes what was done.

    Returns
    -------
    Table
        With ``t`` on the log's clock [s], axes forward-right-down; increments or rates.

    Raises
    ------
    FileFormatError
        If fields are missing, stamps go back, or gyro and accelerometer do not overlap.
    """
    data, (topic, _, instance) = log[name], name.partition(":")
    t = stamps(data)
    keep = parts.later(t, name, path, notes)
    if _FORCE_RELATIVE in data and (missing := keep & (np.asarray(data[_FORCE_RELATIVE]) == _INVALID)).any():
        keep &= ~missing
        notes.append(f"imu: {int(missing.sum())} samples without a valid specific force were left out.")
        if not keep.any():
            raise FileFormatError(f"{name}: no sample has a valid specific force", path)
    t, kind = t[keep], "rate"
    if len(t) < 2:
        raise FileFormatError(f"{name}: expected samples, got a single one", path)
    temperature = None
    if topic == "sensor_combined":
        gyro, accel = _triad(path, data, "gyro_rad", name)[keep], _triad(path, data, "accelerometer_m_s2", name)[keep]
        span = field_of(path, data, "gyro_integral_dt", name)[keep] * _US
        t = t - 0.5 * span
        notes.append(
            f"imu: {name}, means over {np.median(span) * 1e3:.3g} ms; stamps were moved to the middle of each."
        )
    elif topic == "vehicle_imu":
        gyro, accel = _triad(path, data, "delta_angle", name)[keep], _triad(path, data, "delta_velocity", name)[keep]
        span = field_of(path, data, "delta_angle_dt", name)[keep] * _US
        span_f = field_of(path, data, "delta_velocity_dt", name)[keep] * _US
        if (span <= 0.0).any() or (span_f <= 0.0).any():
            raise FileFormatError(f"{name}: an integration period is zero", path)
        step = np.diff(t)
        if (
            len(t) > 1
            and (np.abs(step - span[1:]) < _TILED * span[1:]).mean() > 0.95
            and np.allclose(span, span_f, rtol=0.05)
        ):
            kind = "increment"
            notes.append(f"imu: {name}, increments that follow each other.")
        else:
            gyro, accel, t = gyro / span[:, None], accel / span_f[:, None], t - 0.5 * span
            notes.append(
                f"imu: {name}, increments of {np.median(span) * 1e3:.3g} ms every {np.median(step) * 1e3:.3g} ms: not "
                "all were logged, so they were made mean rates at the middle of each."
            )
    else:
        other = log[f"sensor_accel:{instance}"]
        t_a = stamps(other)
        keep_a = parts.later(t_a, f"sensor_accel:{instance}", path, notes)
        inside = (t >= t_a[keep_a][0]) & (t <= t_a[keep_a][-1])
        if inside.sum() < 2:
            raise FileFormatError(f"{name}: gyro and accelerometer do not overlap in time", path)
        gyro = np.stack([field_of(path, data, axis, name)[keep][inside] for axis in "xyz"], axis=1)
        t = t[inside]
        force = [field_of(path, other, axis, "sensor_accel")[keep_a] for axis in "xyz"]
        accel = np.stack([np.interp(t, t_a[keep_a], f) for f in force], axis=1)
        if "temperature" in data and np.isfinite(temp := field_of(path, data, "temperature", name)[keep][inside]).all():
            temperature = temp
        notes.append(
            f"imu: {name} with sensor_accel:{instance}, uncalibrated, interpolated to the gyro's stamps (linear)."
        )
    values = {"t": t, **{f"g{axis}": gyro[:, k] for k, axis in enumerate("xyz")}}
    values |= {f"a{axis}": accel[:, k] for k, axis in enumerate("xyz")}
    if temperature is not None:
        values["temp"] = temperature
    return Table(values, kind="increment" if kind == "increment" else "rate")


def gnss_table(path: Path, log: Log, name: str, hints: ReadHints, notes: list[str]) -> Table:
    """Fixes of a stream, ``vehicle_gps_position:0`` or ``sensor_gps:0``, in the fields of old or new versions.

    Parameters
    ----------
    path : Path
        For messages.
    log : dict
    name : str
        Name of the stream.
    hints : ReadHints
        ``height``.
    notes : list of str
        Takes what was done.

    Returns
    -------
    Table
        With ``t``, when each fix came in, on the log's clock [s], and ``gps``, its GPS time since 1980, NaN where it is
        not known [s].

    Raises
    ------
    FileFormatError
        If there is no fix, fields are missing, or the heights are not what they are called.
    """
    data = log[name]
    kind = field_of(path, data, "fix_type", name)
    fix = np.isin(kind, list(QUALITY))
    if not fix.all():
        notes.append(f"gnss: {int((~fix).sum())} messages without a three-dimensional fix were left out.")
    if not fix.any():
        raise FileFormatError(
            f"{name}: no message has a three-dimensional fix; streams='gnss=none' leaves it out", path
        )
    t = stamps(data)
    keep = np.flatnonzero(fix)
    keep = keep[parts.later(t[keep], name, path, notes)]
    gps = _gps_times(path, data, name, t, keep)
    values = {"t": t[keep], "gps": gps, "q": np.array([QUALITY[int(k)] for k in kind[keep]], dtype=np.float64)}
    values |= _position(path, data, name, keep, hints)
    accuracy = {
        n: field_of(path, data, f, name)[keep] for n, f in (("sn", "eph"), ("sd", "epv"), ("svn", "s_variance_m_s"))
    }
    values |= {"sn": accuracy["sn"], "se": accuracy["sn"], "sd": accuracy["sd"]}
    values |= {f"v{axis}": field_of(path, data, f"vel_{axis}_m_s", name)[keep].copy() for axis in "ned"}
    values |= {f"sv{axis}": accuracy["svn"].copy() for axis in "ned"}
    if "vel_ned_valid" in data and (invalid := field_of(path, data, "vel_ned_valid", name)[keep] == 0.0).any():
        for axis in "ned":
            values[f"v{axis}"][invalid], values[f"sv{axis}"][invalid] = 0.0, _NO_VELOCITY
        notes.append(
            f"gnss: {int(invalid.sum())} velocities are not valid; theirs is zero with {_NO_VELOCITY:g} m/s 1-sigma."
        )
    if "satellites_used" in data:
        values["ns"] = field_of(path, data, "satellites_used", name)[keep]
    values |= {column: field_of(path, data, column, name)[keep] for column in columns.DILUTION if column in data}
    notes.append(
        f"gnss: {name}; eph is taken as 1-sigma of north and of east, s_variance_m_s as that of each velocity."
    )
    return Table(values)


def _gps_times(path: Path, data: dict[str, Any], name: str, t: FloatArray, keep: IntArray) -> FloatArray:
    """GPS time of fixes, NaN where PX4 had none. Shape (k,). [s]

    The logged UTC is that of the fix, or of the fix before where the receiver sends the time in a message of its own:
    PX4 says how far off the moment is that it belongs to.
    """
    utc = field_of(path, data, "time_utc_usec", name)[keep] * _US
    valid = (utc > UNIX_TO_GPS_S) & (utc < _LATEST_UNIX)
    gps = np.full(len(keep), np.nan)
    if not valid.any():
        return gps
    step = float(np.median(np.diff(t[keep]))) if len(keep) > 1 else 0.0
    relative = field_of(path, data, _RELATIVE, name)[keep] * _US if _RELATIVE in data else np.zeros(len(keep))
    gps[valid] = gps_from_unix(utc[valid]) - np.where(np.abs(relative) > 0.5 * step, relative, 0.0)[valid]
    gps[np.concatenate(([False], ~(np.diff(gps) > 0.0)))] = np.nan
    return gps


def _position(path: Path, data: dict[str, Any], name: str, keep: IntArray, hints: ReadHints) -> dict[str, FloatArray]:
    """Latitude, longitude [rad] and ellipsoidal height [m] of fixes, unless a hint makes it ellipsoidal. Shape (k,)."""
    values: dict[str, FloatArray] = {}
    if "latitude_deg" in data:
        values["lat"] = field_of(path, data, "latitude_deg", name)[keep] * units.DEG
        values["lon"] = field_of(path, data, "longitude_deg", name)[keep] * units.DEG
        msl = field_of(path, data, "altitude_msl_m", name)[keep]
        ellipsoidal = field_of(path, data, "altitude_ellipsoid_m", name)[keep]
    else:
        values["lat"] = field_of(path, data, "lat", name)[keep] * (_DEG7 * units.DEG)
        values["lon"] = field_of(path, data, "lon", name)[keep] * (_DEG7 * units.DEG)
        msl = field_of(path, data, "alt", name)[keep] * _MM
        ellipsoidal = (
            field_of(path, data, "alt_ellipsoid", name)[keep] * _MM if "alt_ellipsoid" in data else np.zeros(len(keep))
        )
    if hints.height == "msl":
        values["h"] = msl  # the hint's separation is added to it
    elif ellipsoidal.any() and not (np.array_equal(ellipsoidal, msl) and hints.height is None):
        values["h"] = ellipsoidal
    elif hints.height == "ellipsoidal":
        values["h"] = msl
    else:
        raise FileFormatError(
            f"{name}: heights above the ellipsoid are missing or those above mean sea level: give height='msl' and "
            "geoid_separation=... [m], or height='ellipsoidal' if they are right",
            path,
        )
    return values


def reference_table(path: Path, log: Log, name: str, hints: ReadHints, notes: list[str]) -> Table | None:
    """The autopilot's own estimate of position, with attitude and velocity interpolated to it."""
    data = log[name]
    t = stamps(data)
    height = "alt" if hints.height == "msl" or "alt_ellipsoid" not in data else "alt_ellipsoid"
    if height == "alt" and hints.height is None:
        notes.append("The autopilot's estimate was not read: its heights are above sea level, and nothing says more.")
        return None
    keep = parts.later(t, name, path, notes)
    values: dict[str, FloatArray] = {}
    attitude, local = log.get("vehicle_attitude:0"), log.get("vehicle_local_position:0")
    if attitude is not None:
        t_a = stamps(attitude)
        keep_a = parts.later(t_a, "vehicle_attitude", path, notes)
        keep &= (t >= t_a[keep_a][0]) & (t <= t_a[keep_a][-1])
    if local is not None:
        t_v = stamps(local)
        keep_v = parts.later(t_v, "vehicle_local_position", path, notes)
        keep &= (t >= t_v[keep_v][0]) & (t <= t_v[keep_v][-1])
    if keep.sum() < 2:
        notes.append("The autopilot's estimate was not read: its topics do not overlap in time.")
        return None
    if attitude is not None:
        q = np.stack([field_of(path, attitude, f"q[{k}]", "vehicle_attitude")[keep_a] for k in range(4)], axis=1)
        leave = "streams='reference=none' leaves it out"
        q = unit_quaternions(
            q, lambda row, text: FileFormatError(f"vehicle_attitude {row + 1}: {text}; {leave}", path), 1e-3
        )
        rpy = rotation.rpy_from_quat(rotation.interpolate_quat(t[keep], t_a[keep_a], q))
        values |= {field: rpy[:, k] for k, field in enumerate(("roll", "pitch", "yaw"))}
    if local is not None:
        for field, source in (("vn", "vx"), ("ve", "vy"), ("vd", "vz")):
            v = field_of(path, local, source, "vehicle_local_position")[keep_v]
            values[field] = np.interp(t[keep], t_v[keep_v], v)
    values |= {"t": t[keep], "h": field_of(path, data, height, name)[keep]}
    values |= {field: field_of(path, data, field, name)[keep] * units.DEG for field in ("lat", "lon")}
    notes.append("reference: the autopilot's own estimate, made of the same sensors: to compare with, not a truth.")
    return Table(values)


def stamps(data: dict[str, Any]) -> FloatArray:
    """When the values were sampled, which newer messages say beside when they were published. Shape (n,). [s]"""
    t = np.asarray(data["timestamp"], dtype=np.float64)
    if "timestamp_sample" in data and (sampled := np.asarray(data["timestamp_sample"], dtype=np.float64)).all():
        t = np.where(np.abs(sampled - t) < 1e6, sampled, t)
    return np.asarray(t * _US)


def field_of(path: Path, data: dict[str, Any], name: str, topic: str) -> FloatArray:
    """A field of a topic as numbers, an error with the fields there are if it is missing. Shape (n,)."""
    if name not in data:
        raise FileFormatError(f"{topic} has no field {name}; it has {', '.join(list(data)[:40])}", path)
    with np.errstate(invalid="ignore"):  # a signalling NaN of a damaged log; it is found out later
        return np.asarray(data[name], dtype=np.float64)


def _triad(path: Path, data: dict[str, Any], name: str, topic: str) -> FloatArray:
    return np.stack([field_of(path, data, f"{name}[{k}]", topic) for k in range(3)], axis=1)
