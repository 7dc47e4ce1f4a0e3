"""Axes, signs, angular unit and mounting of an IMU: by GNSS motion, by gravity at rest, by turns between rests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler import rotation, units
from schuler.arrays import FloatArray
from schuler.diagnosis import gyro_unit, support
from schuler.diagnosis.accel_unit import stated_factor
from schuler.diagnosis.axes import SIGNIFICANT, Guess, axes_findings, judge, scores
from schuler.diagnosis.axes_evidence import AxesEvidence, measure_axes
from schuler.diagnosis.course import UPRIGHT
from schuler.diagnosis.lag import Lag
from schuler.diagnosis.motion import Motion, WindowMeans, motion_of
from schuler.diagnosis.result import Finding, Severity
from schuler.diagnosis.state import VEHICLE, DiagnosisState
from schuler.exceptions import SchulerError
from schuler.recording.io.hint_texts import axes_matrix
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries
from schuler.standstill.unscaled import UnscaledRests

_SWING = 5.0  # scatter of samples over that of their means, of a limb


def find_axes(state: DiagnosisState, means: WindowMeans, motion: Motion, lag: Lag) -> None:
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
    if any(f.code == "no_gravity" for f in state.findings):
        return  # no down
    level = state.rests.accel.mean(axis=0) if state.rests is not None and len(state.rests) else means.origin[:3]
    rests = state.rests
    if rests is not None and len(rests):
        # one attitude only: a vehicle; rests of a hand-held unit point anywhere
        weight = rests.t[:, 1] - rests.t[:, 0]
        level = (rests.accel * weight[:, None]).sum(axis=0) / weight.sum()
    size = float(np.linalg.norm(level)) * state.scaling.factor / state.gravity
    if size <= 0.0:
        return
    if not UPRIGHT[0] < size < UPRIGHT[1]:
        state.undetermined.append("the IMU's axes (nothing rests, and the mean of specific force is not gravity)")
        return
    if _swings(state.imu, means, motion, lag):
        state.undetermined.append("the IMU's axes (it swings, as on a foot, and does not go where it points)")
        return
    ev = measure_axes(means, motion, lag.offset, state.scaling.factor, level, state.gravity)
    if ev is None:
        return
    state.checked += ["axes", "sign of gravity"]
    _pictures(state, means, motion, lag, ev)
    pull = np.linalg.norm(ev.B[:, :2], axis=0) / np.sqrt(np.maximum(lag.r2[1:], 1e-3))
    forward = bool(lag.r2[1] > VEHICLE and lag.r2[2] > VEHICLE)
    _angular_unit(state, means, motion, ev, lag)
    if forward:
        _position_scale(state, pull)
    best, rivals = judge(ev, state.gyro_factor, vehicle=forward)
    if state.view is not None and state.view.mirrored:
        best, rivals, ev = _unmirrored(state, means, lag, level, (best, rivals, ev), vehicle=forward)
    as_read = axes_matrix(_axes_hint(state.recording))
    agreed = bool(best.codes) and forward and _halves_agree(state, means, motion, lag, level, best)
    state.findings += axes_findings(best, rivals, ev, as_read, vehicle=forward, agreed=agreed)
    if forward:
        find_mounting(state, ev, best.A)
        _unseen(state, ev)


def _swings(imu: ImuSeries | None, means: WindowMeans, motion: Motion, lag: Lag) -> bool:
    """Whether samples of both sensors scatter many times as much as their means over a second, smoothly: a limb."""
    if imu is None:
        return False
    y, inside = means.at(motion.t - lag.offset, motion.half)
    use = motion.moving & inside
    if use.sum() < 20:
        return False
    spread = (
        np.linalg.norm(imu.mean_rates("accel").std(axis=0)),
        np.linalg.norm((w := imu.mean_rates("gyro")).std(axis=0)),
    )
    slow = (y[use][:, :3], y[use][:, 3:])
    ratio = [float(x) / max(float(np.linalg.norm(s.std(axis=0))), 1e-300) for x, s in zip(spread, slow, strict=True)]
    w = w - w.mean(axis=0)
    alike = float(np.vdot(w[1:], w[:-1]) / max(float(np.vdot(w, w)), 1e-300))  # noise is not, from sample to sample
    return min(ratio) > _SWING and alike > 0.5


def _halves_agree(
    state: DiagnosisState, means: WindowMeans, motion: Motion, lag: Lag, level: FloatArray, best: Guess
) -> bool:
    """Whether either half of the motion by itself is best explained by the same axes and signs."""
    middle = float(np.median(motion.t[motion.moving]))
    for half in (motion.t <= middle, motion.t > middle):
        part = replace(motion, moving=motion.moving & half)
        ev = measure_axes(means, part, lag.offset, state.scaling.factor, level, state.gravity)
        if ev is None:
            return False
        guess = judge(ev, state.gyro_factor, vehicle=True)[0]
        if not (np.array_equal(guess.A, best.A) and np.array_equal(guess.G, best.G)):
            return False
    return True


def _unseen(state: DiagnosisState, ev: AxesEvidence) -> None:
    """Level axes of the gyro that nothing in this log turned about."""
    pitch = np.sum((ev.tilt[0] / ev.tilt_sigma[0]) ** 2)
    roll = np.sum((ev.tilt[1] / ev.tilt_sigma[1]) ** 2)
    climb = np.sum((ev.climb / np.maximum(ev.climb_sigma, 1e-300)) ** 2)
    if max(roll, climb) < SIGNIFICANT:
        state.undetermined.append("the gyro's roll axis (nothing rolled, nor turned on a slope)")
    if pitch < SIGNIFICANT:
        state.undetermined.append("the gyro's pitch axis (nothing pitched)")


def _pictures(state: DiagnosisState, means: WindowMeans, motion: Motion, lag: Lag, ev: AxesEvidence) -> None:
    """Curves of the report: what GNSS says of turns and acceleration beside what the IMU makes of it."""
    y, inside = means.at(motion.t - lag.offset, motion.half)
    use = motion.moving & inside
    for name, target, columns in (("turn", motion.turn, slice(3, 6)), ("forward", motion.forward, slice(0, 3))):
        A = np.concatenate((y[:, columns], np.ones((len(y), 1))), axis=1)
        c, *_ = np.linalg.lstsq(A[use], target[use], rcond=None)
        measured = np.where(motion.moving, target, np.nan)
        state.curves[name] = np.stack((motion.t, measured, np.where(use, A @ c, np.nan)), axis=1)
    names, cosine = scores(ev)
    state.curves["orientations"] = cosine
    state.estimates["orientations"] = dict(zip(names[:6], cosine[:6].tolist(), strict=True))


def _unmirrored(
    state: DiagnosisState,
    means: WindowMeans,
    lag: Lag,
    level: FloatArray,
    by_velocity: tuple[Guess, list[Guess], AxesEvidence],
    *,
    vehicle: bool,
) -> tuple[Guess, list[Guess], AxesEvidence]:
    """Positions and velocities are mirror images: the one with which the IMU needs less explaining is right."""
    assert state.view is not None
    assert state.view.other is not None
    motion = motion_of(*state.view.other, state.gravity)
    if motion is None:
        return by_velocity
    ev = measure_axes(means, motion, lag.offset, state.scaling.factor, level, state.gravity)
    if ev is None:
        return by_velocity
    best, rivals = judge(ev, state.gyro_factor, vehicle=vehicle)
    velocity_right = by_velocity[0].total <= best.total
    for k, f in enumerate(state.findings):
        if f.code in ("longitude_sign", "latitude_sign"):
            name, axis = ("lon", "ve") if f.code == "longitude_sign" else ("lat", "vn")
            fix = f"scale='{name}=-1'" if velocity_right else f"scale='{axis}=-1'"
            wrong = "the positions are mirrored" if velocity_right else "the velocity is"
            state.findings[k] = replace(f, text=f"{f.text}; by the turns of the gyro {wrong}", fix=fix, confidence=0.95)
    if velocity_right:
        return by_velocity
    state.motion = motion
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


def _turn_gains_agree(means: WindowMeans, motion: Motion, lag: Lag, size: float) -> bool:
    """Whether the gyro shows the turns of the course with the same gain in either half of the motion."""
    y, inside = means.at(motion.t - lag.offset, motion.half)
    middle = float(np.median(motion.t[motion.moving]))
    for half in (motion.t <= middle, motion.t > middle):
        use = motion.moving & inside & half
        if use.sum() < 20:
            return False
        x, w = motion.turn[use] - motion.turn[use].mean(), y[use][:, 3:] - y[use][:, 3:].mean(axis=0)
        power = float(x @ x)
        gain = float(np.linalg.norm(x @ w / power)) if power > 0.0 else 0.0
        if not 0.75 < gain / size < 1.33:
            return False
    return True


def _angular_unit(state: DiagnosisState, means: WindowMeans, motion: Motion, ev: AxesEvidence, lag: Lag) -> None:
    size = float(np.linalg.norm(ev.e))
    if lag.r2[0] < 0.5 or size <= 0.0 or state.imu is None:
        return
    state.checked.append("unit of angular rate (course)")
    agreed = _turn_gains_agree(means, motion, lag, size)
    # noise weakens the gain: that of rates and course alike where units are told, all the course's for a number
    exact = float(lag.r2[0]) / size
    size /= float(np.sqrt(lag.r2[0]))
    need, kind = 1.0 / size, str(state.imu.kind)
    if state.scaling.determined and state.scaling.kind != kind:
        by_kind = 1.0 / state.imu.interval if state.scaling.kind == "increment" else state.imu.interval
        # the gyro may be right where the accelerometer is not
        if abs(np.log(need / by_kind)) < abs(np.log(need)):
            need, kind = need / by_kind, state.scaling.kind
        else:
            kind = "other"
    stated = stated_factor(state.recording.metadata.options, "gyro")
    evidence = {"turn_gain": size, "explained": float(lag.r2[0])}
    findings = gyro_unit.gyro_unit(
        need,
        state.imu.interval,
        stated,
        kind,
        evidence,
        "against the turns of the course",
        need * exact * size,
        gyro_unit.are_counts(state.imu.gyro / stated[1]),
    )
    state.findings += findings if agreed else [replace(f, confidence=min(f.confidence, 0.8)) for f in findings]
    state.gyro_factor = 1.0 / size


def _position_scale(state: DiagnosisState, pull: FloatArray) -> None:
    """Accelerations many times those of the path: its unit is wrong, if nothing else told so."""
    size = float(np.sqrt(pull[0] * pull[1]))
    state.estimates["acceleration_gain"] = size
    unit_codes = {"position_unit", "position_order", "velocity_unit", "velocity_wrong", "accel_unit", "accel_scale"}
    if any(f.code in unit_codes for f in state.findings) or not state.scaling.determined or 0.5 < size < 2.0:
        return
    evidence = {"gain": size}
    assert state.view is not None
    if abs(np.log(size * units.DEG)) < 0.35:
        text = (
            f"accelerations of the IMU are {size:.3g} times those of the path: latitude and longitude are "
            f"radians and were "
            "read as degrees"
        )
        state.findings.append(Finding("position_unit", "error", text, 0.95, "units='angle=rad'", evidence, "gnss"))
        return
    code = "position_unit" if state.view.source == "position" else "velocity_unit"
    text = f"accelerations of the IMU are {size:.3g} times those of the path: its unit is wrong"
    state.findings.append(Finding(code, "error", text, 0.6, "units='velocity=...' or 'angle=...'", evidence, "gnss"))


def find_upright(state: DiagnosisState) -> None:
    """Which way is up, where no motion tells more: a log at rest in one attitude.

    Parameters
    ----------
    work : Work
        Is added to.
    """
    rests = state.rests
    if rests is None or not len(rests) or not state.scaling.determined:
        return
    number, _ = support.poses(rests)
    if number != 1 or state.imu is None or _was_turned(state.imu, rests):
        return
    state.checked.append("which way is up")
    unit = rests.accel.mean(axis=0)
    unit = unit / np.linalg.norm(unit)
    k = int(np.argmax(np.abs(unit)))
    if (k == 2 and unit[2] < 0.0) or abs(unit[k]) < 0.7:
        return
    options = state.recording.metadata.options
    stated_axes = any("axes" in entry for entry in (options, *(e for e in options.values() if isinstance(e, dict))))
    evidence = {"specific_force_direction": unit.tolist(), "axes_stated": stated_axes}
    name = "xyz"[k]
    if k == 2:
        text = (
            "at rest specific force points along +z, where axes forward, right, down show it along -z: z points up "
            "(axes FLU, RFU, ...), or the log holds gravity instead of specific force; without motion the two "
            "look alike"
        )
        fix = "axes='FLU' or 'RFU' (as the sensor's drawing shows); or scale='accel=-1'"
        # who says what the axes are may have it upside down on the bench
        state.findings.append(Finding("axes", "note" if stated_axes else "warning", text, 0.7, fix, evidence))
    else:
        text = (
            f"at rest specific force points along {'-' if unit[k] < 0.0 else '+'}{name}: the sensor stands on its side"
        )
        state.findings.append(Finding("axes", "note", text, 0.6, "axes='...'", evidence))


def _was_turned(imu: ImuSeries, rests: UnscaledRests) -> bool:
    """Whether specific force points elsewhere than at rest for more than a fiftieth of the log: turned by hand."""
    per = max(10, round(1.0 / imu.interval))
    m = len(imu) // per
    means = imu.accel[: m * per].reshape(m, per, 3).mean(axis=1)
    rest = rests.accel.mean(axis=0)
    cosine = means @ rest / np.maximum(np.linalg.norm(means, axis=1) * np.linalg.norm(rest), 1e-300)
    return bool(np.mean(cosine < np.cos(35.0 * units.DEG)) > 0.02)


def find_turns(state: DiagnosisState, imu: ImuSeries) -> None:
    """Gyro against gravity between rests, where a course did not tell.

    Parameters
    ----------
    work : Work
        Is added to.
    imu : ImuSeries
    """
    if "unit of angular rate (course)" in state.checked or state.rests is None or not imu.gyro.any():
        return
    turns = gyro_unit.turns_between(imu.rates(), state.rests)
    if turns is None or (len(turns) < 2 and float(turns.angle.max()) < 0.5):
        return
    state.checked.append("unit of angular rate (turns of gravity)")
    stated = stated_factor(state.recording.metadata.options, "gyro")
    counts = imu.kind == "rate" and gyro_unit.are_counts(imu.gyro / stated[1])
    factor, P, evidence = gyro_unit.by_turns(turns, imu.interval, stated, counts)
    if factor is None:
        text = (
            f"gravity turns by {evidence['turn_deg']:.0f} deg between rests and no unit and no axes of the "
            f"gyro explain it "
            f"({evidence['misfit_deg']:.0f} deg off at best)"
        )
        state.findings.append(Finding("unchecked", "note", text, 0.5, "", evidence))
        return
    state.gyro_factor = factor
    need, kind = factor, str(imu.kind)
    if state.scaling.determined and state.scaling.kind != kind:
        by_kind = 1.0 / imu.interval if state.scaling.kind == "increment" else imu.interval
        need, kind = need / by_kind, state.scaling.kind
    findings = gyro_unit.gyro_unit(
        need, imu.interval, stated, kind, evidence, "against turns of gravity between rests", counts=counts
    )
    notes = state.recording.metadata.notes
    if any("raw counts" in note for note in notes):
        findings = []
    if any("stamps are counted at" in note for note in notes):  # a rate that is wrong looks like a scale
        findings = [gyro_unit.or_of_the_rate(f, 1.0 / imu.interval, need * stated[1]) for f in findings]
    agreed = gyro_unit.halves_agree(turns, factor * P)
    state.findings += findings if agreed else [replace(f, confidence=min(f.confidence, 0.9)) for f in findings]
    state.findings += gyro_unit.gyro_axes(P, evidence, agreed=agreed)


def find_mounting(state: DiagnosisState, ev: AxesEvidence, A: FloatArray) -> None:
    """Mount angles left over from the nearest permutation, and the lever arm.

    Parameters
    ----------
    work : Work
        Is added to.
    ev : AxesEvidence
    A : ndarray, shape (3, 3)
        The permutation found.
    """
    B = ev.B / np.maximum(np.linalg.norm(ev.B, axis=0), 1e-12)
    weight = 1.0 / np.maximum(ev.sigma, 0.02)
    # nearest rotation R of sensor axes put right: B = A^T-permuted
    U, _, Vt = np.linalg.svd((A.T @ B) * weight)
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    angles = np.array(rotation.rpy_from_dcm(R.T)) / units.DEG
    sigma = np.array([ev.sigma[2], ev.sigma[0] + 0.02, ev.sigma[1]]) / units.DEG
    state.estimates["mount_deg"] = angles.tolist()
    state.estimates["mount_sigma_deg"] = sigma.tolist()
    if np.abs(angles).max() > 3.0:
        text = (
            f"beside its axes the sensor is mounted turned by roll {angles[0]:.1f}, pitch {angles[1]:.1f}, yaw "
            f"{angles[2]:.1f} deg (1-sigma about {sigma.max():.1f} deg; a level road is assumed)"
        )
        severity: Severity = "warning" if np.abs(angles).max() > 20.0 else "note"
        findings = Finding(
            "mount", severity, text, 0.8, "mount angles in the configuration", {"angles_deg": angles.tolist()}
        )
        state.findings.append(findings)
    if np.all(np.isfinite(ev.arm)) and np.all(np.abs(ev.arm) < 20.0):
        state.estimates["lever_arm_m"] = ev.arm.tolist()
        state.estimates["lever_arm_sigma_m"] = ev.arm_sigma.tolist()
        if np.any(np.abs(ev.arm) > 3.0 * ev.arm_sigma) and np.abs(ev.arm).max() > 0.5:
            text = (
                f"the antenna is roughly {ev.arm[0]:+.1f} m forward and {ev.arm[1]:+.1f} m right of the IMU (1-sigma "
                f"{ev.arm_sigma[0]:.1f}, {ev.arm_sigma[1]:.1f} m), by what turning adds to specific force"
            )
            evidence = {"arm_m": ev.arm.tolist(), "sigma_m": ev.arm_sigma.tolist()}
            state.findings.append(Finding("lever_arm", "note", text, 0.6, "lever arm in the configuration", evidence))
