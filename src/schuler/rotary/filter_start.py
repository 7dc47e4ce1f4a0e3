"""Where the filter of a rotating IMU starts: the vehicle's state, seen in axes that turn in it."""

from __future__ import annotations

import numpy as np

from schuler import earth, frames, rotation, units
from schuler.arrays import FloatArray
from schuler.exceptions import ConfigError, InputError
from schuler.filtering.initial_state import InitialState
from schuler.filtering.states import StateLayout
from schuler.navigation.config import NavigationConfig
from schuler.navigation.start.alignment import align, aligned_sentence
from schuler.navigation.start.heading import no_heading
from schuler.recording.series import GnssSeries, ImuSeries, Increments
from schuler.rotary import gimbals
from schuler.rotary.encoder import Platform
from schuler.rotary.mechanization import sensor_start
from schuler.sensors.spec import ImuSpec

_STILL = 0.01  # a platform that turns by less while the IMU is aligned stands still [rad]
_LONGEST_REST = 10.0  # as much rest is used [s]
_AFTER_REST = 20.0  # the alignment at rest serves for a start so much later [s]


def aligned_vehicle(
    body_log: ImuSeries,
    increments: Increments,
    gnss: GnssSeries | None,
    platform: Platform,
    config: NavigationConfig,
    spec: ImuSpec,
    layout: StateLayout,
    windows: tuple[tuple[float, float], ...],
    notes: list[str],
) -> InitialState:
    """Initial state of the vehicle from the log itself; biases in the axes of the IMU.

    Parameters
    ----------
    body_log : ImuSeries
        The log turned into body axes, see :func:`schuler.rotary.mechanization.body_increments`.
    increments : Increments
        In the axes of the IMU.
    gnss, config, spec, layout, windows, notes
        As for :func:`schuler.navigation.start.alignment.align`, which does the work in body axes.
    platform : Platform

    Raises
    ------
    ConfigError
        If the log is to be gyrocompassed while the platform turns.

    Notes
    -----
    Where the platform stood still during alignment, attitude and biases stay correlated as they are. Where it turned,
    the mean tilt error of the accelerometer biases over the alignment is smaller than is claimed, and their correlation
    is given up; gyroscope biases are the mean at rest less the platform's rate and Earth rate.
    """
    # the platform must stand still meanwhile: a short rest is enough
    section = config.alignment.model_copy(update={"rest_s": min(config.alignment.rest_s, _LONGEST_REST)})
    config = config.model_copy(update={"alignment": section})
    if config.alignment.method == "gyrocompass":
        first = float(increments.start)
        if _turns(platform, first, min(first + config.alignment.rest_s, float(increments.t[-1]))):
            raise ConfigError(
                'alignment.method: "gyrocompass" needs a platform that stands still at first; wait with the rotation, '
                "or give an initial state"
            )
    start = align(body_log, gnss, config, spec, layout, windows, notes)
    if start.obstacle:
        raise InputError(no_heading(start.obstacle))
    initial = start.initial
    notes.append(aligned_sentence(initial, start.method, float(body_log.t[0])))
    t = initial.nav.t
    if not _turns(platform, max(float(increments.start), t - config.alignment.rest_s - _AFTER_REST), t):
        T = np.eye(layout.size)
        C_bs = gimbals.C_bs(platform.axes, platform.angles(np.array([t])), platform.C_mount)[0]
        for name in ("b_a", "b_g", "b_a_run", "b_g_run"):
            if name in layout:
                T[layout[name], layout[name]] = C_bs.T
        return InitialState(initial.nav, T @ initial.P @ T.T, T[9:, 9:] @ initial.parameters)
    P, estimates = initial.P.copy(), initial.parameters.copy()
    sensor = slice(9, 9 + layout.n_sensor)
    P[:, sensor], P[sensor, :], estimates[: layout.n_sensor] = 0.0, 0.0, 0.0
    P[sensor, sensor] = np.diag(layout.initial_variances()[: layout.n_sensor])
    note = "the platform turned during alignment: attitude and biases start uncorrelated"
    rest_bias = _rest_bias(increments, gnss, platform, initial, config.alignment.rest_s, spec)
    if rest_bias is not None and "b_g" in layout:
        part = layout["b_g"]
        estimates[part.start - 9 : part.stop - 9], sigma = rest_bias
        P[part, part] = sigma**2 * np.eye(3)
        note += f"; gyro biases from the rest before the motion, 1-sigma {sigma / units.DEG:.4f} deg/s"
    notes.append(note)
    return InitialState(initial.nav, P, estimates)


