"""Axes, signs and the angular unit of an IMU: by the motion GNSS tells, by gravity at rest, by turns between rests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.diagnosis import gyro_unit, support
from schuler.diagnosis.accel_unit import stated_factor
from schuler.diagnosis.axes import SEEN, Guess, axes_findings, judge, scores
from schuler.diagnosis.axes_evidence import AxesEvidence, measure_axes
from schuler.diagnosis.findings import Finding
from schuler.diagnosis.lag import Lag
from schuler.diagnosis.motion import Motion, WindowMeans, motion_of
from schuler.diagnosis.mounting import find_mounting
from schuler.diagnosis.work import VEHICLE, Work
from schuler.exceptions import SchulerError
from schuler.recording.io.hint_texts import axes_matrix
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries


def find_axes(work: Work, means: WindowMeans, motion: Motion, lag: Lag) -> None:
    """Axes, signs, angular unit and mounting by the motion that GNSS tells.

    Parameters
    ----------
    work : Work
        Is added to.
    means : WindowMeans
    motion : Motion
    lag : Lag
        Between the two.
    """
    if any(f.code == "no_gravity" for f in work.findings):
        return  # no down
    level = work.rests.accel.mean(axis=0) if work.rests is not None and len(work.rests) else means.origin[:3]
    rests = work.rests
    if rests is not None and len(rests):
        # one attitude only: a vehicle; rests of a hand-held unit point anywhere
        weight = rests.t[:, 1] - rests.t[:, 0]
        level = (rests.accel * weight[:, None]).sum(axis=0) / weight.sum()
    if np.linalg.norm(level) <= 0.0:
        return
    ev = measure_axes(means, motion, lag.offset, work.scaling.factor, level, work.gravity)
    if ev is None:
        return
    work.checked += ["axes", "sign of gravity"]
    _pictures(work, means, motion, lag, ev)
    pull = np.linalg.norm(ev.B[:, :2], axis=0) / np.sqrt(np.maximum(lag.r2[1:], 1e-3))
    forward = bool(lag.r2[1] > VEHICLE and lag.r2[2] > VEHICLE)
    _angular_unit(work, ev, lag)
    if forward:
        _position_scale(work, pull)
    best, rivals = judge(ev, work.gyro_factor, forward_known=forward)
    if work.view is not None and work.view.mirrored:
        best, rivals, ev = _unmirrored(work, means, lag, level, (best, rivals, ev), forward_known=forward)
    as_read = axes_matrix(_axes_hint(work.recording))
    work.findings += axes_findings(best, rivals, ev, as_read, forward_known=forward)
    if forward:
        find_mounting(work, ev, best.A)
        _unseen(work, ev)


def _unseen(work: Work, ev: AxesEvidence) -> None:
    """Level axes of the gyro that nothing in this log turned about."""
    pitch = np.sum((ev.tilt[0] / ev.tilt_sigma[0]) ** 2)
    roll = np.sum((ev.tilt[1] / ev.tilt_sigma[1]) ** 2)
    climb = np.sum((ev.climb / np.maximum(ev.climb_sigma, 1e-300)) ** 2)
    if max(roll, climb) < SEEN:
        work.untold.append("the gyro's roll axis (nothing rolled, nor turned on a slope)")
    if pitch < SEEN:
        work.untold.append("the gyro's pitch axis (nothing pitched)")


def _pictures(work: Work, means: WindowMeans, motion: Motion, lag: Lag, ev: AxesEvidence) -> None:
    """Curves of the report: what GNSS says of turns and acceleration beside what the IMU makes of it."""
    y, inside = means.at(motion.t - lag.offset, motion.half)
    use = motion.moving & inside
    for name, target, columns in (("turn", motion.turn, slice(3, 6)), ("forward", motion.forward, slice(0, 3))):
        A = np.concatenate((y[:, columns], np.ones((len(y), 1))), axis=1)
        c, *_ = np.linalg.lstsq(A[use], target[use], rcond=None)
        seen = np.where(motion.moving, target, np.nan)
        work.curves[name] = np.stack((motion.t, seen, np.where(use, A @ c, np.nan)), axis=1)
    names, cosine = scores(ev)
    work.curves["orientations"] = cosine
    work.estimates["orientations"] = dict(zip(names[:6], cosine[:6].tolist(), strict=True))


def _unmirrored(
    work: Work,
    means: WindowMeans,
    lag: Lag,
    level: FloatArray,
    by_velocity: tuple[Guess, list[Guess], AxesEvidence],
    *,
    forward_known: bool,
) -> tuple[Guess, list[Guess], AxesEvidence]:
    """Positions and velocities are mirror images: the one with which the IMU needs less explaining is right."""
    assert work.view is not None
    assert work.view.other is not None
    motion = motion_of(*work.view.other, work.gravity)
    if motion is None:
        return by_velocity
    ev = measure_axes(means, motion, lag.offset, work.scaling.factor, level, work.gravity)
    if ev is None:
        return by_velocity
    best, rivals = judge(ev, work.gyro_factor, forward_known=forward_known)
    velocity_right = by_velocity[0].total <= best.total
    for k, f in enumerate(work.findings):
        if f.code in ("longitude_sign", "latitude_sign"):
            name, axis = ("lon", "ve") if f.code == "longitude_sign" else ("lat", "vn")
            fix = f"scale='{name}=-1'" if velocity_right else f"scale='{axis}=-1'"
            wrong = "the positions are mirrored" if velocity_right else "the velocity is"
            work.findings[k] = replace(f, text=f"{f.text}; by the turns of the gyro {wrong}", fix=fix, confidence=0.95)
    if velocity_right:
        return by_velocity
    work.motion = motion
    return best, rivals, ev


def _axes_hint(recording: Recording) -> str | None:
    text = recording.metadata.axes
    try:
        axes_matrix(text)
    except SchulerError:
        text = "FRD"
    entry = recording.metadata.options.get("imu")
    if isinstance(entry, dict) and isinstance(entry.get("axes"), str):
        text = entry["axes"]
    return text


def _angular_unit(work: Work, ev: AxesEvidence, lag: Lag) -> None:
    size = float(np.linalg.norm(ev.e))
    if lag.r2[0] < 0.5 or size <= 0.0 or work.imu is None:
        return
    work.checked.append("unit of angular rate (course)")
    size /= float(np.sqrt(lag.r2[0]))
    need, kind = 1.0 / size, str(work.imu.kind)
    if work.scaling.known and work.scaling.kind != kind:
        by_kind = 1.0 / work.imu.interval if work.scaling.kind == "increment" else work.imu.interval
        # the gyro may be right where the accelerometer is not
        if abs(np.log(need / by_kind)) < abs(np.log(need)):
            need, kind = need / by_kind, work.scaling.kind
        else:
            kind = "other"
    stated = stated_factor(work.recording.metadata.options, "gyro")
    evidence = {"turn_gain": size, "explained": float(lag.r2[0])}
    work.findings += gyro_unit.gyro_unit(
        need, work.imu.interval, stated, kind, evidence, "against the turns of the course"
    )
    work.gyro_factor = 1.0 / size


def _position_scale(work: Work, pull: FloatArray) -> None:
    """Accelerations many times those of the path: its unit is wrong, if nothing else told so."""
    size = float(np.sqrt(pull[0] * pull[1]))
    work.estimates["acceleration_gain"] = size
    known = {"position_unit", "position_order", "velocity_unit", "velocity_wrong", "accel_unit", "accel_scale"}
    if any(f.code in known for f in work.findings) or not work.scaling.known or 0.5 < size < 2.0:
        return
    evidence = {"gain": size}
    assert work.view is not None
    if abs(np.log(size * units.DEG)) < 0.35:
        text = (
            f"accelerations of the IMU are {size:.3g} times those of the path: latitude and longitude are "
            f"radians and were "
            "read as degrees"
        )
        work.findings.append(Finding("position_unit", "error", text, 0.9, "units='angle=rad'", evidence, "gnss"))
        return
    code = "position_unit" if work.view.source == "position" else "velocity_unit"
    text = f"accelerations of the IMU are {size:.3g} times those of the path: its unit is wrong"
    work.findings.append(Finding(code, "error", text, 0.6, "units='velocity=...' or 'angle=...'", evidence, "gnss"))


def find_upright(work: Work) -> None:
    """Which way is up, where no motion tells more: a log at rest in one attitude.

    Parameters
    ----------
    work : Work
        Is added to.
    """
    rests = work.rests
    if rests is None or not len(rests) or not work.scaling.known:
        return
    number, _ = support.poses(rests)
    if number != 1:
        return
    work.checked.append("which way is up")
    unit = rests.accel.mean(axis=0)
    unit = unit / np.linalg.norm(unit)
    k = int(np.argmax(np.abs(unit)))
    if (k == 2 and unit[2] < 0.0) or abs(unit[k]) < 0.7:
        return
    options = work.recording.metadata.options
    said = any("axes" in entry for entry in (options, *(e for e in options.values() if isinstance(e, dict))))
    evidence = {"specific_force_direction": unit.tolist(), "axes_stated": said}
    name = "xyz"[k]
    if k == 2:
        text = (
            "at rest specific force points along +z, where axes forward, right, down show it along -z: z points up "
            "(axes FLU, RFU, ...), or the log holds gravity instead of specific force; without motion the two "
            "look alike"
        )
        fix = "axes='FLU' or 'RFU' (as the sensor's drawing shows); or scale='accel=-1'"
        # who says what the axes are may have it upside down on the bench
        work.findings.append(Finding("axes", "note" if said else "warning", text, 0.7, fix, evidence))
    else:
        text = (
            f"at rest specific force points along {'-' if unit[k] < 0.0 else '+'}{name}: the sensor stands on its side"
        )
        work.findings.append(Finding("axes", "note", text, 0.6, "axes='...'", evidence))


def find_turns(work: Work, imu: ImuSeries) -> None:
    """Gyro against gravity between rests, where a course did not tell.

    Parameters
    ----------
    work : Work
        Is added to.
    imu : ImuSeries
    """
    if "unit of angular rate (course)" in work.checked or work.rests is None or not imu.gyro.any():
        return
    turns = gyro_unit.turns_between(imu.rates(), work.rests)
    if turns is None or (len(turns) < 2 and float(turns.angle.max()) < 0.5):
        return
    work.checked.append("unit of angular rate (turns of gravity)")
    stated = stated_factor(work.recording.metadata.options, "gyro")
    factor, P, evidence = gyro_unit.by_turns(turns, imu.interval, stated)
    if factor is None:
        text = (
            f"gravity turns by {evidence['turn_deg']:.0f} deg between rests and no unit and no axes of the "
            f"gyro explain it "
            f"({evidence['misfit_deg']:.0f} deg off at best)"
        )
        work.findings.append(Finding("unchecked", "note", text, 0.5, "", evidence))
        return
    work.gyro_factor = factor
    need, kind = factor, str(imu.kind)
    if work.scaling.known and work.scaling.kind != kind:
        by_kind = 1.0 / imu.interval if work.scaling.kind == "increment" else imu.interval
        need, kind = need / by_kind, work.scaling.kind
    found = gyro_unit.gyro_unit(need, imu.interval, stated, kind, evidence, "against turns of gravity between rests")
    if any("raw counts" in note for note in work.recording.metadata.notes):
        found = []
    work.findings += found
    work.findings += gyro_unit.gyro_axes(P, evidence)
