"""All checks of one recording, in the order in which each needs what the ones before it found."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from schuler import earth, rotation, timebase, units
from schuler.arrays import FloatArray
from schuler.diagnosis import gnss_quality, gyro_unit, heights, positions, sampling, support
from schuler.diagnosis.accel_unit import Scaling, accel_unit, stated_factor
from schuler.diagnosis.axes import AxesEvidence, Guess, axes_findings, judge, measure_axes, scores
from schuler.diagnosis.diagnosis import Diagnosis
from schuler.diagnosis.findings import CODES, SEVERITIES, Finding, Severity
from schuler.diagnosis.lag import Lag, at_ahead, find_ahead, find_lag
from schuler.diagnosis.motion import Motion, WindowMeans, motion_of
from schuler.diagnosis.rests import Rests, find_rests
from schuler.exceptions import SchulerError
from schuler.recording.io.hints import axes_matrix
from schuler.recording.recording import Recording
from schuler.recording.series import GnssSeries, ImuSeries

_USUAL_GRAVITY = 9.806  # where nothing is known of the place [m/s^2]
_LEAST_OFFSET = 0.05  # of a clock, worth a word [s]
_VEHICLE = 0.4  # share of accelerations that the path explains, of a body that goes where it points
_HAND = 0.8  # offset that a body turning against its course cannot explain [s]
_ALONE = 0.12  # the same where only positions or only velocities tell [s]


@dataclass
class _Work:
    """What is found on the way."""

    recording: Recording
    findings: list[Finding] = field(default_factory=list)
    checked: list[str] = field(default_factory=list)
    estimates: dict[str, Any] = field(default_factory=dict)
    curves: dict[str, FloatArray] = field(default_factory=dict)
    gravity: float = _USUAL_GRAVITY
    scaling: Scaling = field(default_factory=Scaling)
    gyro_factor: float = 1.0
    rests: Rests | None = None
    imu: ImuSeries | None = None
    gnss: GnssSeries | None = None
    view: positions.GnssView | None = None
    motion: Motion | None = None
    lag: Lag | None = None
    means: WindowMeans | None = None
    apart: Lag | None = None


def diagnose(recording: Recording, *, findings: tuple[Finding, ...] = (), quick: bool = False) -> Diagnosis:
    """Check a recording by physics.

    Parameters
    ----------
    recording : Recording
        As read, with whatever is wrong in it: nothing is assumed of units, axes, signs and clocks.
    findings : tuple of Finding
        What was found before, on reading the file.
    quick : bool
        Only what can make results garbage: units, kinds, axes, clocks, positions. Leaves out the quality of sampling
        and of the GNSS solution.

    Returns
    -------
    Diagnosis
        Never raises for what is wrong with the log: that is a finding.

    Notes
    -----
    ================  ==================================================================================================
    rest norm         unit of specific force, rates or increments
    positions         displacements against the integral of velocity: units, order, axes, signs
    clock             shift at which regression on the IMU explains turn rate and accelerations best
    axes              regression at that shift, scored for all 48 signed permutations, gravity and gyro signs
    angular unit      turn rate of the course, or turns of gravity between rests
    heights           against a reference or single points, else what the file says
    sampling          gaps, jitter, held, stuck, saturated, interpolated, rounded, spikes
    ================  ==================================================================================================
    """
    work = _Work(recording, list(findings), imu=recording.imu, gnss=recording.gnss)
    if work.gnss is None and recording.imu is not None and (recording.ranges is not None or not quick):
        work.gnss = heights.single_points(recording)
    _place(work)
    _imu(work)
    _gnss(work)
    _together(work)
    if not quick:
        _quality(work)
        work.findings += heights.check_heights(recording)
    _unchecked(work)
    order = list(CODES)
    found = sorted(work.findings, key=lambda f: (SEVERITIES.index(f.severity), order.index(f.code)))
    rates = None if work.imu is None else work.imu.rates()
    if rates is not None and work.motion is not None and work.lag is not None and work.lag.found:
        # constant velocity looks like rest to an IMU
        work.rests = find_rests(rates, (work.motion.t - work.lag.offset, work.motion.speed))
    return Diagnosis(
        recording.metadata.name,
        tuple(_merged(found)),
        work.estimates,
        () if work.imu is None or work.rests is None else support.segments(work.imu, work.rests),
        () if quick else support.uses(recording, rates, work.rests, work.motion),
        tuple(work.checked),
        work.curves,
    )


def _merged(findings: list[Finding]) -> list[Finding]:
    """One finding of a code for each part: the surest, others of the same kind (axes of one sensor) kept as "
    "they are.
    """
    kept: list[Finding] = []
    several = {"stuck", "saturated", "unchecked"}
    for f in findings:
        same = [k for k, g in enumerate(kept) if g.code == f.code and g.part == f.part]
        if same and f.code not in several:
            if f.confidence > kept[same[0]].confidence:
                kept[same[0]] = f
            continue
        kept.append(f)
    return kept


def _place(work: _Work) -> None:
    gnss = work.gnss
    if gnss is not None and len(gnss):
        lat, h = float(np.median(gnss.llh[:, 0])), float(np.median(gnss.llh[:, 2]))
        if -1000.0 < h < 50_000.0:
            work.gravity = float(earth.gravity_somigliana(lat, h))


def _imu(work: _Work) -> None:
    imu = work.imu
    if imu is None or len(imu) < 10:
        work.imu = None
        return
    work.checked.append("unit of specific force")
    rates = imu.rates()
    if imu.accel.any():
        work.rests = find_rests(rates)
        stated = stated_factor(work.recording.metadata.options, "accel")
        counts = any("raw counts" in note for note in work.recording.metadata.notes)
        found, work.scaling = accel_unit(rates.accel, work.rests, imu.interval, imu.kind, work.gravity, stated)
        if counts:
            found = [replace(f, severity="note") for f in found]
        work.findings += found
        step = max(1, len(imu) // 4000)
        work.curves["norm"] = np.stack(
            (imu.t[::step], np.linalg.norm(rates.accel[::step], axis=1) * work.scaling.factor), axis=1
        )
    else:
        work.rests = find_rests(rates)
    work.curves["rests"] = work.rests.t


def _gnss(work: _Work) -> None:
    gnss = work.gnss
    if gnss is None or len(gnss) < 10:
        return
    work.checked.append("positions against velocities")
    work.findings += positions.plausible_place(gnss)
    found, work.view = positions.check_positions(gnss)
    work.findings += found


def _together(work: _Work) -> None:
    """Clock, axes and angular unit of the IMU against GNSS, or of its sensors against each other."""
    imu, view = work.imu, work.view
    if imu is None:
        return
    if view is not None and len(imu) > 100:
        work.motion = motion_of(view.t, view.v_n, work.gravity)
        if _alone(work) and (work.motion is None or not work.motion.enough):
            _try_radians(work, view, imu)
    motion = work.motion
    if motion is not None and _overlaps(work, imu, motion) and motion.enough:
        means = _clock(work, imu, motion)
        if work.lag is not None and work.lag.found:
            _axes(work, means, motion, work.lag)
    if work.apart is not None and motion is not None:
        moved = WindowMeans(imu.shifted(work.apart.offset))
        work.lag, work.means = replace(work.apart, offset=0.0), moved
        _axes(work, moved, motion, work.lag)
    if "axes" not in work.checked:
        _upright(work)
    _turns(work, imu)


def _alone(work: _Work) -> bool:
    """Whether there are positions without velocities."""
    return work.view is not None and work.view.source == "position" and work.gnss is not None and work.gnss.v_n is None


def _try_radians(work: _Work, view: positions.GnssView, imu: ImuSeries) -> None:
    """Positions that hardly move: radians read as degrees, if the IMU moved as they did, 57 times as much."""
    larger = view.v_n * np.array([1.0 / units.DEG, 1.0 / units.DEG, 1.0])
    motion = motion_of(view.t, larger, work.gravity)
    if motion is None or not motion.enough or min(imu.t[-1], motion.t[-1]) - max(imu.t[0], motion.t[0]) < 20.0:
        return
    lag = find_lag(WindowMeans(imu), motion)
    if not lag.found or lag.r2.max() < 0.6:
        return
    text = (
        "the IMU moved as the positions say, but 57 times as much: latitude and longitude are radians and were read as "
        "degrees"
    )
    evidence = {"explained": lag.r2.tolist()}
    work.findings.append(Finding("position_unit", "error", text, 0.85, "units='angle=rad'", evidence, "gnss"))
    work.view = replace(view, v_n=larger)
    work.motion = motion


def _time_unit(work: _Work, imu: ImuSeries, t: FloatArray) -> bool:
    """Whether the IMU's log lasts a power of a thousand times as long as the GNSS log; finding ``time_unit``."""
    ratio = float((imu.t[-1] - imu.t[0]) / max(t[-1] - t[0], 1e-9))
    for power in (3, 6, 9, -3, -6, -9):
        if not 0.5 < ratio / 10.0**power < 2.0:
            continue
        unit = {3: "ms", 6: "us", 9: "ns"}.get(abs(power), "")
        said = f"the stamps are {unit}, not s" if power > 0 else f"the stamps are s, not {unit}"
        text = (
            f"the IMU's log lasts {ratio:.3g} times as long as the GNSS log (an interval of {imu.interval:.3g} "
            f"s): {said}"
        )
        fix = f"units='t={unit}'" if power > 0 else "units='t=s'"
        work.findings.append(Finding("time_unit", "error", text, 0.95, fix, {"ratio": ratio}))
        return True
    return False


