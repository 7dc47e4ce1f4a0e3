"""Alignment of a run: initial attitude, velocity and position from the log, with their covariance."""

from __future__ import annotations

import numpy as np

from schuler import earth, frames, rotation, units
from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import in_windows
from schuler.filtering.states import StateLayout
from schuler.mechanization.alignment import Alignment, gyrocompass, heading_from_course, levelling
from schuler.mechanization.strapdown import NavState
from schuler.navigation.config import AlignmentSection, NavigationConfig
from schuler.navigation.start.calibration import CalibrationStart, rest_columns
from schuler.recording.series import GnssSeries, ImuSeries, Increments
from schuler.sensors.spec import ImuSpec

_REST_SPEED = 0.3  # GNSS speed below which a vehicle may be at rest, before its uncertainty is added [m/s]


def align(
    imu: ImuSeries,
    gnss: GnssSeries | None,
    config: NavigationConfig,
    spec: ImuSpec,
    layout: StateLayout,
    windows: tuple[tuple[float, float], ...],
    notes: list[str],
    calibration: CalibrationStart | None = None,
) -> InitialState:
    """Initial state of a run from the log itself.

    Parameters
    ----------
    imu : ImuSeries
        Body axes, clock corrected.
    gnss : GnssSeries, optional
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
    InitialState
        At the epoch of a GNSS fix, of the IMU's position.

    Raises
    ------
    InputError
        If there is no GNSS, or nothing fixes the heading.
    """
    section = config.alignment
    if gnss is None:
        raise InputError("alignment needs GNSS positions; for a free inertial run give an initial state")
    usable = (gnss.t >= imu.t[0]) & (gnss.t <= imu.t[-1]) & ~in_windows(gnss.t, windows)
    if not usable.any():
        raise InputError(
            "no GNSS fix lies within the IMU log (outside outages): nothing to start from; check the clocks"
        )
    gnss = gnss.where(usable)
    rates = imu.rates()
    if calibration is not None:
        rates, spec = calibration.compensated(imu, layout), calibration.remaining_budget(spec)
    level, rest_rate, rest_end = _at_rest(rates, gnss, section, spec)
    if section.method == "given":
        k, alignment = 0, _given_attitude(gnss, section)
    elif section.method == "gyrocompass":
        k, alignment = _gyrocompassed(rates, gnss, level, rest_end, section, spec)
        rest_rate = None  # the same data cannot fix both the heading and the bias
    else:
        k = _first_moving(gnss, section)
        heading, sigma, speed = _course(gnss, k, section)
        if level is not None and gnss.t[k] - rest_end < 20.0:
            alignment = level.with_heading(heading, sigma, f"heading from course at {speed:.2f} m/s")
        else:
            alignment = _level_in_motion(rates, gnss, k, heading, sigma, section, spec)
            rest_rate = None
    initial = _start_from_fix(gnss, k, alignment, rates, layout, config, calibration)
    if rest_rate is not None and "b_g" in layout:
        if calibration is None:
            initial = _with_rest_bias(initial, layout, *rest_rate, notes)
        else:
            initial = _updated_with_rest_rate(initial, layout, alignment, *rest_rate, notes)
    rpy = alignment.rpy_nb / units.DEG
    spread = np.sqrt(np.diag(alignment.cov_psi_n)) / units.DEG
    notes.append(
        f"aligned {initial.nav.t - imu.t[0]:.2f} s into the IMU log ({alignment.method}): "
        f"roll {rpy[0]:.2f}, pitch {rpy[1]:.2f}, yaw {rpy[2]:.2f} deg; "
        f"1-sigma {spread[0]:.2f} {spread[1]:.2f} {spread[2]:.2f} deg about N, E, D"
    )
    return initial


def _given_attitude(gnss: GnssSeries, section: AlignmentSection) -> Alignment:
    assert section.rpy_deg is not None
    covariance = np.diag((np.array(section.sigma_deg) * units.DEG) ** 2)
    return Alignment(float(gnss.t[0]), np.array(section.rpy_deg) * units.DEG, covariance, "given attitude")


