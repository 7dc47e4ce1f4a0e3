"""Preparation of the IMU log and the fixes of a run, with a note on every change and every doubt.

The faults of a log and what is done about them: docs/robustness.md.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler import rotation, units
from schuler.arrays import FloatArray
from schuler.characterisation.readings import resolution, saturated, stuck
from schuler.exceptions import ConfigError, InputError
from schuler.filtering.engine import FilterOptions
from schuler.filtering.measurements import RESET_VELOCITY, VELOCITY, MeasurementSchedule
from schuler.navigation.config import NavigationConfig
from schuler.navigation.inputs.gnss_faults import blunders, contradictions, frozen, held, no_overlap
from schuler.navigation.inputs.spikes import without_spikes
from schuler.navigation.start.calibration import CalibrationStart, configured_start
from schuler.recording.series import GnssSeries, ImuSeries
from schuler.timebase import SAME_TIME

#: A longer step of the stamps lacks a sample. [sample intervals]
MISSING = 1.5
#: A longer step of the stamps is a pause. [sample intervals]
PAUSE = 2.5
#: Horizontal 1-sigma beyond which a fix tells no position. [m]
NO_POSITION = 1e3
#: Largest 1-sigma of a fix's height, of which a receiver may know nothing. [m]
LARGEST_HEIGHT = 1e4
#: Largest 1-sigma of a velocity. [m/s]
LARGEST_VELOCITY = 1e3
_PIECES = 2000  # of a log, spread evenly, that tell the error of bridging
_SHORTEST_S = 10.0  # part of a log between pauses that is navigated
_JITTER = 0.2  # robust spread of the stamps that is noted, share of the sample interval


def prepared_imu(
    imu: ImuSeries,
    config: NavigationConfig,
    notes: list[str],
    calibrated: CalibrationStart | None = None,
    begins: float | None = None,
) -> ImuSeries:
    """The IMU log in vehicle axes and on the GNSS clock, short pauses bridged, without what is not estimated.

    Of a log with longer pauses it is the longest part between them.

    Parameters
    ----------
    imu : ImuSeries
    config : NavigationConfig
        ``imu.mount_rpy_deg``, ``imu.clock_shift_s`` and ``imu.max_gap_s`` are used.
    notes : list of str
        Gets a sentence on everything that was done or looks wrong.
    calibrated : CalibrationStart, optional
        Start from a calibration; default: from the one that the configuration names, if it does.
    begins : float, optional
        Time of a given start: the part is that which holds it. [s]

    Raises
    ------
    InputError
        If no part between pauses longer than ``imu.max_gap_s`` lasts ten seconds, or a start that is given lies in
        such a pause; if the calibration is not of such a log.
    """
    section = config.imu
    calibrated = configured_start(config, imu) if calibrated is None else calibrated
    sentences = _readings(imu)
    if calibrated is not None:
        imu = calibrated.in_si(imu)
        notes += calibrated.notes
    if any(section.mount_rpy_deg):
        C_bs = rotation.dcm_from_rpy(np.array(section.mount_rpy_deg) * units.DEG)
        imu = imu.rotated(C_bs)
        notes.append(f"IMU axes turned into the vehicle by roll, pitch, yaw {section.mount_rpy_deg} deg")
    if section.clock_shift_s:
        imu = imu.shifted(section.clock_shift_s)
        notes.append(f"{section.clock_shift_s:+g} s added to the IMU's time stamps")
    notes += sentences
    if len(imu) > 1 and imu.interval > section.max_gap_s:
        raise InputError(
            f"the IMU log has {len(imu)} samples in {imu.t[-1] - imu.t[0]:.0f} s, one every {imu.interval:.3g} s: "
            "motion between them is not measured; expected ten a second and more. Take the log as it was recorded, not "
            "thinned"
        )
    imu = unbroken(imu, section.max_gap_s, notes, begins)
    gaps = imu.gaps(PAUSE)
    if len(gaps):
        longest = gaps[np.argmax(gaps[:, 1])]
        notes.append(f"{len(gaps)} pauses of the IMU log bridged, the longest {longest[1]:.3f} s at {longest[0]:.3f} s")
    imu = without_spikes(refilled(imu, notes), notes)
    return imu if calibrated is None else calibrated.corrected(imu)


def unbroken(imu: ImuSeries, max_gap_s: float, notes: list[str], begins: float | None = None) -> ImuSeries:
    """The longest part of a log without a pause of more than ``max_gap_s``, or that which holds a given time.

    Parameters
    ----------
    imu : ImuSeries
    max_gap_s : float
        [s]
    notes : list of str
    begins : float, optional
        [s]

    Raises
    ------
    InputError
        If that part is shorter than ten seconds, or there is none.
    """
    pauses = imu.gaps(PAUSE)
    pauses = pauses[pauses[:, 1] > max_gap_s]
    if not len(pauses):
        return imu
    starts, stops = np.r_[imu.t[0], pauses.sum(axis=1)], np.r_[pauses[:, 0], imu.t[-1]]
    k, which = int(np.argmax(stops - starts)), "longest part"
    if begins is not None:
        k, which = max(int(np.sum(starts <= begins + SAME_TIME)) - 1, 0), "part with the start"
    lasts = stops[k] - starts[k]
    at, length = pauses[np.argmax(pauses[:, 1])]
    sentence = f"the IMU log pauses for {length:.3f} s at {at:.3f} s, longer than imu.max_gap_s = {max_gap_s} s"
    if lasts < _SHORTEST_S or (begins is not None and begins > stops[k]):
        raise InputError(
            f"{sentence}, and its {which} without such a pause lasts {lasts:.1f} s, where {_SHORTEST_S:g} s are "
            "needed; raise max_gap_s if the motion was slow"
        )
    others = f" ({len(pauses)} such pauses)" if len(pauses) > 1 else ""
    since = imu.t[0]
    notes.append(
        f"{sentence}{others}: its {which} is navigated, second {starts[k] - since:.3f} to {stops[k] - since:.3f} of "
        f"{imu.t[-1] - since:.3f}; nothing tells how it moved in a pause, so the others are runs of their own (--from, "
        "--to)"
    )
    inside = imu.between(starts[k], stops[k])
    over_pause = imu.kind == "increment" and k > 0  # the first increment may be that of all the pause
    return inside.between(inside.t[1], stops[k]) if over_pause else inside


def refilled(imu: ImuSeries, notes: list[str]) -> ImuSeries:
    """Fill increments after lost samples with the time that they do not cover.

    Parameters
    ----------
    imu : ImuSeries
        Rates are returned as they are: their integration spans a pause by itself.
    notes : list of str

    Notes
    -----
    An increment after a missing sample either covers the complete step of its stamp (the sensor went on integrating) or
    only its own interval (a packet was lost). Specific force decides: gravity makes it nearly constant, so the velocity
    increment is about as large as its neighbours' or larger by the number of samples in the step. Lost parts are
    filled with the mean rate of the two neighbours, as the trapezoid rule does for rates.
    """
    h = imu.interval
    step = np.diff(imu.t)
    late = np.flatnonzero(step > MISSING * h) + 1 if imu.kind == "increment" and len(step) else np.empty(0, int)
    if not len(late):
        return imu
    size = np.linalg.norm(imu.accel, axis=1)
    usual = np.median(size[np.clip(late[:, None] + np.arange(-5, 0), 0, None)], axis=1)
    times = step[late - 1] / h
    # on a scale of ratios: nearer to one usual increment than to ``times`` of them
    lost = late[size[late] < usual * np.sqrt(times)]
    if not len(lost):
        notes.append(f"{len(late)} IMU increments cover more than one interval")
        return imu
    gyro, accel = imu.gyro.copy(), imu.accel.copy()
    missing = ((imu.t[lost] - imu.t[lost - 1]) / h - 1.0)[:, None]
    before = np.diff(imu.t, prepend=imu.t[0] - h)[lost - 1, None] / h
    before = np.where(np.isin(lost - 1, lost)[:, None], 1.0, before)  # a lost one's own increment covers one interval
    for new, old in ((gyro, imu.gyro), (accel, imu.accel)):
        new[lost] += 0.5 * missing * (old[lost - 1] / before + old[lost])
    notes.append(
        f"at {len(lost)} places IMU increments were lost, {missing.sum() * h:.3f} s in all; filled with the mean rate "
        "of the neighbours"
    )
    return replace(imu, gyro=gyro, accel=accel)


def bridged(imu: ImuSeries) -> float:
    """Length of the longest pause of a log, zero if there is none. [s]"""
    gaps = imu.gaps(PAUSE)
    return float(gaps[:, 1].max()) if len(gaps) else 0.0


def bridging_noise(imu: ImuSeries, length: float) -> tuple[float, float]:
    """Error of bridging a pause of the log, from bridging pieces of the log without a pause.

    Parameters
    ----------
    imu : ImuSeries
    length : float
        Length of the pause. [s]

    Returns
    -------
    gyro, accel : float
        RMS over pieces and axes of the mean rate less the mean of both ends: what the trapezoid rule over a pause of
        this length misses. The turn missed is ``length`` times the first. [rad/s], [m/s^2]
    """
    if imu.kind == "rate":
        rates = (imu.gyro, imu.accel)
    else:
        h = np.diff(imu.t, prepend=imu.t[0] - imu.interval)[:, None]
        rates = (imu.gyro / h, imu.accel / h)
    m = max(round(length / imu.interval), 2)
    unbroken = imu.t[m:] - imu.t[:-m] < 1.5 * length  # no pause inside
    first = np.flatnonzero(unbroken)
    if not len(first):
        raise InputError(
            f"the IMU log pauses for {length:.3f} s and has no stretch as long without a pause, so nothing tells how "
            "bad a bridge of that length is: the stamps are hardly those of the samples. Look at them (check), or "
            "leave the time column out (column '-') and give the rate"
        )
    first = first[np.linspace(0, len(first) - 1, min(_PIECES, len(first))).astype(np.int64)]
    errors = []
    for x in rates:
        total = np.concatenate((np.zeros((1, 3)), np.cumsum(x, axis=0)))
        ends = 0.5 * (x[first] + x[first + m])
        mean = (total[first + m] - total[first + 1] + ends) / m
        errors.append(float(np.sqrt(np.mean((mean - ends) ** 2))))
    return errors[0], errors[1]


def _readings(imu: ImuSeries) -> list[str]:
    """Sentences on jitter, missing samples, and readings that are stuck or at the end of the range."""
    if len(imu) < 100:
        return []
    sentences = []
    h, step = imu.interval, np.diff(imu.t)
    spread = 1.4826 * float(np.median(np.abs(step - h)))
    if spread > _JITTER * h:
        sentences.append(
            f"IMU stamps jitter by {spread * 1e3:.2f} ms, {100 * spread / h:.0f} % of the interval: if they are times "
            "of arrival, count samples at a constant rate instead"
        )
    lost = int(np.sum((step > MISSING * h) & (step <= PAUSE * h)))
    if lost and spread <= _JITTER * h:
        sentences.append(f"{lost} single IMU samples are missing")
    time = imu.t - imu.t[0]
    for name, values in (("gyro", imu.gyro), ("accelerometer", imu.accel)):
        for axis, column in zip("xyz", values.T, strict=True):
            x = np.ascontiguousarray(column)
            if not np.ptp(x) > 0.0:
                sentences.append(f"{name} {axis} reads {x[0]:g} throughout: is it connected?")
                continue
            grid = resolution(x)
            faults = saturated(x, time, f"{name} {axis}", None, grid) + stuck(x, time, f"{name} {axis}", grid)
            sentences += [f"{f.text} (navigated as it is: sigmas do not cover it)" for f in faults]
    return sentences


def prepared_gnss(
    gnss: GnssSeries, config: NavigationConfig, notes: list[str], imu: ImuSeries | None = None
) -> GnssSeries:
    """The fixes that are used, with their covariances as far as they are believed.

    Parameters
    ----------
    gnss : GnssSeries
    config : NavigationConfig
        Section ``gnss``.
    notes : list of str
    imu : ImuSeries, optional
        Prepared IMU log, to check that the clocks overlap.

    Raises
    ------
    InputError
        If no fix is left, none lies within the IMU log, or velocities contradict the positions in a way that
        shows which column is wrong (see :func:`~schuler.navigation.inputs.gnss_faults.contradictions`).
    ConfigError
        If ``gnss.quality`` asks for numbers that are not there.
    """
    section = config.gnss
    if section.quality is not None:
        if gnss.quality is None:
            raise ConfigError("gnss.quality is given but the GNSS series has no quality numbers")
        keep = np.isin(gnss.quality, section.quality)
        notes.append(f"{int(np.sum(~keep))} GNSS epochs of other quality than {list(section.quality)} left out")
        if not keep.any():
            present = sorted({int(q) for q in np.asarray(gnss.quality).ravel()})
            raise InputError(f"gnss.quality: no epoch has quality {list(section.quality)}; the log has {present}")
        gnss = gnss.where(keep)
    gnss = _stating_something(gnss, notes)
    if imu is not None:
        no_overlap(imu, gnss)
    repeated, times = held(gnss)
    if repeated.any():
        notes.append(
            f"GNSS rows give each fix about {times:g} times (held at a higher rate): every fix is used once, "
            f"{int(np.sum(~repeated))} of {len(gnss)} rows"
        )
        gnss = gnss.where(~repeated)
    stopped = frozen(gnss)
    if stopped.any():
        k = int(np.argmax(stopped))
        notes.append(
            f"{int(stopped.sum())} GNSS fixes left out whose position stood still, to the last digit, while their "
            f"velocity did not; the first at {gnss.t[k]:.3f} s"
        )
        gnss = gnss.where(~stopped)
    single = blunders(gnss)
    if single.any():
        notes.append(
            f"{int(single.sum())} single GNSS fixes left out that jump off the way of their neighbours and back; the "
            f"first at {gnss.t[single][0]:.3f} s"
        )
        gnss = gnss.where(~single)
    if section.coupling in ("loose", "reset"):
        notes += contradictions(gnss, delay=section.velocity_delay_s, used=section.velocity)
    return replace(
        gnss,
        cov_r_n=floored(
            gnss.cov_r_n, section.sigma_scale, section.position_sigma_floor_m, section.position_sigma_scale
        ),
        cov_v_n=None
        if gnss.cov_v_n is None
        else floored(gnss.cov_v_n, section.sigma_scale, section.velocity_sigma_floor_m_s, section.velocity_sigma_scale),
    )


def _stating_something(gnss: GnssSeries, notes: list[str]) -> GnssSeries:
    """Fixes that tell a position, and no sigma so large that nothing is left of the covariance's digits beside it.

    Receivers write sigmas such as 2**32 mm for a position that they do not have.
    """
    sigma = np.sqrt(np.einsum("nii->ni", gnss.cov_r_n))
    empty = sigma[:, :2].max(axis=1) > NO_POSITION
    if empty.all():
        raise InputError(
            f"all GNSS fixes state a horizontal 1-sigma above {NO_POSITION:g} m, at least {sigma[:, :2].min():.4g}: "
            "is its unit right? A receiver that reports no accuracy needs one given (option sigma)"
        )
    if empty.any():
        notes.append(
            f"{int(empty.sum())} GNSS fixes left out that state a horizontal 1-sigma above {NO_POSITION:g} m, the "
            f"first at {gnss.t[empty][0]:.3f} s"
        )
        gnss = gnss.where(~empty)
    cov_r_n, high = _bounded(gnss.cov_r_n, LARGEST_HEIGHT)
    cov_v_n, fast = (None, 0) if gnss.cov_v_n is None else _bounded(gnss.cov_v_n, LARGEST_VELOCITY)
    for count, what, limit in (
        (high, "height", f"{LARGEST_HEIGHT:g} m"),
        (fast, "velocity", f"{LARGEST_VELOCITY:g} m/s"),
    ):
        if count:
            notes.append(f"at {count} GNSS fixes the 1-sigma of {what} was larger than {limit}, and is taken as that")
    return replace(gnss, cov_r_n=cov_r_n, cov_v_n=cov_v_n) if high or fast else gnss


def _bounded(cov: FloatArray, limit: float) -> tuple[FloatArray, int]:
    """Covariances whose axes are shrunk to a largest 1-sigma, correlations kept; and how many were."""
    sigma = np.sqrt(np.einsum("nii->ni", cov))
    shrink = np.minimum(1.0, limit / sigma)
    count = int(np.sum(np.any(shrink < 1.0, axis=1)))
    bounded: FloatArray = cov * shrink[:, :, None] * shrink[:, None, :] if count else cov
    return bounded, count


def floored(
    cov: FloatArray,
    scale: float,
    floor: tuple[float, float, float],
    by_axis: tuple[float, float, float] = (1.0, 1.0, 1.0),
) -> FloatArray:
    """Covariances scaled, and variances lifted to a floor without touching the correlations below it.

    Parameters
    ----------
    cov : ndarray, shape (n, 3, 3)
    scale : float
        Factor on 1-sigma values.
    floor : tuple of float
        Smallest 1-sigma by axis.
    by_axis : tuple of float
        Further factors on 1-sigma values, by axis.
    """
    D = scale * np.array(by_axis)
    scaled: FloatArray = cov * D[:, None] * D
    lift = np.maximum(np.array(floor) ** 2 - np.einsum("nii->ni", scaled), 0.0)
    lifted: FloatArray = scaled + lift[:, :, None] * np.eye(3)
    return lifted


def with_late_velocities(
    schedule: MeasurementSchedule, delay: float, start: float, notes: list[str]
) -> MeasurementSchedule:
    """The schedule with GNSS velocities at the time they are of, ``delay`` before their stamp.

    Parameters
    ----------
    schedule : MeasurementSchedule
    delay : float
        How much later than valid velocities are stamped; the half interval of a difference of positions. [s]
    start : float
        Time of the initial state; what now comes before it is left out. [s]
    notes : list of str
    """
    late = np.isin(schedule.kind, (VELOCITY, RESET_VELOCITY))
    if delay == 0.0 or not late.any():
        return schedule
    shifted = replace(schedule, t=np.where(late, schedule.t - delay, schedule.t))
    shifted = shifted.where(shifted.t > start + 1e-6)
    notes.append(f"GNSS velocities are taken to be valid {delay:g} s before their stamps")
    return shifted.where(np.argsort(shifted.t, kind="stable"))


def current_velocities(gnss: GnssSeries, delay: float) -> GnssSeries:
    """Fixes whose velocities are those of their positions' stamps, for alignment; interpolated, ends held.

    Parameters
    ----------
    gnss : GnssSeries
    delay : float
        How much later than valid velocities are stamped. [s]
    """
    if delay == 0.0 or gnss.v_n is None:
        return gnss
    v = np.stack([np.interp(gnss.t, gnss.t - delay, column) for column in gnss.v_n.T], axis=1)
    return replace(gnss, v_n=v)


def filter_options(config: NavigationConfig, imu: ImuSeries) -> FilterOptions:
    """Options of the engine for a prepared log: as configured, and how pauses of the IMU are bridged."""
    pause = bridged(imu)
    gyro, accel = bridging_noise(imu, pause) if pause else (0.0, 0.0)
    return FilterOptions(
        covariance_rate_hz=None if config.filter.full_rate else config.filter.covariance_rate_hz,
        record_s=config.filter.record_s,
        output_rate_hz=config.filter.output_rate_hz,
        lockout=config.filter.lockout,
        hold_s=config.filter.hold_s,
        adaptive=config.filter.adaptive,
        smoother=config.filter.smooth and config.gnss.coupling != "reset",
        earth_rotation=config.filter.earth_rotation,
        gap_s=PAUSE * imu.interval if pause else None,
        gap_gyro=gyro,
        gap_accel=accel,
    )