def _overlaps(work: _Work, imu: ImuSeries, motion: Motion) -> bool:
    if _time_unit(work, imu, motion.t):
        return False
    a, b = max(imu.t[0], motion.t[0]), min(imu.t[-1], motion.t[-1])
    if b - a > 20.0:
        return True
    t = work.gnss.t if work.gnss is not None else motion.t
    evidence: dict[str, Any] = {
        "imu_s": [float(imu.t[0]), float(imu.t[-1])],
        "gnss_s": [float(t[0]), float(t[-1])],
    }
    apart = float(t[0] - imu.t[0])
    guess = ""
    for name, value in (
        ("a GPS week", timebase.WEEK_S),
        ("the epochs of Unix and GPS time", timebase.UNIX_TO_GPS_S),
        ("an hour (a time zone)", 3600.0),
    ):
        n = round(apart / value)
        if n != 0 and abs(apart - n * value) < min(0.05 * value, 1500.0) and abs(n) < (30 if value == 3600.0 else 3000):
            guess = f"; they are about {abs(n)} times {name} apart"
            break
    text = (
        f"IMU ({imu.t[0]:.1f}..{imu.t[-1]:.1f} s) and GNSS ({t[0]:.1f}..{t[-1]:.1f} s) have no time in common worth "
        f"using{guess}"
    )
    fix = "time='gps-tow:WEEK' (or unix, gps) for each file; or offset=..."
    if motion.enough and imu.t[-1] - imu.t[0] > 40.0:
        lag = find_lag(WindowMeans(imu), motion, apart)
        if lag.found:
            work.apart = lag
            evidence["offset_s"] = lag.offset
            evidence["sigma_s"] = lag.sigma
            text += f"; the same motion is in both, {lag.offset:+.3f} s apart (1-sigma {lag.sigma:.3f} s)"
            fix = f"offset={lag.offset:.3f} for the IMU, or the right meaning of its stamps (time=...)"
    work.findings.append(Finding("no_overlap", "error", text, 0.99, fix, evidence))
    return False