def _gyrocompassed(
    rates: ImuSeries, gnss: GnssSeries, level: Alignment | None, rest_end: float, section: AlignmentSection,
    spec: ImuSpec,
) -> tuple[int, Alignment]:  # fmt: skip
    """Attitude from the first seconds at rest, and the last fix in them."""
    if level is None:
        raise InputError("gyrocompassing needs a stretch at rest at the start of the log, and none was found")
    still = rates.between(rates.t[0], min(rest_end, rates.t[0] + section.rest_s))
    k = max(int(np.searchsorted(gnss.t, still.t[-1], side="right")) - 1, 0)
    return k, gyrocompass(
        still.gyro,
        still.accel,
        float(gnss.llh[k, 0]),
        t=float(gnss.t[k]),
        sigma_gyro_bias=spec.gyro.turn_on_bias,
        sigma_gyro_noise=spec.gyro.random_walk / float(np.sqrt(section.rest_s)),
        sigma_accel_bias=spec.accel.turn_on_bias,
        sigma_accel_noise=section.tilt_floor_deg * units.DEG * 9.81,
    )


def _course(gnss: GnssSeries, k: int, section: AlignmentSection) -> tuple[float, float, float]:
    """Heading from the course at a fix and its 1-sigma [rad], and the speed there [m/s]."""
    assert gnss.v_n is not None
    assert gnss.cov_v_n is not None
    sigma_v = float(np.sqrt(max(gnss.cov_v_n[k, 0, 0], gnss.cov_v_n[k, 1, 1])))
    heading, sigma = heading_from_course(gnss.v_n[k], sigma_v, sigma_sideslip=section.sideslip_deg * units.DEG)
    return heading, sigma, float(np.linalg.norm(gnss.v_n[k]))


def _at_rest(
    rates: ImuSeries, gnss: GnssSeries, section: AlignmentSection, spec: ImuSpec
) -> tuple[Alignment | None, tuple[FloatArray, float] | None, float]:
    """Levelling and gyro bias from the rest before the first motion, if there is any; and when it ends."""
    end = _rest_end(gnss)
    start = max(rates.t[0], end - section.rest_s)
    if end - start < 1.0:
        return None, None, end
    still = rates.between(start, end)
    length = end - start
    noise = float(np.hypot(spec.accel.random_walk / np.sqrt(length), section.tilt_floor_deg * units.DEG * 9.81))
    level = levelling(still.accel, t=end, sigma_bias=spec.accel.turn_on_bias, sigma_noise=noise)
    # Earth rate is taken off as far as it is known without a heading: its vertical part; the rest goes into sigma
    omega_ie_n = earth.earth_rate_ned(float(gnss.llh[0, 0]))
    vertical = level.C_nb.T @ np.array([0.0, 0.0, omega_ie_n[2]])
    mean = still.gyro.mean(axis=0) - vertical
    wander = spec.gyro.in_run_bias if spec.gyro.in_run_time else 0.0
    sigma = float(np.sqrt(spec.gyro.random_walk**2 / length + omega_ie_n[0] ** 2 + wander**2))
    spread = float(still.gyro.std(axis=0).max()) / np.sqrt(
        max(length, 1.0) * 5.0
    )  # vibration, a fifth of a second apart
    return level, (mean, max(sigma, spread)), end


def _rest_end(gnss: GnssSeries) -> float:
    """Time until which GNSS says the vehicle did not move; the first epoch's time if it moves at once."""
    if gnss.v_n is None or gnss.cov_v_n is None:
        offset = np.linalg.norm(frames.ecef_from_llh(gnss.llh) - frames.ecef_from_llh(gnss.llh[0]), axis=1)
        sigma = np.sqrt(np.einsum("nii->n", gnss.cov_r_n))
        moving = offset > 0.3 + 4.0 * sigma
    else:
        speed = np.linalg.norm(gnss.v_n, axis=1)
        moving = speed > _REST_SPEED + 2.0 * np.sqrt(np.einsum("nii->n", gnss.cov_v_n) / 3.0)
    if not moving.any():
        return float(gnss.t[-1])
    first = int(np.argmax(moving))
    return float(gnss.t[max(first - 2, 0)])  # two epochs earlier it had not begun to move


