"""The IMU's clock against GNSS: whether the two logs overlap, the offset, leap seconds, a rate of its own."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from typing import Any

import numpy as np

from schuler import timebase
from schuler.arrays import FloatArray
from schuler.diagnosis.lag import Lag, at_ahead, find_ahead, find_lag, log_likelihood
from schuler.diagnosis.motion import Motion, WindowMeans, motion_of
from schuler.diagnosis.result import SURE, Finding, Severity
from schuler.diagnosis.sampling import counted_rate
from schuler.diagnosis.state import VEHICLE, DiagnosisState
from schuler.exceptions import SchulerError
from schuler.recording.series import ImuSeries

_LEAST_OFFSET = 0.05  # of a clock, worth a word [s]
_HAND = 0.8  # offset that a body turning against its course cannot explain [s]
_ALONE = 0.12  # the same where only positions or only velocities tell [s]
_GARBAGE = 0.5  # offset that makes results garbage [s]
_RIGHT_S = 0.3  # a clock that is right may seem off by as much: delays, lever arms [s]
_ASTRAY = 0.9  # likelihood at most of a body that does not go where it points, whose motion is not modelled
_DISTINCT = 12.0  # log-likelihood by which a wrong clock must lead the right one


def _time_unit(state: DiagnosisState, imu: ImuSeries, t: FloatArray) -> bool:
    """Whether the IMU's log lasts a power of a thousand times as long as the GNSS log; finding ``time_unit``."""
    ratio = float((imu.t[-1] - imu.t[0]) / max(t[-1] - t[0], 1e-9))
    for power in (3, 6, 9, -3, -6, -9):
        if not 0.5 < ratio / 10.0**power < 2.0:
            continue
        unit = {3: "ms", 6: "us", 9: "ns"}.get(abs(power), "")
        statement = f"the stamps are {unit}, not s" if power > 0 else f"the stamps are s, not {unit}"
        text = (
            f"the IMU's log lasts {ratio:.3g} times as long as the GNSS log (an interval of {imu.interval:.3g} "
            f"s): {statement}"
        )
        fix = f"units='t={unit}'" if power > 0 else "units='t=s'"
        # samples further apart than any logger's, or closer, leave no doubt
        sure = 0.7 if 5e-4 < imu.interval < 0.1 else 0.99
        state.findings.append(Finding("time_unit", "error", text, sure, fix, {"ratio": ratio}))
        return True
    return False


def overlaps(state: DiagnosisState, imu: ImuSeries, motion: Motion) -> bool:
    """Whether IMU and GNSS have 20 s in common; if not, findings ``time_unit`` or ``no_overlap``, and ``work.apart``.

    Parameters
    ----------
    work : Work
        Is added to.
    imu : ImuSeries
    motion : Motion
    """
    if _time_unit(state, imu, motion.t):
        return False
    a, b = max(imu.t[0], motion.t[0]), min(imu.t[-1], motion.t[-1])
    if b - a > 20.0:
        return True
    t = state.gnss.t if state.gnss is not None else motion.t
    common = float(min(imu.t[-1], t[-1]) - max(imu.t[0], t[0]))
    if common > 0.5 * min(imu.t[-1] - imu.t[0], t[-1] - t[0]):
        return False  # short logs, but of one time
    evidence: dict[str, Any] = {
        "imu_s": [float(imu.t[0]), float(imu.t[-1])],
        "gnss_s": [float(t[0]), float(t[-1])],
    }
    apart = float(t[0] - imu.t[0])
    guess, whole = "", 0.0
    for name, value in (
        ("a GPS week", timebase.WEEK_S),
        ("the epochs of Unix and GPS time", timebase.UNIX_TO_GPS_S),
        ("an hour (a time zone)", 3600.0),
    ):
        n = round(apart / value)
        if n != 0 and abs(apart - n * value) < min(0.05 * value, 1500.0) and abs(n) < (30 if value == 3600.0 else 3000):
            guess, whole = f"; they are about {abs(n)} times {name} apart", n * value
            break
    text = (
        f"IMU ({imu.t[0]:.1f}..{imu.t[-1]:.1f} s) and GNSS ({t[0]:.1f}..{t[-1]:.1f} s) have "
        f"{f'only {common:.0f} s' if common > 1.0 else 'no time'} in common{guess}"
    )
    fix = "time='gps-tow:WEEK' (or unix, gps) for each file; or offset=..."
    if motion.enough and imu.t[-1] - imu.t[0] > 40.0:
        lag = find_lag(WindowMeans(imu), motion, apart)
        if lag.matched:
            state.apart = lag
            evidence["offset_s"] = lag.offset
            evidence["sigma_s"] = lag.sigma
            text += f"; the same motion is in both, {lag.offset:+.3f} s apart (1-sigma {lag.sigma:.3f} s)"
            exact = whole if abs(lag.offset - whole) < 3.0 * lag.sigma else lag.offset  # such as the hours of a zone
            fix = f"offset={state.offset + exact:.3f} (or the right meaning of the IMU's stamps, time=...)"
    severity: Severity = "error" if common <= 1.0 else "warning"
    state.findings.append(Finding("no_overlap", severity, text, 0.99, fix, evidence))
    return False