def _clock(work: _Work, imu: ImuSeries, motion: Motion) -> WindowMeans:
    """Offset and drift of the IMU's clock; findings and means with its drift taken out."""
    assert work.view is not None
    work.checked.append("IMU clock against GNSS")
    means = WindowMeans(imu)
    lag = find_lag(means, motion)
    span = float(motion.t[-1] - motion.t[0])
    middle = float(motion.t[motion.moving].mean())
    drift, drift_sigma = 0.0, lag.drift_sigma
    for _ in range(3):
        if not (abs(lag.drift) * span > 0.15 and abs(lag.drift) > 4.0 * lag.drift_sigma):
            break
        drift += lag.drift
        bent = imu.t + drift * (imu.t - middle)
        if np.any(np.diff(bent) <= 0.0):
            break
        means = WindowMeans(replace(imu, t=bent))
        lag = find_lag(means, motion)
        drift_sigma = lag.drift_sigma
    work.curves["lag"] = lag.curve
    ahead = 0.0
    if lag.found and lag.r2[1:].min() > _VEHICLE:
        far, at, gain = find_ahead(means, motion, lag.offset)
        work.estimates["antenna_ahead_of_axle_m"] = far
        if gain > 10.0 and abs(far) > 0.5:
            ahead = far
            lag = replace(lag, offset=at, sigma=float(np.hypot(lag.sigma, 0.02)))
    work.lag, work.means = lag, means
    evidence = {
        "offset_s": lag.offset,
        "sigma_s": lag.sigma,
        "explained": lag.r2.tolist(),
        "lead": lag.clear,
    }
    if not lag.found:
        text = (
            "no shift of its clock makes the IMU explain the motion that GNSS tells "
            f"({100.0 * lag.r2.max():.0f} % at best): another run, one of them not moving, or clocks more than "
            f"400 s apart"
        )
        work.findings.append(Finding("unchecked", "note", text, 0.5, "", evidence))
        return means
    offset, sigma, gap = _both(work, means, lag, ahead)
    evidence |= {"offset_s": offset, "sigma_s": sigma, "position_minus_velocity_s": gap}
    if drift:
        # at the start of the log, where a counter of a wrong rate is still right
        offset += drift * (float(imu.t[0]) - middle)
        evidence["offset_s"] = offset
    work.estimates["time_offset_s"] = offset
    work.estimates["time_offset_sigma_s"] = sigma
    work.estimates["explained_by_imu"] = lag.r2.tolist()
    if drift:
        work.estimates["clock_drift_ppm"] = 1e6 * drift
    _offset_finding(work, offset, sigma, gap, evidence)
    if gap is not None and abs(gap) > 0.1:
        text = (
            f"velocities are {abs(gap):.3f} s {'late' if gap < 0.0 else 'early'} against positions by the "
            f"IMU's motion: they "
            "were filtered or are means over an interval"
        )
        work.findings.append(Finding("gnss_delay", "note", text, 0.7, "", {"gap_s": gap}, "gnss"))
    total = abs(drift) * span
    if total > 0.25 and abs(drift) > 5.0 * drift_sigma:
        text = (
            f"the IMU's clock runs {1e6 * -drift:+.0f} ppm fast against GNSS, {total:.3g} s over this log: its "
            f"stamps, or "
            "the stated rate, are not those of the samples"
        )
        fix = f"rate={imu.rate_hz / (1.0 + drift):.6g} (if the log has no stamps), or stamps of a disciplined clock"
        work.findings.append(
            Finding("clock_drift", "warning", text, 0.9, fix, {"drift": drift, "sigma": drift_sigma, "total_s": total})
        )
    return means


