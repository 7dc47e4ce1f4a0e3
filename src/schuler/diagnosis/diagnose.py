"""All checks of one recording, in the order in which each needs what the ones before it found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler import earth, units
from schuler.diagnosis import gnss_quality, heights, positions, sampling, support
from schuler.diagnosis.accel_unit import accel_unit, stated_factor
from schuler.diagnosis.clock import find_clock, overlaps
from schuler.diagnosis.diagnosis import Diagnosis
from schuler.diagnosis.findings import CODES, SEVERITIES, Finding
from schuler.diagnosis.lag import find_lag
from schuler.diagnosis.motion import WindowMeans, motion_of
from schuler.diagnosis.orientation import find_axes, find_turns, find_upright
from schuler.diagnosis.smoothing import check_smoothing
from schuler.diagnosis.work import Work
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries
from schuler.standstill.unscaled import unscaled_rests


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
    work = Work(recording, list(findings), imu=recording.imu, gnss=recording.gnss)
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
        work.rests = unscaled_rests(rates, (work.motion.t - work.lag.offset, work.motion.speed))
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
    """One finding of a code for each part, the surest; of kinds that name an axis all."""
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


def _place(work: Work) -> None:
    gnss = work.gnss
    if gnss is not None and len(gnss):
        lat, h = float(np.median(gnss.llh[:, 0])), float(np.median(gnss.llh[:, 2]))
        if -1000.0 < h < 50_000.0:
            work.gravity = float(earth.gravity_somigliana(lat, h))


def _imu(work: Work) -> None:
    imu = work.imu
    if imu is None or len(imu) < 10:
        work.imu = None
        return
    work.checked.append("unit of specific force")
    rates = imu.rates()
    if imu.accel.any():
        work.rests = unscaled_rests(rates)
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
        work.rests = unscaled_rests(rates)
    work.curves["rests"] = work.rests.t


def _gnss(work: Work) -> None:
    gnss = work.gnss
    if gnss is None or len(gnss) < 10:
        return
    work.checked.append("positions against velocities")
    work.findings += positions.plausible_place(gnss)
    found, work.view = positions.check_positions(gnss)
    work.findings += found


def _together(work: Work) -> None:
    """Clock, axes and angular unit of the IMU against GNSS, or of its sensors against each other."""
    imu, view = work.imu, work.view
    if imu is None:
        return
    if view is not None and len(imu) > 100:
        work.motion = motion_of(view.t, view.v_n, work.gravity)
        if _alone(work) and (work.motion is None or not work.motion.enough):
            _try_radians(work, view, imu)
    motion = work.motion
    if motion is not None and overlaps(work, imu, motion) and motion.enough:
        means = find_clock(work, imu, motion)
        if work.lag is not None and work.lag.found:
            find_axes(work, means, motion, work.lag)
    if work.apart is not None and motion is not None:
        moved = WindowMeans(imu.shifted(work.apart.offset))
        work.lag, work.means = replace(work.apart, offset=0.0), moved
        find_axes(work, moved, motion, work.lag)
    if "axes" not in work.checked:
        find_upright(work)
    find_turns(work, imu)


def _alone(work: Work) -> bool:
    """Whether there are positions without velocities."""
    return work.view is not None and work.view.source == "position" and work.gnss is not None and work.gnss.v_n is None


def _try_radians(work: Work, view: positions.GnssView, imu: ImuSeries) -> None:
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


def _quality(work: Work) -> None:
    imu = work.imu
    if imu is not None and work.rests is not None:
        work.checked.append("sampling and readings")
        work.findings += sampling.check_times(imu.t)
        work.findings += sampling.check_temperature(imu)
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
        if any(f.code in ("clock_drift", "imu_noise") for f in work.findings):
            return  # turns are smeared by the clock already, or lost in noise
        if work.motion is not None and work.lag is not None and work.lag.r2[0] > 0.5 and imu is not None:
            work.findings += check_smoothing(WindowMeans(imu), work.motion, work.lag)


def _comparable(work: Work) -> positions.GnssView:
    """The view of GNSS without a velocity that does not fit the positions anyhow."""
    assert work.view is not None
    spoilt = {"height_unit", "position_unit", "position_order", "velocity_wrong"}
    if work.view.mirrored or any(f.code in spoilt for f in work.findings):
        return replace(work.view, other=None)
    return work.view


def _unchecked(work: Work) -> None:
    """What this log could not tell."""
    left = list(work.untold)
    if work.imu is not None and not any(c.startswith("unit of angular rate") for c in work.checked):
        left.append("the unit of angular rate (no turns of gravity between rests, no course)")
    if (
        work.imu is not None
        and work.gnss is not None
        and "IMU clock against GNSS" not in work.checked
        and not work.apart
    ):
        left.append("the IMU's clock and axes against GNSS (too little motion)")
    if left:
        work.findings.append(Finding("unchecked", "note", "not checked: " + "; ".join(left), 1.0))
