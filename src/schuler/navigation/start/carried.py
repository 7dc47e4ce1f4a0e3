"""Start at a late first fix with attitude, velocity and sensor errors of a rest before it, carried inertially."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler import frames, rotation, units
from schuler.arrays import FloatArray
from schuler.filtering.engine import run
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import MeasurementSchedule, gate_threshold
from schuler.mechanization.alignment import levelling
from schuler.mechanization.strapdown import NavState
from schuler.navigation.config import NavigationConfig
from schuler.navigation.prepared import PreparedRun
from schuler.navigation.result import NavigationResult
from schuler.navigation.start.alignment import Start, position_error_of_fix, with_mount_in_heading
from schuler.navigation.start.levelling import CARRIED_S
from schuler.navigation.start.rest_bias import bias_of_rests, with_bias
from schuler.navigation.start.velocity_fit import with_velocities
from schuler.recording.series import GnssSeries, Increments

_LEAST_S = 5.0  # between rest and fix; at less the attitude of a rest that GNSS confirms is as good [s]
_MOST = 6  # rests that are tried, the latest
_STANDING = 0.02  # 1-sigma of the velocity of a rest [m/s]
_GATE = 0.999  # probability with which the velocity of a good carried start passes
_ANY_HEADING = 1.0  # 1-sigma of the heading at rest, which the course at the fix shows [rad]
_FAULTS = {"b_v", "delay"}  # of GNSS velocities: such starts are made at the fix


def carried_starts(
    start: Start, prepared: PreparedRun, gnss: GnssSeries, config: NavigationConfig
) -> list[InitialState]:
    """Initial states at the fix of a start, each of a rest before it carried there by inertial navigation.

    Parameters
    ----------
    start : Start
        With a heading from the course.
    prepared : PreparedRun
        Of this start.
    gnss : GnssSeries
        Fixes as the start had them; the velocity at its time is used as a measurement where the receiver states one.
    config : NavigationConfig

    Returns
    -------
    list of InitialState
        Of rests five seconds to two minutes before the fix whose velocity agrees with it when carried there; none if
        GNSS confirms a later one, with ranges, with a calibration, or with states for faults of GNSS velocities.

    Notes
    -----
    A vehicle at rest is level to its accelerometers' biases, and its velocity is zero. Carried on, errors of tilt,
    velocity and biases have the correlations that the error equations give them, and a velocity at the fix shows the
    tilt as no levelling in motion can (0.5 deg are 5 m/s after a minute). The position at the rest is unknown, so that
    of the fix is taken; so is the heading, until course and sideslip of the fix show it. A stretch that only looks like
    rest to the IMU, a steady drive, is off by its speed at the fix: one that is not was a rest, and is taken as that.
    """
    rests, layout, t = start.rests, prepared.layout, start.initial.nav.t
    if start.source != "course" or rests is None or prepared.calibrated is not None:
        return []
    if prepared.ranges is not None or _FAULTS & layout.models.keys() or "b_g" not in layout:
        return []
    tried = np.flatnonzero((t - rests.stop >= _LEAST_S) & (t - rests.stop <= CARRIED_S))[-_MOST:]
    if len(tried) == 0 or (rests.confirmed[-1] and t - rests.stop[-1] < _LEAST_S):
        return []
    rates = prepared.imu.rates()
    increments = prepared.imu.increments(order=config.imu.rate_order)
    starts = []
    for k in tried.tolist():
        sure = rests.confirm(k)
        bias = bias_of_rests(sure, float(start.initial.nav.llh[0]), rates, prepared.spec, layout)
        assert bias is not None
        part = increments.between(float(rests.stop[k]), t + 1e-9)
        carried = _carried(part, rests.force[k], float(rests.noise_force[k]), bias, start, prepared, config)
        at_fix = _at_fix(carried, gnss, start, prepared, config)
        if at_fix is not None:
            starts.append(with_mount_in_heading(at_fix, layout, np.array(config.gnss.lever_arm_m)))
    return starts


def _carried(
    increments: Increments, force: FloatArray, sigma_force: float, bias: tuple[FloatArray, float], start: Start,
    prepared: PreparedRun, config: NavigationConfig,
) -> NavigationResult:  # fmt: skip
    """Inertial navigation from a rest of this mean force [m/s^2] to the fix of a start, by the filter's covariance."""
    spec, layout = prepared.spec, prepared.layout
    noise = float(np.hypot(sigma_force, config.alignment.tilt_floor_deg * units.DEG * units.G0))
    level = levelling(force, t=increments.start, sigma_bias=spec.accel.turn_on_bias, sigma_noise=noise)
    span = float(increments.t[-1] - increments.start)
    options = replace(prepared.options, smoother=False, record_s=span, output_rate_hz=1.0)
    heading, llh = start.heading, start.initial.nav.llh
    for last in (False, True):  # the first for turn and way in between
        attitude = level.with_heading(heading, _ANY_HEADING, "")
        nav = NavState.from_geodetic(increments.start, llh, np.zeros(3), attitude.rpy_nb)
        state = InitialState.from_sigmas(
            nav, layout, attitude=np.zeros(3), velocity=np.full(3, _STANDING), position=np.ones(3)
        )
        state = with_bias(state, layout, *bias).aligned(attitude, layout)
        forward = run(increments, MeasurementSchedule.empty(), state, layout, *prepared.psd, options)
        carried = NavigationResult.from_run(forward, np.empty(0), np.empty(0, np.int64), layout)
        if not last:
            heading += float(frames.wrap_angle(start.heading - carried.states.rpy_nb[-1, 2]))
            way = carried.states.r_eb_e[-1] - nav.r_eb_e
            llh = frames.llh_from_ecef(start.initial.nav.r_eb_e - way)
    return carried