def _both(work: _Work, means: WindowMeans, lag: Lag, ahead: float) -> tuple[float, float, float | None]:
    """Offset by velocities and by positions, their mean, its 1-sigma, and position minus velocity."""
    assert work.view is not None
    if work.view.other is None or work.view.mirrored:
        return lag.offset, lag.sigma, None
    other = motion_of(*work.view.other, work.gravity)
    if other is None or not other.enough:
        return lag.offset, lag.sigma, None
    by_position = find_lag(means, other, lag.offset)
    if not by_position.found or abs(by_position.offset - lag.offset) > 1.0 or by_position.r2.max() < 0.7 * lag.r2.max():
        return lag.offset, lag.sigma, None
    if ahead:
        by_position = replace(by_position, offset=at_ahead(means, other, lag.offset, ahead))
    gap = by_position.offset - lag.offset
    sigma = float(np.sqrt(0.25 * (lag.sigma**2 + by_position.sigma**2) + (0.25 * gap) ** 2))
    return 0.5 * (lag.offset + by_position.offset), sigma, gap


def _offset_finding(work: _Work, offset: float, sigma: float, gap: float | None, evidence: dict[str, Any]) -> None:
    # positions and velocities of one receiver differ by a tenth of a second: either alone says less
    limit = max(_ALONE if gap is None else _LEAST_OFFSET + 0.25 * abs(gap), 3.0 * sigma)
    if "clock_drift_ppm" in work.estimates:
        limit = max(limit, 0.3)
    if work.lag is not None and work.lag.r2[1:].max() < _VEHICLE:
        # a hand turns before or after the walker's course does
        limit = max(limit, _HAND)
    if abs(offset) < limit:
        return
    whole = round(abs(offset))
    near = abs(abs(offset) - whole) < max(0.35, 3.0 * sigma)
    leaps = _leaps(work)
    side = "late" if offset < 0.0 else "early"
    said = f"the IMU's clock is {abs(offset):.3f} s {side} against GNSS (1-sigma {sigma:.3f} s)"
    fix = f"offset={offset:.3f} for the IMU"
    if near and whole in leaps:
        text = f"{said}: these are the leap seconds between UTC and GPS time, one log counts UTC and the other GPS time"
        fix = f"time='unix' (UTC) or 'gps-unix'/'gps' for the right file, or offset={float(np.sign(offset)) * whole:g}"
        work.findings.append(Finding("leap_seconds", "error", text, 0.97 if whole == leaps[0] else 0.85, fix, evidence))
        rest = offset - np.sign(offset) * whole
        if abs(rest) > max(limit, 0.1):
            text = f"besides the leap seconds the IMU's clock is {abs(rest):.3f} s {'late' if rest < 0 else 'early'}"
            work.findings.append(
                Finding("time_offset", "warning", text, 0.8, f"offset={offset:.3f} for the IMU", evidence)
            )
        return
    confidence = float(np.clip(1.0 - np.exp(-0.5 * (offset / sigma) ** 2 / 4.0), 0.5, 0.99))
    if whole >= 1 and near:
        said += f", {whole} whole second{'s' * (whole != 1)}"
    severity: Severity = "error" if abs(offset) > 0.5 else "warning"
    work.findings.append(Finding("time_offset", severity, said, confidence, fix, evidence))


