"""Measurements of a wheeled vehicle: no velocity across and up, and the speed of its wheels."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from math import ceil

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray, as_vector3
from schuler.exceptions import InputError
from schuler.filtering.measurements import (
    GNSS_KINDS,
    LATERAL,
    SPEED,
    VERTICAL,
    MeasurementSchedule,
    gate_threshold,
    merged,
)
from schuler.recording.series import ImuSeries, OdometerSeries
from schuler.standstill.detectors import moving_moments, window_samples

#: Conditions look at means over so long: vibration is not a manoeuvre. [s]
SMOOTHING_S = 0.5
#: Noise is tuned by fixes up to so far apart; what lasts longer is not seen there. [s]
UNAIDED_S = 15.0


@dataclass(frozen=True)
class VehicleConditions:
    """Conditions under which a vehicle is assumed not to slip.

    Attributes
    ----------
    max_turn_rate : float
        Lateral: largest turn rate. [rad/s]
    max_lateral_acceleration : float
        Lateral: largest acceleration across, where tyres begin to slip. [m/s^2]
    max_forward_acceleration : float
        Vertical: largest change of speed, which makes a vehicle pitch on its springs. [m/s^2]
    min_speed : float
        Both: at rest nothing rolls, and zero-velocity updates are the better measurement. [m/s]

    Notes
    -----
    A car squats and dives by some 0.3 degrees per m/s^2, so at 10 m/s an axle that is followed well to the side may
    still move 0.05 m/s up or down for each m/s^2: with a small ``sigma_vertical`` lower ``max_forward_acceleration``.
    A sharp turn is bad for a lever arm that is not known, rather than for tyres: estimate it and allow the turns.
    """

    max_turn_rate: float = 0.35
    max_lateral_acceleration: float = 4.0
    max_forward_acceleration: float = 3.0
    min_speed: float = 0.5

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not value >= 0.0:
                raise InputError(
                    f"VehicleConditions.{item.name}: expected a number from 0 to inf (no condition), got {value!r}"
                )


def non_holonomic(
    imu: ImuSeries,
    *,
    rate_hz: float = 5.0,
    sigma_lateral: float = 0.1,
    sigma_vertical: float = 0.1,
    lever_b: ArrayLike = (0.0, 0.0, 0.0),
    conditions: VehicleConditions | None = None,
    gate: float | None = 0.9999,
    start: float | None = None,
) -> MeasurementSchedule:
    """Zero lateral and zero vertical velocity of a wheeled vehicle, where its motion allows.

    Parameters
    ----------
    imu : ImuSeries
        Log of the run in vehicle axes; conditions are judged by its means over half a second.
    rate_hz : float
        How often. Slip and mount errors are not white: more often than a few times a second adds confidence, not
        information. [Hz]
    sigma_lateral, sigma_vertical : float
        1-sigma of the velocity across and up. [m/s]
    lever_b : array_like, shape (3,)
        From the IMU to the point that does not slip: the middle of the rear axle of a car. [m]
    conditions : VehicleConditions, optional
    gate : float, optional
        Probability with which a correct measurement passes.
    start : float, optional
        First time; default the start of the log. [s]

    Returns
    -------
    MeasurementSchedule
        All measurements; the filter counts those whose conditions are not met.

    Raises
    ------
    InputError
        If the rate or a sigma is not positive.

    References
    ----------
    Yaman (2017), section 4.6 and eqs. (4-40)-(4-43); Dissanayake et al. (2001), IEEE Trans. Robotics 17(5). Mount
    angles and lever arm, which Yaman leaves out, are states.
    """
    if not (rate_hz > 0.0 and sigma_lateral > 0.0 and sigma_vertical > 0.0):
        raise InputError(
            f"expected positive rate_hz and sigmas, got {rate_hz!r}, {sigma_lateral!r}, {sigma_vertical!r}"
        )
    first = float(imu.t[0]) if start is None else start
    t = np.arange(first + 1.0 / rate_hz, float(imu.t[-1]), 1.0 / rate_hz)
    if not len(t):
        return MeasurementSchedule.empty()
    return no_slip(
        t, smoothed_motion(imu, t), sigma_lateral=sigma_lateral, sigma_vertical=sigma_vertical, lever_b=lever_b,
        conditions=conditions, gate=gate,
    )  # fmt: skip


def no_slip(
    t: FloatArray,
    motion: tuple[FloatArray, FloatArray, FloatArray],
    *,
    sigma_lateral: float = 0.1,
    sigma_vertical: float = 0.1,
    lever_b: ArrayLike = (0.0, 0.0, 0.0),
    conditions: VehicleConditions | None = None,
    gate: float | None = 0.9999,
) -> MeasurementSchedule:
    """Zero lateral and vertical velocity at given times, where the motion there allows; see :func:`non_holonomic`.

    Parameters
    ----------
    t : ndarray, shape (n,)
        [s]
    motion : tuple of ndarray, shapes (n,)
        Turn rate, specific force across and along, as :func:`smoothed_motion` has them.
    sigma_lateral, sigma_vertical, lever_b, conditions, gate
        As of :func:`non_holonomic`.
    """
    turn, across, along = motion
    conditions = conditions or VehicleConditions()
    lever = as_vector3(lever_b, "lever_b")
    lateral = (np.abs(turn) <= conditions.max_turn_rate) & (np.abs(across) <= conditions.max_lateral_acceleration)
    vertical = np.abs(along) <= conditions.max_forward_acceleration
    z = np.zeros((len(t), 8))
    z[:, 7] = conditions.min_speed
    threshold = gate_threshold(gate, 1)

    def schedule(kind: int, sigma: float, met: BoolArray) -> MeasurementSchedule:
        return MeasurementSchedule.of(kind, t, z, sigma**2, lever, np.where(met, threshold, -1.0))

    return merged(schedule(LATERAL, sigma_lateral, lateral), schedule(VERTICAL, sigma_vertical, vertical))


def weaker_without_fixes(schedule: MeasurementSchedule, factor: float, fixes: FloatArray) -> MeasurementSchedule:
    """The schedule with larger sigmas of wheels that do not slip where the last fix is long ago.

    Parameters
    ----------
    schedule : MeasurementSchedule
    factor : float
        On 1-sigma of the velocity across and up, later than :data:`UNAIDED_S` after the last fix.
    fixes : ndarray, shape (m,)
        Times of fixes, and that from which there is none if none comes first. Ascending. [s]

    Notes
    -----
    What a car slips, pitches and leans, and what its mount angle is off, lasts for seconds or for minutes: noise that
    is right beside fixes claims too much of a mean over minutes. Only what came before counts, so that a live run has
    the same.
    """
    wheels = np.isin(schedule.kind, (LATERAL, VERTICAL))
    if factor == 1.0 or not wheels.any():
        return schedule
    last = fixes[np.maximum(np.searchsorted(fixes, schedule.t, side="right") - 1, 0)]
    late = wheels & (schedule.t - last > UNAIDED_S)
    return replace(schedule, R=np.where(late, factor**2, 1.0)[:, None, None] * schedule.R)


def times_of_fixes(schedule: MeasurementSchedule, start: float) -> FloatArray:
    """Start of a run and times of its measurements of GNSS, ascending. Shape (m,). [s]"""
    return np.append(start, schedule.t[np.isin(schedule.kind, GNSS_KINDS)])


def smoothed_motion(imu: ImuSeries, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Turn rate about down [rad/s], specific force across and along, without their means [m/s^2], at given times.

    Medians of the forces over the log stand for biases and tilt, since a vehicle goes straight at one speed most of the
    time. The turn rate keeps its bias, small beside the limit it is compared with. Means are centred: a live filter has
    a delay of a quarter of a second.
    """
    rates = imu.rates()
    window = min(window_samples(rates, SMOOTHING_S), len(rates))
    columns = np.column_stack((rates.gyro[:, 2], rates.accel[:, 1], rates.accel[:, 0]))
    smooth = moving_moments(columns, window)[0]
    smooth[:, 1:] -= np.median(smooth[:, 1:], axis=0)
    k = np.clip(np.searchsorted(rates.t, t), 0, len(rates) - 1)
    return smooth[k, 0], smooth[k, 1], smooth[k, 2]