def _first_moving(gnss: GnssSeries, section: AlignmentSection) -> int:
    if gnss.v_n is None or gnss.cov_v_n is None:
        raise InputError(
            "the heading is to come from the course, but the GNSS series has no velocity; give alignment.method = "
            '"given" with rpy_deg, or "gyrocompass"'
        )
    speed = np.hypot(gnss.v_n[:, 0], gnss.v_n[:, 1])
    enough = speed > np.maximum(section.min_speed_m_s, 4.0 * np.sqrt(gnss.cov_v_n[:, 0, 0]))
    if not enough.any():
        raise InputError(
            f"the vehicle never moves faster than {section.min_speed_m_s} m/s "
            f"(largest GNSS speed {speed.max():.2f} m/s), "
            "so its course gives no heading; lower alignment.min_speed_m_s, give the attitude, or gyrocompass"
        )
    return int(np.argmax(enough))


def _level_in_motion(
    rates: ImuSeries, gnss: GnssSeries, k: int, heading: float, sigma: float, section: AlignmentSection, spec: ImuSpec
) -> Alignment:
    """Roll and pitch while moving: the specific force less the acceleration GNSS sees along the course."""
    v_n, cov_v_n = gnss.need_velocity()
    j = min(k + 1, len(gnss) - 1)
    i = max(j - 1, 0)
    span = float(gnss.t[j] - gnss.t[i])
    if not 0.0 < span <= 2.0:
        raise InputError("levelling in motion needs two GNSS velocities at most 2 s apart where the course is taken")
    a_n = (v_n[j] - v_n[i]) / span
    f_n = a_n - earth.gravity_ned(float(gnss.llh[k, 0]), float(gnss.llh[k, 2]))
    f_b = rates.between(float(gnss.t[i]), float(gnss.t[j])).accel.mean(axis=0)
    s = rotation.dcm_from_rpy(np.array([0.0, 0.0, heading])).T @ f_n  # axes turned to the heading, still level
    # f_b = R_x(roll)' R_y(pitch)' s: pitch from the forward, roll from the cross components
    pitch = np.arctan2(s[0], s[2]) - np.arctan2(f_b[0], -np.sqrt(max(s[0] ** 2 + s[2] ** 2 - f_b[0] ** 2, 0.0)))
    pitch = float(frames.wrap_angle(pitch))
    down = np.sin(pitch) * s[0] + np.cos(pitch) * s[2]
    roll = float(frames.wrap_angle(np.arctan2(f_b[1], f_b[2]) - np.arctan2(s[1], down)))
    noise = np.sqrt(2.0 * cov_v_n[k, 0, 0]) / span
    tilt = float(max(np.hypot(noise, spec.accel.turn_on_bias) / 9.81, 2.0 * section.tilt_floor_deg * units.DEG))
    return Alignment(
        float(gnss.t[k]),
        np.array([roll, pitch, heading]),
        np.diag([tilt**2, tilt**2, sigma**2]),
        "levelled in motion, heading from course",
    )


def _start_from_fix(
    gnss: GnssSeries, k: int, alignment: Alignment, rates: ImuSeries, layout: StateLayout, config: NavigationConfig,
    calibration: CalibrationStart | None,
) -> InitialState:  # fmt: skip
    """Initial state of the IMU from a fix of the antenna and an attitude, with the correlations between them."""
    lever = np.array(config.gnss.lever_arm_m)
    t = float(gnss.t[k])
    C_nb = alignment.C_nb
    arm_n = C_nb @ lever
    v_n, cov_v = np.zeros(3), 4.0 * np.eye(3)
    if gnss.v_n is not None and gnss.cov_v_n is not None:
        i = int(np.clip(np.searchsorted(rates.t, t), 0, len(rates.t) - 1))
        v_n = gnss.v_n[k] - C_nb @ np.cross(rates.gyro[i], lever)
        cov_v = gnss.cov_v_n[k]
    origin = gnss.llh[k]
    r_e = frames.ecef_from_llh(origin) - frames.C_en(origin) @ arm_n
    nav = NavState.from_geodetic(t, frames.llh_from_ecef(r_e), v_n, alignment.rpy_nb)
    start = InitialState.from_sigmas(nav, layout, attitude=np.zeros(3), velocity=cov_v, position=gnss.cov_r_n[k])
    start = start.aligned(alignment, layout) if calibration is None else calibration.aligned(start, alignment, layout)
    # the antenna is at the fix, so dr + dpsi x (C l) is the fix's error: dr = error + [C l x] dpsi; what is
    # estimated of the fix's own faults (lever arm, slow error, time offset) is in that error, with the sign turned
    T = np.eye(layout.size)
    T[6:9, 0:3] = rotation.skew(arm_n)
    for rows, name, column in (
        (slice(6, 9), "lever", -C_nb),
        (slice(6, 9), "b_r", -np.eye(3)),
        (slice(3, 6), "b_v", -np.eye(3)),
        (slice(6, 9), "delay", -v_n[:, None]),
        (slice(3, 6), "delay", -_acceleration(gnss, k)[:, None]),
    ):
        if name in layout:
            T[rows, layout[name]] = column
    return InitialState(nav, T @ start.P @ T.T, start.parameters)