def find_clock(state: DiagnosisState, imu: ImuSeries, motion: Motion) -> WindowMeans:
    """Offset and drift of the IMU's clock: findings, ``state.lag``, estimates.

    Parameters
    ----------
    state : DiagnosisState
        Is added to.
    imu : ImuSeries
    motion : Motion

    Returns
    -------
    WindowMeans
        Means of the IMU with the drift of its clock taken out.
    """
    assert state.view is not None
    state.checked.append("IMU clock against GNSS")
    means = WindowMeans(imu)
    lag = _likeliest(means, motion)
    span = float(motion.t[-1] - motion.t[0])
    middle = float(motion.t[motion.moving].mean())
    means, lag, drift, drift_sigma = _drift(imu, means, lag, motion)
    state.curves["lag"] = lag.curve
    ahead = 0.0
    if lag.matched and lag.r2[1:].min() > VEHICLE:
        distance, at, gain = find_ahead(means, motion, lag.offset)
        state.estimates["antenna_ahead_of_axle_m"] = distance
        if gain > 10.0 and abs(distance) > 0.5:
            ahead = distance
            lag = replace(lag, offset=at, sigma=float(np.hypot(lag.sigma, 0.02)))
    state.lag = lag
    evidence = {
        "offset_s": lag.offset,
        "sigma_s": lag.sigma,
        "explained": lag.r2.tolist(),
        "lead": lag.clear,
    }
    if not lag.matched:
        text = (
            "no shift of its clock makes the IMU explain the motion that GNSS tells "
            f"beyond doubt ({100.0 * lag.r2.max():.0f} % at best): fixes too noisy, too little motion, a body that "
            "does not go where it points, another run, or clocks more than 400 s apart"
        )
        state.findings.append(Finding("unchecked", "note", text, 0.5, "", evidence))
        return means
    offset, sigma, gap = _mean_offset(state, means, lag, ahead)
    evidence |= {"offset_s": offset, "sigma_s": sigma, "position_minus_velocity_s": gap}
    if drift:
        # at the start of the log, where a counter of a wrong rate is still right
        offset += drift * (float(imu.t[0]) - middle)
        evidence["offset_s"] = offset
    state.estimates["time_offset_s"] = offset
    state.estimates["time_offset_sigma_s"] = sigma
    state.estimates["explained_by_imu"] = lag.r2.tolist()
    if drift:
        state.estimates["clock_drift_ppm"] = 1e6 * drift
    lead = wrong_clock_lead(means, motion, replace(lag, offset=offset))
    evidence |= {"lead_log_likelihood": lead}
    _offset_finding(state, offset, sigma, gap, lead, evidence)
    if gap is not None and abs(gap) > 0.1:
        state.findings.append(_delay_finding(gap))
    total = abs(drift) * span
    if total > 0.25 and abs(drift) > 5.0 * drift_sigma:
        state.findings.append(_drift_finding(imu, drift, drift_sigma, total))
    return means