def imu_start(
    vehicle: InitialState,
    platform: Platform,
    offset_m: FloatArray,
    omega_is_s: FloatArray,
    layout: StateLayout,
    *,
    earth_rotation: bool,
) -> InitialState:
    """The vehicle's initial state as that of the IMU, with its covariance.

    Parameters
    ----------
    vehicle : InitialState
        Navigation state of the body; parameters in the axes of the IMU.
    platform : Platform
    offset_m : ndarray, shape (3,)
        From the point where the axes meet to the accelerometers, IMU axes. [m]
    omega_is_s : ndarray, shape (3,)
        Rate of the IMU at that time, without its bias. [rad/s]
    layout : StateLayout
    earth_rotation : bool
    """
    nav = sensor_start(vehicle.nav, platform, offset_m, omega_is_s, earth_rotation=earth_rotation)
    if not offset_m.any():
        return InitialState(nav, vehicle.P, vehicle.parameters)
    C_en = frames.C_en(nav.llh)
    T = np.eye(layout.size)
    # an attitude error turns the offset with it: d(C l) = -[C l x] dpsi
    T[6:9, 0:3] = -rotation.skew(C_en.T @ (nav.r_eb_e - vehicle.nav.r_eb_e))
    T[3:6, 0:3] = -rotation.skew(C_en.T @ (nav.v_eb_e - vehicle.nav.v_eb_e))
    return InitialState(nav, T @ vehicle.P @ T.T, vehicle.parameters)


def _turns(platform: Platform, start: float, stop: float) -> bool:
    return bool(np.any(np.ptp(platform.angles(np.linspace(start, max(stop, start), 200)), axis=0) > _STILL))


def _rest_bias(
    increments: Increments,
    gnss: GnssSeries | None,
    platform: Platform,
    initial: InitialState,
    length: float,
    spec: ImuSpec,
) -> tuple[FloatArray, float] | None:
    """Gyro bias in IMU axes and its sigma from the rest before the first motion; None without one."""
    if gnss is None or gnss.v_n is None or gnss.cov_v_n is None:
        return None
    limit = 0.3 + 2.0 * np.sqrt(np.einsum("nii->n", gnss.cov_v_n) / 3.0)  # as the alignment takes it [m/s]
    moving = np.flatnonzero(np.linalg.norm(gnss.v_n, axis=1) > limit)
    stop = float(gnss.t[max(moving[0] - 2, 0)]) if len(moving) else float(gnss.t[-1])
    inside = (increments.t <= stop) & (increments.t - increments.dt >= stop - length)
    if not inside.any() or float(increments.dt[inside].sum()) < 1.0:
        return None
    dt = increments.dt[inside]
    middle = increments.t[inside] - 0.5 * dt
    angles = platform.angles(middle)
    own = gimbals.omega_bs_s(platform.axes, angles, platform.rates(middle), platform.C_mount)
    C_nb = rotation.dcm_from_quat(initial.nav.q_nb)
    earth_b = C_nb.T @ earth.earth_rate_ned(float(initial.nav.llh[0]))
    carried = gimbals.C_bs(platform.axes, angles, platform.C_mount).swapaxes(1, 2) @ earth_b
    T = float(dt.sum())
    bias = (increments.dtheta_ib_b[inside] - dt[:, None] * (own + carried)).sum(axis=0) / T
    wander = spec.gyro.in_run_bias if spec.gyro.in_run_time else 0.0
    heading = float(earth.WGS84.omega_ie * np.sqrt(initial.P[2, 2]))
    return bias, float(np.sqrt(spec.gyro.random_walk**2 / T + heading**2 + wander**2))