def _with_rest_bias(
    initial: InitialState, layout: StateLayout, bias: FloatArray, sigma: float, notes: list[str]
) -> InitialState:
    """Initial state with gyro biases from the mean rate at rest."""
    estimates, P = initial.parameters.copy(), initial.P.copy()
    part = layout["b_g"]
    estimates[part.start - 9 : part.stop - 9] = bias
    P[part, part] = sigma**2 * np.eye(3)
    notes.append(
        "gyro biases start from the mean at rest: "
        + ", ".join(f"{b / units.DEG:+.3f}" for b in bias)
        + f" deg/s, 1-sigma {sigma / units.DEG:.4f}"
    )
    return InitialState(initial.nav, P, estimates)


def _updated_with_rest_rate(
    initial: InitialState, layout: StateLayout, alignment: Alignment, rate: FloatArray, sigma: float, notes: list[str]
) -> InitialState:
    """Kalman update of the initial state with the compensated rate at rest, which should be zero.

    It acts on biases, g-sensitivity times gravity, and all that correlates with them.
    """
    H = np.hstack((np.zeros((3, 9)), rest_columns(initial, alignment.C_nb, layout)[0]))
    P, R = initial.P, sigma**2 * np.eye(3)
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    dx, I_KH = K @ rate, np.eye(len(P)) - K @ H
    nav, C = initial.nav, frames.C_en(initial.nav.llh)
    nav = NavState(
        nav.t, nav.r_eb_e - C @ dx[6:9], nav.v_eb_e - C @ dx[3:6],
        rotation.quat_multiply(rotation.quat_from_rotvec(-C @ dx[:3]), nav.q_eb),
    )  # fmt: skip
    updated = InitialState(nav, I_KH @ P @ I_KH.T + K @ R @ K.T, initial.parameters - dx[9:])
    part = layout["b_g"]
    b, s = updated.parameters[part.start - 9 : part.stop - 9], np.sqrt(np.diag(updated.P)[part])
    notes.append(
        f"the mean rate at rest is {np.abs(rate).max() / units.DEG:.4f} deg/s off what was known before (1-sigma of "
        f"the mean {sigma / units.DEG:.4f}); gyro biases start from both: "
        + ", ".join(f"{x / units.DEG:+.4f}" for x in b)
        + f" deg/s, 1-sigma {s.max() / units.DEG:.4f}"
    )
    return updated


def _acceleration(gnss: GnssSeries, k: int) -> FloatArray:
    """Acceleration between the fixes around one, north-east-down; zero where there are none. Shape (3,). [m/s^2]"""
    i, j = max(k - 1, 0), min(k + 1, len(gnss) - 1)
    if gnss.v_n is None or j == i or not 0.0 < gnss.t[j] - gnss.t[i] <= 4.0:
        return np.zeros(3)
    return np.asarray((gnss.v_n[j] - gnss.v_n[i]) / (gnss.t[j] - gnss.t[i]))


def advance_to_log_start(initial: InitialState, increments: Increments) -> InitialState:
    """Initial state propagated to the start of the first interval, at most one sample later."""
    step = increments.start - initial.nav.t
    if step > 0.5:
        raise InputError(f"the IMU log begins {step:.2f} s after the initial state; alignment and log must overlap")
    nav = initial.nav
    nav_at_start = NavState(increments.start, nav.r_eb_e + step * nav.v_eb_e, nav.v_eb_e, nav.q_eb)
    return InitialState(nav_at_start, initial.P, initial.parameters)