def _drift(imu: ImuSeries, means: WindowMeans, lag: Lag, motion: Motion) -> tuple[WindowMeans, Lag, float, float]:
    """Means and lag with the clock's drift taken out, the drift and its 1-sigma [s/s]; zero if it explains no more."""
    span = float(motion.t[-1] - motion.t[0])
    middle = float(motion.t[motion.moving].mean())
    drift, drift_sigma = 0.0, lag.drift_sigma
    even = means, lag
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
    if drift and lag.evidence < even[1].evidence + _DISTINCT:
        return *even, 0.0, drift_sigma  # a clock of the right rate explains as much
    return means, lag, drift, drift_sigma


def _delay_finding(gap: float) -> Finding:
    """Velocities late or early against positions. [s]"""
    text = (
        f"velocities are {abs(gap):.3f} s {'late' if gap < 0.0 else 'early'} against positions by the IMU's motion: "
        "they were filtered or are means over an interval"
    )
    return Finding("gnss_delay", "note", text, 0.7, "", {"gap_s": gap}, "gnss")


def _drift_finding(imu: ImuSeries, drift: float, sigma: float, total: float) -> Finding:
    """A clock of another rate than GNSS time: drift and 1-sigma [s/s], what it amounts to over the log [s]."""
    text = (
        f"the IMU's clock runs {1e6 * -drift:+.0f} ppm fast against GNSS, {total:.3g} s over this log: its stamps, or "
        "the stated rate, are not those of the samples"
    )
    rate, _ = counted_rate(imu.t)
    fix = "stamps of a disciplined clock"
    if rate is not None:
        fix = f"rate={rate / (1.0 + drift):.6g} (if the log has no stamps), or {fix}"
    return Finding("clock_drift", "warning", text, 0.9, fix, {"drift": drift, "sigma": sigma, "total_s": total})


def _likeliest(means: WindowMeans, motion: Motion) -> Lag:
    """The lag of the two logs: a clock that is right, unless a wrong one explains far more of the motion."""
    lag = find_lag(means, motion)
    if not lag.matched or abs(lag.offset) < 1.0 or wrong_clock_lead(means, motion, lag)[0] > _DISTINCT:
        return lag
    return find_lag(means, motion, near=True)


def wrong_clock_lead(means: WindowMeans, motion: Motion, lag: Lag) -> tuple[float, float, float]:
    """Log-likelihood by which an offset leads a clock that is right: of all of the motion, and of its two halves.

    Parameters
    ----------
    means : WindowMeans
    motion : Motion
    lag : Lag
    """
    right = np.linspace(-_RIGHT_S, _RIGHT_S, 7)
    middle = float(np.median(motion.t[motion.moving]))
    out = []
    for keep in (None, motion.t <= middle, motion.t > middle):
        wrong = log_likelihood(means, motion, np.array([lag.offset]), lag.samples, keep)[0]
        out.append(float(wrong - log_likelihood(means, motion, right, lag.samples, keep).max()))
    return out[0], out[1], out[2]


def likelihood_of_wrong_clock(lead: tuple[float, float, float]) -> float:
    """Likelihood that a clock is wrong which leads a right one so; both halves of the log must say so.

    Parameters
    ----------
    lead : (float, float, float)
        From :func:`wrong_clock_lead`.
    """
    least = min(lead[0] - _DISTINCT, 2.0 * min(lead[1:]))
    return float(np.clip(1.0 - 0.5 * np.exp(-least / 5.0), 0.5, 0.999))


def _mean_offset(
    state: DiagnosisState, means: WindowMeans, lag: Lag, ahead: float
) -> tuple[float, float, float | None]:
    """Offset by velocities and positions, weighted by what each is worth, its 1-sigma, and position minus velocity."""
    assert state.view is not None
    if state.view.other is None or state.view.mirrored:
        return lag.offset, lag.sigma, None
    other = motion_of(*state.view.other, state.gravity)
    if other is None or not other.enough:
        return lag.offset, lag.sigma, None
    by_position = find_lag(means, other, lag.offset, near=True)
    if (
        not by_position.matched
        or abs(by_position.offset - lag.offset) > 1.0
        or by_position.r2.max() < 0.7 * lag.r2.max()
    ):
        return lag.offset, lag.sigma, None
    if ahead:
        by_position = replace(by_position, offset=at_ahead(means, other, lag.offset, ahead))
    gap = by_position.offset - lag.offset
    variance = np.array([lag.sigma, by_position.sigma]) ** 2 + _LEAST_OFFSET**2
    share = float(variance[0] / variance.sum())  # of the positions
    spread = np.hypot((1.0 - share) * lag.sigma, share * by_position.sigma)
    return lag.offset + share * gap, float(np.hypot(spread, share * (1.0 - share) * gap)), gap


