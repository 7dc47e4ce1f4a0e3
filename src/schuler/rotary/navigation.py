"""From the recording of an IMU that turns on a platform, and the platform's angles, to the vehicle's navigation."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler import rotation
from schuler.arguments import explains_arguments
from schuler.arrays import ArrayLike, FloatArray, as_vector3
from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import ConfigError
from schuler.filtering.engine import run
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import MeasurementSchedule
from schuler.filtering.states import StateLayout
from schuler.navigation.aids.aiding import Sources, aiding_schedule
from schuler.navigation.config import NavigationConfig
from schuler.navigation.inputs.gnss_faults import rejections
from schuler.navigation.inputs.preparation import (
    current_velocities,
    filter_options,
    prepared_gnss,
    prepared_imu,
    with_late_velocities,
)
from schuler.navigation.result import NavigationResult
from schuler.navigation.run import provenance_of
from schuler.navigation.start.alignment import advance_to_log_start
from schuler.navigation.start.calibration import configured_start
from schuler.navigation.states import imu_spec, state_layout, white_noise_psd
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries
from schuler.rotary.aids import check_aids, in_imu_axes
from schuler.rotary.encoder import Platform
from schuler.rotary.filter_start import aligned_vehicle, imu_start
from schuler.rotary.mechanization import body_increments, body_trajectory, rates_at_limits
from schuler.rotary.platform_check import Clocked, check_platform, covered
from schuler.sensors.spec import ImuSpec


@explains_arguments
def navigate_rotary(
    recording: Recording,
    platform: Platform,
    config: NavigationConfig | dict[str, Any] | Path | str,
    *,
    platform_zero_s: float = 0.0,
    offset_m: ArrayLike = (0.0, 0.0, 0.0),
    initial: InitialState | None = None,
    calibration: CalibrationResult | Path | str | None = None,
    progress: Callable[[float], None] | None = None,
) -> NavigationResult:
    """Navigate a vehicle with an IMU that a platform turns on it, aided by GNSS or by rest.

    The filter is the one of :func:`schuler.navigation.run.navigate`, in the axes of the IMU, where its biases are
    what they are; what comes out is the vehicle.

    Parameters
    ----------
    recording : Recording
        Its IMU series in the axes of the IMU; GNSS of an antenna fixed to the vehicle.
    platform : Schedule or EncoderReadings
        Angles of the platform: as commanded, or (better) as read by its encoder.
    config : NavigationConfig, dict, or path of a TOML file
        As for ``navigate``. Lever arms are in vehicle axes, from the point where the platform's axes meet; models of
        biases are those in the axes of the IMU.
    platform_zero_s : float
        Time of the recording at which the platform's clock is zero; also takes off a known time offset of an encoder.
        [s]
    offset_m : array_like, shape (3,)
        From the point where the platform's axes meet to the accelerometers, IMU axes. Left out, an IMU off the axis
        looks as if it had an acceleration bias of ``rate^2 offset``, and another one at each change of rate. [m]
    initial : InitialState, optional
        State of the **vehicle**; biases in the axes of the IMU. Start here instead of aligning.
    calibration : CalibrationResult or path, optional
        Calibration of the IMU, see ``navigate``; needs ``initial``.
    progress : callable, optional
        Called with the fraction done.

    Returns
    -------
    NavigationResult
        Position of the point where the platform's axes meet, velocity, and attitude of the vehicle
        ``C_nb = C_ns C_sb``; sensor parameters and innovations of the IMU in its own axes. Attitude errors mean the
        same for both, so covariances, ``.smooth()``, ``.report()`` and ``.nees()`` (truth of the vehicle) are as for
        any run. Errors of the encoder are not in the covariance: add its 1-sigma to the attitude's.

    Raises
    ------
    InputError, ConfigError
        As ``navigate``; also if the gyroscopes do not see the platform turn as it says, its readings do not cover the
        log, or an aid is configured that needs the vehicle's axes.

    Notes
    -----
    With an offset, smoothing leaves out the offset times the change of attitude it makes: under a millimetre.

    References
    ----------
    Du (2015), sections 2.2, 5.4 and 6.1, where data are turned to body axes first and the states are in local-level
    axes. Here the IMU's own axes are navigated: biases need no turning, and the platform's rate is only used where a
    lever arm moves.

    Examples
    --------
    >>> from schuler.rotary import RotatingMotion, continuous, ideal_rotating_imu
    >>> from schuler.sensors import ImuErrors, catalogue
    >>> from schuler.simulation import GnssModel, StaticMotion, simulate_gnss, simulate_imu
    >>> rng, turning = np.random.default_rng(1), continuous("z", 0.35, start=20.0)
    >>> ship = StaticMotion([0.8, 0.2, 0.0], [0.0, 0.0, 0.5], 120.0)
    >>> ideal = ideal_rotating_imu(RotatingMotion(ship, turning), 100.0)
    >>> imu = simulate_imu(ideal, ImuErrors.draw(catalogue.spec("HG1700"), rng), rng).imu
    >>> log = schuler.Recording(imu, simulate_gnss(ship, GnssModel(sigma_position=(0.1,) * 3), rng))
    >>> start = {"method": "given", "rpy_deg": [0.0, 0.0, 29.0]}
    >>> config = {"imu": {"catalogue": "HG1700"}, "alignment": start}
    >>> result = schuler.navigate_rotary(log, turning, config)
    >>> result.complete
    True
    """
    config = NavigationConfig.checked(config)
    check_aids(config)
    began = time.perf_counter()
    lever = as_vector3(offset_m, "offset_m")
    notes = list(recording.metadata.notes)
    spec = imu_spec(config)
    calibrated = configured_start(config, recording.need_imu(), calibration)
    if calibrated is not None and initial is None:
        raise ConfigError("a calibrated rotating IMU is not aligned from its log: give the vehicle's initial state")
    turning = Clocked(platform, float(platform_zero_s))
    imu = covered(prepared_imu(recording.need_imu(), config, notes, calibrated), turning, notes)
    increments = imu.increments(order=config.imu.rate_order)
    check_platform(increments, turning)
    in_body = body_increments(increments, turning)
    body_log = ImuSeries(in_body.t, in_body.dtheta_ib_b, in_body.dv_ib_b, "increment")
    gnss = None if recording.gnss is None else prepared_gnss(recording.gnss, config, notes, body_log)
    layout = state_layout(config, spec)
    origin, delay = recording.start, config.gnss.velocity_delay_s
    windows = config.outages.resolve(origin, recording.stop if gnss is None else float(gnss.t[-1]))
    if initial is None:
        fixes = None if gnss is None else current_velocities(gnss, delay)
        initial = aligned_vehicle(body_log, increments, fixes, turning, config, spec, layout, windows, notes)
    elif calibrated is not None:
        initial = calibrated.put_into(initial)
    increments = increments.between(initial.nav.t - 1e-9, increments.t[-1])
    initial = advance_to_log_start(initial, increments)
    rates = rates_at_limits(increments)
    start = imu_start(
        initial, turning, lever, rates[0] - _bias(layout, initial.parameters), layout,
        earth_rotation=config.filter.earth_rotation,
    )  # fmt: skip
    sources = Sources(body_log, gnss, None, None, None, recording.height)
    schedule = _measurements(sources, config, spec, initial.nav.t, origin, windows, notes)
    schedule = schedule.where(schedule.t <= increments.t[-1] + 1e-9)
    schedule = in_imu_axes(schedule, turning, lever, increments=increments)
    if not len(schedule):
        notes.append("no measurement is used: this is a free inertial solution")
    options = filter_options(config, imu)
    psd = white_noise_psd(config, spec)
    forward = run(increments, schedule, start, layout, *psd, options, progress, keep_part=True)
    if forward.epochs == 0 or not len(forward.rec_t):
        raise KeyboardInterrupt  # stopped before there was anything to keep
    if not forward.complete:
        notes.append(f"interrupted at {forward.t[-1] - origin:.1f} s of the recording; the solution ends there")
    notes += rejections(schedule.kind, forward.status, schedule.t, schedule.R, forward.noise_factors)
    notes.append(
        "attitude is that of the vehicle, sensor parameters are in the axes of the turning IMU"
        + (f"; IMU {np.linalg.norm(lever):.3f} m off the axis" if lever.any() else "")
    )
    of_imu = NavigationResult.from_run(
        forward,
        schedule.t,
        schedule.kind,
        layout,
        outages=windows,
        lever_arm_b=np.array(config.gnss.lever_arm_m),
        provenance={
            **provenance_of(recording, config, spec, calibrated),
            "platform": _platform_document(platform, turning.zero_s, lever),
            "elapsed_s": time.perf_counter() - began,
        },
        notes=tuple(notes),
    )
    return vehicle_result(of_imu, turning, lever, increments.t, rates[1:], earth_rotation=config.filter.earth_rotation)


def _measurements(
    sources: Sources,
    config: NavigationConfig,
    spec: ImuSpec,
    start: float,
    origin: float,
    windows: tuple[tuple[float, float], ...],
    notes: list[str],
) -> MeasurementSchedule:
    """Measurements of the configured aids outside the outages, lever arms in vehicle axes."""
    schedule, notes_of_aids = aiding_schedule(sources, config, spec, start, origin, windows)
    notes += notes_of_aids
    return with_late_velocities(schedule.outside(windows), config.gnss.velocity_delay_s, start, notes)


def _platform_document(platform: Platform, zero_s: float, offset_m: FloatArray) -> dict[str, Any]:
    """Platform and place of the IMU on it, for the provenance of a solution."""
    return {
        "from": type(platform).__name__,
        "name": getattr(platform, "name", ""),
        "axes": np.asarray(platform.axes).tolist(),
        "zero_s": zero_s,
        "offset_m": offset_m.tolist(),
    }


def vehicle_result(
    of_imu: NavigationResult,
    platform: Platform,
    offset_m: FloatArray,
    t: FloatArray,
    omega_is_s: FloatArray,
    *,
    earth_rotation: bool = True,
) -> NavigationResult:
    """The vehicle under the IMU: trajectory, states and covariance of a filter's result.

    Parameters
    ----------
    of_imu : NavigationResult
        In the axes of the IMU.
    platform : Platform
    offset_m : ndarray, shape (3,)
        From the point where the platform's axes meet to the IMU, IMU axes. [m]
    t : ndarray, shape (n,)
        Times of the rates. [s]
    omega_is_s : ndarray, shape (n, 3)
        Gyroscope readings, biases not taken off; used with an offset only. [rad/s]
    earth_rotation : bool
    """
    if not offset_m.any():
        moved = [body_trajectory(x, platform) for x in (of_imu.trajectory, of_imu.states)]
        return replace(of_imu, trajectory=moved[0], states=moved[1])

    def omega(at: FloatArray) -> FloatArray:
        rate: FloatArray = np.column_stack([np.interp(at, t, column) for column in omega_is_s.T])
        if "b_g" not in of_imu.layout:
            return rate
        bias = of_imu.parameter("b_g")
        rate -= np.column_stack([np.interp(at, of_imu.t, column) for column in bias.T])
        return rate

    trajectory, states = (
        body_trajectory(x, platform, offset_m, omega(x.t), earth_rotation=earth_rotation)
        for x in (of_imu.trajectory, of_imu.states)
    )
    T = np.tile(np.eye(of_imu.layout.size), (len(states), 1, 1))
    T[:, 6:9, 0:3] = rotation.skew(of_imu.states.r_eb_e - states.r_eb_e)
    T[:, 3:6, 0:3] = rotation.skew(of_imu.states.v_eb_e - states.v_eb_e)
    covariance: FloatArray = T @ of_imu.covariance_e @ np.swapaxes(T, 1, 2)
    return replace(of_imu, trajectory=trajectory, states=states, covariance_e=covariance)


def _bias(layout: StateLayout, parameters: FloatArray) -> FloatArray:
    """Gyro bias among the parameters, zero if it is none. Shape (3,). [rad/s]"""
    if "b_g" not in layout:
        return np.zeros(3)
    part = layout["b_g"]
    bias: FloatArray = parameters[part.start - 9 : part.stop - 9]
    return bias
