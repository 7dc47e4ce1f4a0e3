"""Alignment of a run: initial attitude, velocity and position from the log, with their covariance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from schuler import frames, rotation, units
from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import in_windows
from schuler.filtering.states import StateLayout
from schuler.mechanization.alignment import Alignment, gyrocompass, heading_from_course
from schuler.mechanization.strapdown import NavState
from schuler.navigation.config import AlignmentSection, NavigationConfig
from schuler.navigation.start.calibration import CalibrationStart
from schuler.navigation.start.levelling import is_upright, level_at_rest, level_in_motion, tilt
from schuler.navigation.start.rest_bias import (
    bias_of_rests,
    rest_rate,
    rest_sentences,
    updated_with_rest_rate,
    with_bias,
)
from schuler.navigation.start.rests import StartRests, rests_before
from schuler.navigation.start.velocity_fit import with_velocities
from schuler.recording.series import GnssSeries, ImuSeries, Increments
from schuler.sensors.spec import ImuSpec

MIN_SPEED, _SLOW = 1.0, 0.3  # speed whose course is taken, and the one that will do rather than wait [m/s] ...
PATIENCE_S = 20.0  # ... longer than this [s]


@dataclass(frozen=True)
class Start:
    """Start of a run as aligned, and the same with other headings.

    Attributes
    ----------
    initial : InitialState
    source : str
        Source of the heading: ``course``, ``given``, ``gyrocompass``, or ``none``: there is none yet.
    heading, sigma : float
        Heading of the body's x axis and its 1-sigma. [rad]
    at_heading : callable
        Initial state of another heading and 1-sigma [rad], its attitude levelled accordingly.
    method : str
        How attitude and heading were found, a phrase.
    obstacle : str
        Why there is no heading, a sentence; empty where there is one.
    rests : StartRests, optional
        Rests before it.
    """

    initial: InitialState
    source: str
    heading: float
    sigma: float
    at_heading: Callable[[float, float], InitialState]
    method: str
    obstacle: str = ""
    rests: StartRests | None = None


def align(
    imu: ImuSeries,
    gnss: GnssSeries | None,
    config: NavigationConfig,
    spec: ImuSpec,
    layout: StateLayout,
    windows: tuple[tuple[float, float], ...],
    notes: list[str],
    calibration: CalibrationStart | None = None,
) -> Start:
    """Initial state of a run from the log itself.

    Parameters
    ----------
    imu : ImuSeries
        Body axes, clock corrected.
    gnss : GnssSeries, optional
        Positions; velocities that it lacks come from them.
    config, spec, layout
        Configuration, error budget and states of the run.
    windows : tuple of (start, stop)
        Outages: fixes inside are not used. [s]
    notes : list of str
        Gets a sentence on what was done.
    calibration : CalibrationStart, optional
        Calibration of the log: the attitude comes from compensated readings and is correlated with all errors of the
        sensors; the mean rate at rest improves the calibrated states instead of replacing them.

    Returns
    -------
    Start
        At the epoch of a GNSS fix, of the IMU's position.

    Raises
    ------
    InputError
        If there is no GNSS, or nothing fixes the attitude.
    """
    section = config.alignment
    if gnss is None:
        raise InputError("alignment needs GNSS positions; for a free inertial run give an initial state")
    usable = (gnss.t >= imu.t[0]) & (gnss.t <= imu.t[-1]) & ~in_windows(gnss.t, windows)
    if not usable.any():
        raise InputError(
            "no GNSS fix lies within the IMU log (outside outages): nothing to start from; check the clocks"
        )
    gnss = with_velocities(gnss.where(usable))
    rates = imu.rates()
    if calibration is not None:
        rates, spec = calibration.compensated(imu, layout), calibration.remaining_budget(spec)
    obstacle = ""
    if section.method == "gyrocompass":
        k, compass = _gyrocompassed(rates, gnss, section, spec)
        initial = _start_from_fix(gnss, k, compass, rates, layout, config, calibration, None)
        heading, sigma = float(compass.rpy_nb[2]), float(np.sqrt(compass.cov_psi_n[2, 2]))
        return Start(initial, "gyrocompass", heading, sigma, lambda *_: initial, compass.method)
    if section.method == "given":
        assert section.rpy_deg is not None
        k, source, phrase = 0, "given", ""
        heading, sigma = section.rpy_deg[2] * units.DEG, section.sigma_deg[2] * units.DEG
    else:
        k, obstacle = first_moving(gnss, section)
        if obstacle:
            source, heading, sigma, phrase = "none", 0.0, np.pi, ""
        else:
            source = "course"
            heading, sigma, speed = _course(gnss, k, section)
            phrase = f", heading from course at {speed:.2f} m/s"
    t, llh = float(gnss.t[k]), gnss.llh[k]
    rests = rests_before(rates, gnss, t, spec, section.rest_s)
    rest, level = rest_rate(rests, float(llh[0]), spec), None
    bias = (np.zeros(3), spec.gyro.turn_on_bias)
    if rest is not None:
        # a calibrated log is levelled and carried as it is; what the rest says of its biases comes after
        if calibration is None and "b_g" in layout:
            rest = bias = bias_of_rests(rests, float(llh[0]), rates, spec, layout) or rest
        level = level_at_rest(rates, rests, bias, t, llh, section, spec)

    def attitude(heading: float, sigma: float) -> Alignment:
        if section.method == "given":
            return _given_attitude(t, section, heading, sigma)
        if level is None:
            return level_in_motion(rates, gnss, k, heading, sigma, bias, section, spec)
        at_rest = level.with_heading(heading, sigma, "")
        if t - float(rests.stop[-1]) < 2.0 and rests.confirmed[-1]:
            return at_rest
        try:
            moving = level_in_motion(rates, gnss, k, heading, sigma, bias, section, spec)
        except InputError:
            return at_rest
        return moving if tilt(moving) < tilt(at_rest) else at_rest

    def at_heading(heading: float, sigma: float) -> InitialState:
        return _start_from_fix(gnss, k, attitude(heading, sigma), rates, layout, config, calibration, rest)

    first = attitude(heading, sigma)
    if source == "course" and is_upright(rotation.dcm_from_rpy(first.rpy_nb)[2]):
        source, sigma, phrase = "none", np.pi, ""
        obstacle = (
            "the x axis of the IMU is near the vertical, so the course is not its heading: say how the IMU is mounted "
            "(the log's axes, or imu.mount_rpy_deg)"
        )
        first = attitude(heading, sigma)
    initial = at_heading(heading, sigma)
    if rest is not None and "b_g" in layout:
        notes += rest_sentences(initial, layout, rests, *rest, calibration is not None)
    method = first.method.removesuffix(", ") + phrase
    return Start(initial, source, heading, sigma, at_heading, method, obstacle, rests)


def aligned_sentence(initial: InitialState, method: str, origin: float) -> str:
    """Sentence on the attitude of a start; ``origin`` is the start of the IMU log [s]."""
    rpy, spread = initial.nav.rpy_nb / units.DEG, np.sqrt(np.diag(initial.P)[:3]) / units.DEG
    return (
        f"aligned {initial.nav.t - origin:.2f} s into the IMU log ({method}): "
        f"roll {rpy[0]:.2f}, pitch {rpy[1]:.2f}, yaw {rpy[2]:.2f} deg; "
        f"1-sigma {spread[0]:.2f} {spread[1]:.2f} {spread[2]:.2f} deg about N, E, D"
    )


def _given_attitude(t: float, section: AlignmentSection, heading: float, sigma: float) -> Alignment:
    assert section.rpy_deg is not None
    rpy = np.array([*np.array(section.rpy_deg[:2]) * units.DEG, heading])
    sigmas = np.array([*np.array(section.sigma_deg[:2]) * units.DEG, sigma])
    return Alignment(t, rpy, np.diag(sigmas**2), "given attitude")


def _gyrocompassed(
    rates: ImuSeries, gnss: GnssSeries, section: AlignmentSection, spec: ImuSpec
) -> tuple[int, Alignment]:
    """Attitude from the first rest of the log, and the last fix in it."""
    rests = rests_before(rates, gnss, float(rates.t[-1]), spec, np.inf)
    if not len(rests) or section.rest_s == 0.0:
        raise InputError("gyrocompassing needs a stretch at rest at the start of the log, and none was found")
    still = rates.between(float(rests.start[0]), min(float(rests.stop[0]), float(rests.start[0]) + section.rest_s))
    k = max(int(np.searchsorted(gnss.t, still.t[-1], side="right")) - 1, 0)
    length = float(still.t[-1] - still.t[0])
    return k, gyrocompass(
        still.gyro,
        still.accel,
        float(gnss.llh[k, 0]),
        t=float(gnss.t[k]),
        sigma_gyro_bias=spec.gyro.turn_on_bias,
        sigma_gyro_noise=spec.gyro.random_walk / float(np.sqrt(length)),
        sigma_accel_bias=spec.accel.turn_on_bias,
        sigma_accel_noise=section.tilt_floor_deg * units.DEG * 9.81,
    )


def _course(gnss: GnssSeries, k: int, section: AlignmentSection) -> tuple[float, float, float]:
    """Heading from the course at a fix and its 1-sigma [rad], and the speed there [m/s]."""
    v_n, cov_v_n = gnss.need_velocity()
    sigma_v = float(np.sqrt(max(cov_v_n[k, 0, 0], cov_v_n[k, 1, 1])))
    heading, sigma = heading_from_course(v_n[k], sigma_v, sigma_sideslip=section.sideslip_deg * units.DEG)
    return heading, sigma, float(np.linalg.norm(v_n[k]))


def first_moving(gnss: GnssSeries, section: AlignmentSection) -> tuple[int, str]:
    """First fix fast enough for its course to be the heading, or one to start at, and the sentence on why not."""
    v_n, cov_v_n = gnss.need_velocity()
    speed = np.hypot(v_n[:, 0], v_n[:, 1])
    sigma = np.sqrt(np.maximum(cov_v_n[:, 0, 0], cov_v_n[:, 1, 1]))
    least = MIN_SPEED if section.min_speed_m_s is None else section.min_speed_m_s
    enough = speed > np.maximum(least, 4.0 * sigma)
    k = int(np.argmax(enough)) if enough.any() else len(gnss)
    if section.min_speed_m_s is None:
        slow = speed > np.maximum(_SLOW, 6.0 * sigma)
        first = int(np.argmax(slow)) if slow.any() else k
        if first < k and (k == len(gnss) or gnss.t[k] - gnss.t[first] > PATIENCE_S):
            k = first
    if k < len(gnss):
        return k, ""
    return int(np.argmax(speed > 3.0 * sigma)), (
        f"the vehicle never moves faster than {least} m/s and four times its uncertainty "
        f"(largest GNSS speed {speed.max():.2f} m/s, 1-sigma {np.median(sigma):.2f}), so its course gives no heading"
    )


def _start_from_fix(
    gnss: GnssSeries, k: int, alignment: Alignment, rates: ImuSeries, layout: StateLayout, config: NavigationConfig,
    calibration: CalibrationStart | None, rest: tuple[FloatArray, float] | None,
) -> InitialState:  # fmt: skip
    """Initial state of the IMU from a fix of the antenna and an attitude, with the correlations between them."""
    lever = np.array(config.gnss.lever_arm_m)
    t = float(gnss.t[k])
    C_nb = alignment.C_nb
    arm_n = C_nb @ lever
    v_n, cov_v_n = gnss.need_velocity()
    i = int(np.clip(np.searchsorted(rates.t, t), 0, len(rates.t) - 1))
    rate = rates.gyro[i] if rest is None else rates.gyro[i] - rest[0]
    v = v_n[k] - C_nb @ np.cross(rate, lever)
    origin = gnss.llh[k]
    r_e = frames.ecef_from_llh(origin) - frames.C_en(origin) @ arm_n
    nav = NavState.from_geodetic(t, frames.llh_from_ecef(r_e), v, alignment.rpy_nb)
    start = InitialState.from_sigmas(nav, layout, attitude=np.zeros(3), velocity=cov_v_n[k], position=gnss.cov_r_n[k])
    if calibration is not None:
        start = calibration.aligned(start, alignment, layout)
    else:
        if rest is not None and "b_g" in layout:
            start = with_bias(start, layout, *rest)
        start = start.aligned(alignment, layout)
    T = position_error_of_fix(layout, C_nb, lever, v)
    if calibration is None and "b_g" in layout:  # it turns the antenna about the IMU
        T[3:6, layout["b_g"]] = -C_nb @ rotation.skew(lever)
    for name, column in (("b_v", -np.eye(3)), ("delay", -_acceleration(gnss, k)[:, None])):
        if name in layout:
            T[3:6, layout[name]] = column
    start = InitialState(nav, T @ start.P @ T.T, start.parameters)
    if rest is None or calibration is None or "b_g" not in layout:
        return start
    return updated_with_rest_rate(start, layout, alignment.C_nb, *rest)


def position_error_of_fix(layout: StateLayout, C_nb: FloatArray, lever: FloatArray, v_n: FloatArray) -> FloatArray:
    """Matrix that makes of a fix's error, in place of the position's, the error of an IMU placed by it. Shape (n, n).

    Parameters
    ----------
    layout : StateLayout
    C_nb : ndarray, shape (3, 3)
    lever : ndarray, shape (3,)
        From the IMU to the antenna, body axes. [m]
    v_n : ndarray, shape (3,)
        [m/s]

    Notes
    -----
    The antenna is at the fix, so ``dr + dpsi x (C l)`` is the fix's error: ``dr = error + [C l x] dpsi``; what is
    estimated of the fix's own faults (lever arm, slow error, time offset) is in that error, with the sign turned.
    """
    T = np.eye(layout.size)
    T[6:9, 0:3] = rotation.skew(C_nb @ lever)
    for name, column in (("lever", -C_nb), ("b_r", -np.eye(3)), ("delay", -v_n[:, None])):
        if name in layout:
            T[6:9, layout[name]] = column
    return T


def _acceleration(gnss: GnssSeries, k: int) -> FloatArray:
    """Acceleration between the fixes around one, north-east-down; zero where there are none. Shape (3,). [m/s^2]"""
    i, j = max(k - 1, 0), min(k + 1, len(gnss) - 1)
    if gnss.v_n is None or j == i or not 0.0 < gnss.t[j] - gnss.t[i] <= 4.0:
        return np.zeros(3)
    return np.asarray((gnss.v_n[j] - gnss.v_n[i]) / (gnss.t[j] - gnss.t[i]))


def with_mount_in_heading(initial: InitialState, layout: StateLayout, lever_b: FloatArray) -> InitialState:
    """Initial state whose heading came from the course, with the error that the mount angle leaves in it.

    Parameters
    ----------
    initial : InitialState
        Heading and mount are independent in it, or not known to depend on each other.
    layout : StateLayout
        Without the block ``mount`` nothing changes.
    lever_b : ndarray, shape (3,)
        From the IMU to the antenna, whose position was taken. [m]

    Returns
    -------
    InitialState

    Notes
    -----
    A course is the heading of the vehicle; that of the IMU is the course plus the yaw of its mount. So an error of the
    yaw that is estimated is one of the heading, one to one: both stay uncertain together until accelerations show the
    heading. Taken as independent, they would share the mount's true yaw between them as their stated uncertainties
    are, and no uncertainty of the mount could free the heading.
    """
    if "mount" not in layout:
        return initial
    yaw = layout["mount"].start + 1
    T = np.eye(layout.size)
    T[2, yaw] = 1.0
    T[6:9, yaw] = rotation.skew(rotation.rotate(initial.nav.q_nb, lever_b))[:, 2]
    return InitialState(initial.nav, T @ initial.P @ T.T, initial.parameters)


def advance_to_log_start(initial: InitialState, increments: Increments) -> InitialState:
    """Initial state propagated to the start of the first interval, at most one sample later."""
    step = increments.start - initial.nav.t
    if step > 0.5:
        raise InputError(f"the IMU log begins {step:.2f} s after the initial state; alignment and log must overlap")
    nav = initial.nav
    nav_at_start = NavState(increments.start, nav.r_eb_e + step * nav.v_eb_e, nav.v_eb_e, nav.q_eb)
    return InitialState(nav_at_start, initial.P, initial.parameters)