def _offset_finding(
    state: DiagnosisState,
    offset: float,
    sigma: float,
    gap: float | None,
    lead: tuple[float, float, float],
    evidence: dict[str, Any],
) -> None:
    # positions and velocities of one receiver differ by a tenth of a second: either alone says less
    limit = max(_ALONE if gap is None else _LEAST_OFFSET + 0.25 * abs(gap), 3.0 * sigma)
    if "clock_drift_ppm" in state.estimates:
        limit = max(limit, 0.3)
    spread = sigma
    if state.lag is not None and state.lag.r2[1:].max() < VEHICLE:
        # a hand turns before or after the walker's course does
        limit, spread = max(limit, _HAND), float(np.hypot(sigma, 0.5 * _HAND))
        state.estimates["time_offset_sigma_s"] = spread
    # just beyond what counts as right a right clock explains as much of necessity, and the offset is as sure as below
    if abs(offset) < limit or (abs(offset) > _RIGHT_S + 3.0 * sigma and lead[0] < 2.0):
        return  # a clock that is right explains as much
    wrong = likelihood_of_wrong_clock(lead)
    if state.lag is not None and state.lag.r2[0] < 0.5 and state.lag.r2[1:].min() < VEHICLE:
        wrong = min(wrong, _ASTRAY)
    seconds = round(abs(offset))
    near = abs(abs(offset) - seconds) < max(0.35, 3.0 * sigma)
    leaps = _leaps(state)
    side = "late" if offset < 0.0 else "early"
    statement = f"the IMU's clock is {abs(offset):.3f} s {side} against GNSS (1-sigma {spread:.3f} s)"
    fix = f"offset={state.offset + offset:.3f} for the IMU"
    if near and seconds in leaps:
        text = (
            f"{statement}: these are the leap seconds between UTC and GPS time, one log counts UTC and the other "
            "GPS time"
        )
        shift = state.offset + float(np.sign(offset)) * seconds
        fix = f"time='unix' (UTC) or 'gps-unix'/'gps' for the right file, or offset={shift:g}"
        state.findings.append(Finding("leap_seconds", "error", text, wrong, fix, evidence))
        remainder = offset - np.sign(offset) * seconds
        if abs(remainder) > max(limit, 0.1):
            side = "late" if remainder < 0 else "early"
            text = f"besides the leap seconds the IMU's clock is {abs(remainder):.3f} s {side}"
            state.findings.append(
                Finding(
                    "time_offset", "warning", text, 0.8, f"offset={state.offset + offset:.3f} for the IMU", evidence
                )
            )
        return
    severity: Severity = "warning"
    blurred = np.hypot(spread, _LEAST_OFFSET)  # lever arms and delays look like clocks, too
    confidence = float(np.clip(1.0 - np.exp(-0.5 * (offset / blurred) ** 2 / 4.0), 0.3, 0.95))
    if abs(offset) > _GARBAGE + 2.0 * spread:
        severity, confidence = "error", wrong
    if seconds >= 1 and near:
        statement += f", {seconds} whole second{'s' * (seconds != 1)}"
    if severity == "error" and confidence < SURE:
        statement += "; a clock that is right explains the motion nearly as well, or in one half of the log better"
    state.findings.append(Finding("time_offset", severity, statement, confidence, fix, evidence))


def _leaps(state: DiagnosisState) -> list[int]:
    """Leap seconds that may be meant, those of the day first."""
    base = state.recording.metadata.time
    out = []
    if base.scale == "gps":
        with contextlib.suppress(SchulerError), timebase.leap_second_notes():  # said by the reader
            out.append(timebase.leap_seconds(timebase.calendar(base.epoch_gps_s).date()))
    return [*out, *(n for n in (18, 17, 16, 15) if n not in out)]