def _at_fix(
    carried: NavigationResult, gnss: GnssSeries, start: Start, prepared: PreparedRun, config: NavigationConfig
) -> InitialState | None:
    """Last state of a carried rest, with position, velocity and course of the fix; None if its velocity is beyond."""
    t, layout = start.initial.nav.t, prepared.layout
    k = int(np.argmin(np.abs(gnss.t - t)))
    s, lever = carried.states, np.array(config.gnss.lever_arm_m)
    C_nb, v_n, C_en = s.C_nb[-1], s.v_eb_n[-1], frames.C_en(gnss.llh[k])
    P = carried.covariance[-1].copy()
    if not (np.isfinite(P).all() and np.isfinite(v_n).all()):
        return None
    P[6:9, :] = P[:, 6:9] = 0.0
    P[6:9, 6:9] = gnss.cov_r_n[k]
    T = position_error_of_fix(layout, C_nb, lever, v_n)
    P = T @ P @ T.T
    v_fix, cov_fix = with_velocities(gnss).need_velocity()
    i = int(np.clip(np.searchsorted(prepared.imu.t, t), 0, len(prepared.imu) - 1))
    rate = prepared.imu.rates().gyro[i] - carried.parameter("b_g")[-1]
    v_antenna = v_n + C_nb @ np.cross(rate, lever)
    S, y = P[3:6, 3:6] + cov_fix[k], v_antenna - v_fix[k]
    if float(y @ np.linalg.solve(S, y)) > gate_threshold(_GATE, 3):
        return None
    dx = np.zeros(layout.size)
    H_course = np.eye(layout.size)[2:3]
    if gnss.cov_v_n is not None and np.array_equal(cov_fix[k, :2, :2], gnss.cov_v_n[k, :2, :2]):
        dx, P = _updated(dx, P, np.eye(layout.size)[3:6], v_antenna - v_fix[k], gnss.cov_v_n[k])
        # the heading is the course but for the sideslip; an error of the velocity turns the course
        v = v_n - dx[3:6]
        speed2 = float(v[:2] @ v[:2])
        H_course[0, 3:5] = v[1] / speed2, -v[0] / speed2
        heading = carried.states.rpy_nb[-1, 2] - dx[2]
        off = float(frames.wrap_angle(heading - np.arctan2(v[1], v[0])))
        dx, P = _updated(dx, P, H_course, np.array([off]) + H_course @ dx, np.array([[_sideslip(config) ** 2]]))
    else:  # fitted to the positions that the filter is given: a course, and no second measurement
        dx, P = _updated(dx, P, H_course, np.zeros(1), np.array([[start.sigma**2]]))
    q = rotation.quat_multiply(rotation.quat_from_rotvec(-C_en @ dx[:3]), s.q_eb[-1])
    r = frames.ecef_from_llh(gnss.llh[k]) - C_en @ (C_nb @ lever) - C_en @ dx[6:9]
    nav = NavState(t, r, s.v_eb_e[-1] - C_en @ dx[3:6], q)
    return InitialState(nav, P, carried.parameters[-1] - dx[9:])


def _sideslip(config: NavigationConfig) -> float:
    """1-sigma angle between course and heading. [rad]"""
    return max(config.alignment.sideslip_deg * units.DEG, 1e-4)


def _updated(
    dx: FloatArray, P: FloatArray, H: FloatArray, y: FloatArray, R: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Kalman update of errors estimated so far and their covariance; ``y`` is ``H`` times the error, as measured."""
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    I_KH = np.eye(len(P)) - K @ H
    P = I_KH @ P @ I_KH.T + K @ R @ K.T
    return dx + K @ (y - H @ dx), 0.5 * (P + P.T)
