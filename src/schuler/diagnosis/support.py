"""Calibrations and analyses that a log supports."""

from __future__ import annotations

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.diagnosis.motion import Motion
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries
from schuler.standstill.unscaled import UnscaledRests

_FACES = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=np.float64)


def poses(rests: UnscaledRests) -> tuple[int, int]:
    """Different attitudes in which the sensor rested (10 degrees apart), and how many of the six faces were up."""
    if not len(rests):
        return 0, 0
    unit = rests.accel / np.linalg.norm(rests.accel, axis=1, keepdims=True)
    distinct: list[FloatArray] = []
    for u in unit:
        if all(u @ k < np.cos(10.0 * units.DEG) for k in distinct):
            distinct.append(u)
    faces = int(np.count_nonzero((np.array(distinct) @ _FACES.T).max(axis=0) > np.cos(15.0 * units.DEG)))
    return len(distinct), faces


def uses(
    recording: Recording, imu: ImuSeries | None, rests: UnscaledRests | None, motion: Motion | None
) -> tuple[str, ...]:
    """Sentences on what the log can be used for.

    Parameters
    ----------
    recording : Recording
    imu : ImuSeries, optional
        Rates.
    rests : UnscaledRests, optional
    motion : Motion, optional
    """
    out: list[str] = []
    if imu is not None and rests is not None:
        longest = float((rests.t[:, 1] - rests.t[:, 0]).max()) if len(rests) else 0.0
        span = float(imu.t[-1] - imu.t[0])
        if longest > 600.0:
            out.append(f"allan: {longest:.0f} s of unbroken rest; averaging times to about {longest / 9.0:.0f} s")
        elif longest > 60.0:
            out.append(f"allan: white noise only ({longest:.0f} s of rest)")
        number, faces = poses(rests)
        if faces == 6:
            out.append("calibrate sixposition: all six faces were up")
        if number >= 9:
            out.append(f"calibrate freepose / multiposition: {number} different attitudes at rest")
        elif number >= 3:
            out.append(f"{number} attitudes at rest: too few for a calibration of the accelerometer (9 or more)")
        if number >= 9 and len(rests) >= 10:
            out.append("calibrate field: turned by hand between rests")
        if rests.seconds > 0.2 * span and number >= 1 and len(rests) > 20 and longest < 30.0:
            out.append("foot: many short rests (zero-velocity updates)")
        if longest > 5.0:
            out.append("levelling at rest and gyro bias from rest")
    moving = motion is not None and motion.enough
    if recording.gnss is not None and imu is not None:
        out.append(
            "navigate: loosely coupled"
            + ("" if moving else " (no motion: heading stays unknown)")
            + ("" if recording.gnss.v_n is not None else ", without velocities")
        )
        if moving:
            out.append("time offset, mount angles and lever arm from the drive; simulated outages")
    has_satellites = recording.ranges is not None or (
        recording.observations is not None and recording.ephemerides is not None
    )
    if has_satellites:
        out.append("point positions" + (" and navigate: tightly coupled" if imu is not None else ""))
    if recording.odometer is not None:
        out.append("odometer aiding")
    if recording.reference is not None:
        out.append("errors against the reference")
    return tuple(out)


def segments(imu: ImuSeries, rests: UnscaledRests) -> tuple[tuple[float, float, str], ...]:
    """Static and moving segments in order; rests closer than 2 s in one attitude are one."""
    out: list[tuple[float, float, str]] = []
    begin, end = float(imu.t[0]), float(imu.t[-1])
    at = begin
    merged: list[list[float]] = []
    for a, b in rests.t:
        if merged and a - merged[-1][1] < 2.0:
            merged[-1][1] = float(b)
        else:
            merged.append([float(a), float(b)])
    for a, b in merged:
        if a - at > 1.5:
            out.append((at, a, "moving"))
        else:
            a = at
        out.append((a, b, "static"))
        at = b
    if end - at > 1.5:
        out.append((at, end, "moving"))
    return tuple(out)