def _leaps(work: _Work) -> list[int]:
    """Leap seconds that may be meant, those of the day first."""
    base = work.recording.metadata.time
    out = []
    if base.scale == "gps":
        with contextlib.suppress(SchulerError):
            out.append(timebase.leap_seconds(timebase.calendar(base.epoch_gps_s).date()))
    return [*out, *(n for n in (18, 17, 16, 15) if n not in out)]


def _axes(work: _Work, means: WindowMeans, motion: Motion, lag: Lag) -> None:
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
    forward = bool(lag.r2[1] > _VEHICLE and lag.r2[2] > _VEHICLE)
    _angular_unit(work, ev, lag)
    if forward:
        _position_scale(work, pull)
    best, rivals = judge(ev, work.gyro_factor, forward_known=forward)
    if work.view is not None and work.view.mirrored:
        best, rivals, ev = _unmirrored(work, means, lag, level, (best, rivals, ev), forward_known=forward)
    as_read = axes_matrix(_axes_hint(work.recording))
    work.findings += axes_findings(best, rivals, ev, as_read, forward_known=forward)
    if forward:
        _mounting(work, ev, best.A)


def _pictures(work: _Work, means: WindowMeans, motion: Motion, lag: Lag, ev: AxesEvidence) -> None:
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
    work: _Work,
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


def _angular_unit(work: _Work, ev: AxesEvidence, lag: Lag) -> None:
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


def _position_scale(work: _Work, pull: FloatArray) -> None:
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


def _mounting(work: _Work, ev: AxesEvidence, A: FloatArray) -> None:
    """Mount angles left over from the nearest permutation, and the lever arm."""
    B = ev.B / np.maximum(np.linalg.norm(ev.B, axis=0), 1e-12)
    weight = 1.0 / np.maximum(ev.sigma, 0.02)
    # nearest rotation R of sensor axes put right: B = A^T-permuted
    U, _, Vt = np.linalg.svd((A.T @ B) * weight)
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    angles = np.array(rotation.rpy_from_dcm(R.T)) / units.DEG
    sigma = np.array([ev.sigma[2], ev.sigma[0] + 0.02, ev.sigma[1]]) / units.DEG
    work.estimates["mount_deg"] = angles.tolist()
    work.estimates["mount_sigma_deg"] = sigma.tolist()
    if np.abs(angles).max() > 3.0:
        text = (
            f"beside its axes the sensor is mounted turned by roll {angles[0]:.1f}, pitch {angles[1]:.1f}, yaw "
            f"{angles[2]:.1f} deg (1-sigma about {sigma.max():.1f} deg; a level road is assumed)"
        )
        severity: Severity = "warning" if np.abs(angles).max() > 20.0 else "note"
        found = Finding(
            "mount", severity, text, 0.8, "mount angles in the configuration", {"angles_deg": angles.tolist()}
        )
        work.findings.append(found)
    if np.all(np.isfinite(ev.arm)) and np.all(np.abs(ev.arm) < 20.0):
        work.estimates["lever_arm_m"] = ev.arm.tolist()
        work.estimates["lever_arm_sigma_m"] = ev.arm_sigma.tolist()
        if np.any(np.abs(ev.arm) > 3.0 * ev.arm_sigma) and np.abs(ev.arm).max() > 0.5:
            text = (
                f"the antenna is roughly {ev.arm[0]:+.1f} m forward and {ev.arm[1]:+.1f} m right of the IMU (1-sigma "
                f"{ev.arm_sigma[0]:.1f}, {ev.arm_sigma[1]:.1f} m), by what turning adds to specific force"
            )
            evidence = {"arm_m": ev.arm.tolist(), "sigma_m": ev.arm_sigma.tolist()}
            work.findings.append(Finding("lever_arm", "note", text, 0.6, "lever arm in the configuration", evidence))