def odometer_measurements(
    odometer: OdometerSeries,
    *,
    lever_b: ArrayLike = (0.0, 0.0, 0.0),
    gate: float | None = 0.9999,
    max_rate_hz: float | None = 10.0,
) -> MeasurementSchedule:
    """Forward speed of a wheel: ``(1 + s)`` times the velocity of its axle along the vehicle.

    Parameters
    ----------
    odometer : OdometerSeries
    lever_b : array_like, shape (3,)
        From the IMU to the wheel's contact or the middle of its axle. [m]
    gate : float, optional
        Probability with which a correct measurement passes.
    max_rate_hz : float, optional
        Faster odometers are thinned out to no more than this rate, since their errors are not white; None takes all.
        [Hz]

    Raises
    ------
    InputError
        If a sigma or ``max_rate_hz`` is not positive.
    """
    if max_rate_hz is not None and not max_rate_hz > 0.0:
        raise InputError(f"max_rate_hz: expected a positive number, or None for every reading, got {max_rate_hz!r}")
    if np.any(odometer.sigma <= 0.0):
        raise InputError(
            f"odometer: expected positive 1-sigma values, got {odometer.sigma.min()}; give sigma_m_s of aiding.odometer"
        )
    keep = np.ones(len(odometer), dtype=bool)
    if max_rate_hz is not None and len(odometer) > 1:
        step = float(np.median(np.diff(odometer.t)))
        keep[:] = False
        keep[:: max(1, ceil(1.0 / (max_rate_hz * step) - 1e-3))] = True  # stamps jitter by a thousandth
    return MeasurementSchedule.of(
        SPEED, odometer.t[keep], odometer.speed[keep], odometer.sigma[keep] ** 2, as_vector3(lever_b, "lever_b"),
        gate_threshold(gate, 1),
    )  # fmt: skip
