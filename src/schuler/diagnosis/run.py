"""All checks of one recording, each after those whose results it needs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler import earth, units
from schuler.diagnosis import gnss_quality, heights, positions, sampling, support
from schuler.diagnosis.accel_unit import accel_unit, stated_factor
from schuler.diagnosis.clock import find_clock, overlaps
from schuler.diagnosis.gnss_quality import check_smoothing
from schuler.diagnosis.lag import find_lag
from schuler.diagnosis.motion import WindowMeans, motion_of, position_velocity
from schuler.diagnosis.orientation import find_axes, find_turns, find_upright
from schuler.diagnosis.result import Diagnosis, Finding
from schuler.diagnosis.state import DiagnosisState
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries
from schuler.standstill.unscaled import UnscaledRests, unscaled_rests

_SPEED_S = 5.0  # positions tell a speed over so long
_STANDING = 1.0  # speed by noisy fixes of what may stand [m/s]


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
    state = DiagnosisState(recording, list(findings), imu=recording.imu, gnss=recording.gnss)
    if state.gnss is None and recording.imu is not None and (recording.ranges is not None or not quick):
        state.gnss = heights.single_points(recording)
    _gravity_here(state)
    _check_imu(state)
    _check_gnss(state)
    _against_gnss(state)
    if not quick:
        _check_quality(state)
        state.findings += heights.check_heights(recording)
    _list_unchecked(state)
    rates = None if state.imu is None else state.imu.rates()
    if rates is not None and state.motion is not None and state.lag is not None and state.lag.matched:
        # constant velocity looks like rest to an IMU
        state.rests = unscaled_rests(rates, (state.motion.t - state.lag.offset, state.motion.speed))
    return Diagnosis(
        recording.metadata.name,
        tuple(_surest(state.findings)),
        state.estimates,
        () if state.imu is None or state.rests is None else support.segments(state.imu, state.rests),
        () if quick else support.uses(recording, rates, state.rests, state.motion),
        tuple(state.checked),
        state.curves,
    )


def _surest(findings: list[Finding]) -> list[Finding]:
    """One finding of a code for each part, the surest; of kinds that name an axis all."""
    merged: list[Finding] = []
    several = {"stuck", "saturated", "unchecked"}
    for f in findings:
        same = [k for k, g in enumerate(merged) if g.code == f.code and g.part == f.part]
        if same and f.code not in several:
            if f.confidence > merged[same[0]].confidence:
                merged[same[0]] = f
            continue
        merged.append(f)
    return merged


def _gravity_here(state: DiagnosisState) -> None:
    gnss = state.gnss
    if gnss is not None and len(gnss):
        lat, h = float(np.median(gnss.llh[:, 0])), float(np.median(gnss.llh[:, 2]))
        if -1000.0 < h < 50_000.0:
            state.gravity = float(earth.gravity_somigliana(lat, h))


def _check_imu(state: DiagnosisState) -> None:
    imu = state.imu
    if imu is None or len(imu) < 10:
        state.imu = None
        return
    state.checked.append("unit of specific force")
    rates = imu.rates()
    if imu.accel.any():
        state.rests = _rests(state, rates)
        stated = stated_factor(state.recording.metadata.options, "accel")
        counts = any("raw counts" in note for note in state.recording.metadata.notes)
        findings, state.scaling = accel_unit(rates.accel, state.rests, imu.interval, imu.kind, state.gravity, stated)
        if counts:
            findings = [replace(f, severity="note") for f in findings]
        state.findings += findings
        step = max(1, len(imu) // 4000)
        state.curves["norm"] = np.stack(
            (imu.t[::step], np.linalg.norm(rates.accel[::step], axis=1) * state.scaling.factor), axis=1
        )
    else:
        state.rests = unscaled_rests(rates)
    state.curves["rests"] = state.rests.t


def _rests(state: DiagnosisState, rates: ImuSeries) -> UnscaledRests:
    """Rests of the IMU, those left out in which GNSS has a velocity: a steady turn looks like rest, but is not."""
    gnss = state.gnss
    if gnss is None or len(gnss) < 10:
        return unscaled_rests(rates)
    if gnss.v_n is not None:
        return unscaled_rests(rates, (gnss.t, np.hypot(gnss.v_n[:, 0], gnss.v_n[:, 1])), max_speed=_STANDING)
    t, v = position_velocity(gnss)
    # the mean over some seconds, for the noise of positions
    n = min(max(round(_SPEED_S / float(np.median(np.diff(t)))), 1), len(t))
    v = np.stack([np.convolve(x, np.ones(n) / n, "same") for x in v[:, :2].T], axis=1)
    noise = 2.0 * float(np.sqrt(np.median(np.einsum("nii->ni", gnss.cov_r_n)[:, :2].sum(axis=1)))) / _SPEED_S
    return unscaled_rests(rates, (t, np.hypot(v[:, 0], v[:, 1])), max_speed=_STANDING + noise)


def _check_gnss(state: DiagnosisState) -> None:
    gnss = state.gnss
    if gnss is None or len(gnss) < 10:
        return
    state.checked.append("positions against velocities")
    state.findings += positions.plausible_place(gnss)
    findings, state.view = positions.check_positions(gnss)
    state.findings += findings


def _against_gnss(state: DiagnosisState) -> None:
    """Clock, axes and angular unit of the IMU against GNSS, or of its sensors against each other."""
    imu, view = state.imu, state.view
    if imu is None:
        return
    if view is not None and len(imu) > 100:
        state.motion = motion_of(view.t, view.v_n, state.gravity)
        if _without_velocities(state) and (state.motion is None or not state.motion.enough):
            _try_radians(state, view, imu)
    motion = state.motion
    if motion is not None and overlaps(state, imu, motion) and motion.enough:
        means = find_clock(state, imu, motion)
        if state.lag is not None and state.lag.matched:
            find_axes(state, means, motion, state.lag)
    if state.apart is not None and motion is not None:
        aligned = WindowMeans(imu.shifted(state.apart.offset))
        state.lag = replace(state.apart, offset=0.0)
        find_axes(state, aligned, motion, state.lag)
    if "axes" not in state.checked:
        find_upright(state)
    find_turns(state, imu)


def _without_velocities(state: DiagnosisState) -> bool:
    """Whether there are positions without velocities."""
    return (
        state.view is not None and state.view.source == "position" and state.gnss is not None and state.gnss.v_n is None
    )


def _try_radians(state: DiagnosisState, view: positions.GnssView, imu: ImuSeries) -> None:
    """Positions that hardly move: radians read as degrees, if the IMU moved as they did, 57 times as much."""
    larger = view.v_n * np.array([1.0 / units.DEG, 1.0 / units.DEG, 1.0])
    motion = motion_of(view.t, larger, state.gravity)
    if motion is None or not motion.enough or min(imu.t[-1], motion.t[-1]) - max(imu.t[0], motion.t[0]) < 20.0:
        return
    lag = find_lag(WindowMeans(imu), motion)
    if not lag.matched or lag.r2.max() < 0.6:
        return
    text = (
        "the IMU moved as the positions say, but 57 times as much: latitude and longitude are radians and were read as "
        "degrees"
    )
    evidence = {"explained": lag.r2.tolist()}
    state.findings.append(Finding("position_unit", "error", text, 0.85, "units='angle=rad'", evidence, "gnss"))
    state.view = replace(view, v_n=larger)
    state.motion = motion


def _check_quality(state: DiagnosisState) -> None:
    imu = state.imu
    if imu is not None and state.rests is not None:
        state.checked.append("sampling and readings")
        state.findings += sampling.check_times(imu.t)
        state.findings += sampling.check_temperature(imu)
        findings = sampling.check_readings(imu, state.rests, (state.scaling.factor, state.gyro_factor))
        notes = " ".join(state.recording.metadata.notes)
        if "raw counts" in notes:
            findings = [f for f in findings if f.code not in ("imu_noise", "quantised", "spikes")]
        if "its values are zero" in notes:
            findings = [f for f in findings if f.code != "dead_axis"]
        state.findings += findings
    gnss = state.recording.gnss
    if gnss is not None and state.view is not None:
        state.checked.append("GNSS quality")
        findings = gnss_quality.check_gnss(gnss, _reliable_view(state))
        if any(f.code == "height_unit" for f in state.findings):
            findings = [f for f in findings if f.code != "gnss_noise"]
        state.findings += findings
        if any(f.code in ("clock_drift", "imu_noise") for f in state.findings):
            return  # turns are smeared by the clock already, or lost in noise
        if state.motion is not None and state.lag is not None and state.lag.r2[0] > 0.5 and imu is not None:
            state.findings += check_smoothing(WindowMeans(imu), state.motion, state.lag)


def _reliable_view(state: DiagnosisState) -> positions.GnssView:
    """The view of GNSS without a velocity that does not fit the positions anyhow."""
    assert state.view is not None
    spoilt = {"height_unit", "position_unit", "position_order", "velocity_wrong"}
    if state.view.mirrored or any(f.code in spoilt for f in state.findings):
        return replace(state.view, other=None)
    return state.view


def _list_unchecked(state: DiagnosisState) -> None:
    """Note on what this log cannot tell."""
    open_questions = list(state.undetermined)
    if state.imu is not None and not any(c.startswith("unit of angular rate") for c in state.checked):
        open_questions.append("the unit of angular rate (no turns of gravity between rests, no course)")
    if (
        state.imu is not None
        and state.gnss is not None
        and "IMU clock against GNSS" not in state.checked
        and not state.apart
    ):
        open_questions.append("the IMU's clock and axes against GNSS (too little motion)")
    if open_questions:
        state.findings.append(Finding("unchecked", "note", "not checked: " + "; ".join(open_questions), 1.0))