def _upright(work: _Work) -> None:
    """Which way is up, where no motion tells more: a log at rest in one attitude."""
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
    said = not any("Axes are not stated" in note for note in work.recording.metadata.notes)
    evidence = {"specific_force_direction": unit.tolist(), "axes_stated": said}
    name = "xyz"[k]
    if k == 2:
        text = (
            "at rest specific force points along +z, where axes forward, right, down show it along -z: z points up "
            "(axes FLU, RFU, ...), or the log holds gravity instead of specific force; without motion the two "
            "look alike"
        )
        fix = "axes='FLU' or 'RFU' (as the sensor's drawing shows); or scale='accel=-1'"
        work.findings.append(Finding("axes", "warning", text, 0.7, fix, evidence))
    else:
        text = (
            f"at rest specific force points along {'-' if unit[k] < 0.0 else '+'}{name}: the sensor stands on its side"
        )
        work.findings.append(Finding("axes", "note", text, 0.6, "axes='...'", evidence))


def _turns(work: _Work, imu: ImuSeries) -> None:
    """Gyro against gravity between rests, where a course did not tell."""
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


def _quality(work: _Work) -> None:
    imu = work.imu
    if imu is not None and work.rests is not None:
        work.checked.append("sampling and readings")
        work.findings += sampling.check_times(imu.t)
        found = sampling.check_readings(imu, work.rests, (work.scaling.factor, work.gyro_factor))
        notes = " ".join(work.recording.metadata.notes)
        if "raw counts" in notes:
            found = [f for f in found if f.code not in ("imu_noise", "quantised", "spikes")]
        if "its values are zero" in notes:
            found = [f for f in found if f.code != "dead_axis"]
        work.findings += found
    gnss = work.recording.gnss
    if gnss is not None and work.view is not None:
        work.checked.append("GNSS quality")
        found = gnss_quality.check_gnss(gnss, _comparable(work))
        if any(f.code == "height_unit" for f in work.findings):
            found = [f for f in found if f.code != "gnss_noise"]
        work.findings += found
        if any(f.code == "clock_drift" for f in work.findings):
            return  # turns are smeared by the clock already
        if work.motion is not None and work.lag is not None and work.lag.r2[0] > 0.5 and imu is not None:
            work.findings += gnss_quality.check_smoothing(WindowMeans(imu), work.motion, work.lag)


def _comparable(work: _Work) -> positions.GnssView:
    """The view of GNSS without a velocity that does not fit the positions anyhow."""
    assert work.view is not None
    spoilt = {"height_unit", "position_unit", "position_order", "velocity_wrong"}
    if work.view.mirrored or any(f.code in spoilt for f in work.findings):
        return replace(work.view, other=None)
    return work.view


def _unchecked(work: _Work) -> None:
    """What this log could not tell."""
    left = []
    if work.imu is not None and not any(c.startswith("unit of angular rate") for c in work.checked):
        left.append("the unit of angular rate (no turns of gravity between rests, no course)")
    if work.imu is not None and work.gnss is not None and "IMU clock against GNSS" not in work.checked:
        left.append("the IMU's clock and axes against GNSS (too little motion)")
    if left:
        work.findings.append(Finding("unchecked", "note", "not checked: " + "; ".join(left), 1.0))
