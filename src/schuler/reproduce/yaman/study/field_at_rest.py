"""What a rest before the first motion tells of a vehicle's IMU: a field calibration in one pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler.calibration.field.calibration import FieldCalibration, calibrate_field
from schuler.calibration.field.options import FieldOptions
from schuler.exceptions import InputError
from schuler.mechanization.alignment import heading_from_course
from schuler.navigation.config import NavigationConfig
from schuler.navigation.states import imu_spec
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries
from schuler.sensors.spec import ImuSpec
from schuler.standstill.rests import given_rests
from schuler.units import DEG

_MOVING, _BEFORE_S = 0.3, 2.0  # a speed that is no rest [m/s]; how long before it the rest is taken to end [s]
_SHORTEST_S = 10.0
_COURSE_SIGMA = 10.0 * DEG  # a car that drives off turns its wheels


def calibrate_at_rest(recording: Recording, config: NavigationConfig) -> FieldCalibration:
    """Calibrate a vehicle's IMU from the rest before its first motion.

    Parameters
    ----------
    recording : Recording
        IMU in the vehicle's axes.
    config : NavigationConfig
        Its IMU's error budget; noise is that of the log at rest (an engine that idles), and ``alignment.min_speed_m_s``
        says from which speed on the course is the heading.

    Returns
    -------
    FieldCalibration
        Refused, as every calibration in one pose; its values and covariance hold all the same.

    Raises
    ------
    InputError
        If there are less than ten seconds at rest.
    """
    imu, gnss = recording.need_imu(), recording.need_gnss()
    if gnss.v_n is None or gnss.cov_v_n is None:
        raise InputError("the start at rest is found by the speed of GNSS; this series has no velocities")
    t = gnss.t - config.imu.clock_shift_s  # on the clock of the IMU
    speed = np.linalg.norm(gnss.v_n, axis=1)
    moving = (speed > _MOVING) & (t > imu.t[0])
    driving = (speed > config.alignment.min_speed_m_s) & (t > imu.t[0])
    end = float(t[np.argmax(moving)]) - _BEFORE_S if moving.any() else float(imu.t[-1])
    if end - imu.t[0] < _SHORTEST_S or not driving.any():
        raise InputError(
            f"expected at least {_SHORTEST_S:g} s at rest and then a drive, got {max(end - imu.t[0], 0.0):.1f} s until "
            "GNSS moves; give a recording that begins earlier, or calibrate elsewhere"
        )
    k = int(np.argmax(driving))
    sigma_v = float(np.sqrt(max(gnss.cov_v_n[k, 0, 0], gnss.cov_v_n[k, 1, 1])))
    heading, sigma = heading_from_course(gnss.v_n[k], sigma_v, sigma_sideslip=_COURSE_SIGMA)
    start = imu.between(float(imu.t[0]), end)
    # all of it, untested: a car in which people move tilts by a tenth of a degree, and the gyroscopes carry that on
    return calibrate_field(
        start, _standing(imu_spec(config), start), latitude=float(gnss.llh[0, 0]), height=float(gnss.llh[0, 2]),
        heading=(heading, sigma), rests=given_rests(start, [(float(start.t[0]), end)]),
        options=FieldOptions(earth_rate="vertical"),
    )  # fmt: skip


def _standing(spec: ImuSpec, imu: ImuSeries) -> ImuSpec:
    """The budget with the noise of a log at rest: RMS over axes of the scatter of means over a second.

    What shakes on the road is not there at rest; what an idling engine folds into the signal is not on the sheet.
    """
    rates = imu.rates()
    m = round(rates.rate_hz)
    n = len(rates) // m * m
    scatter = [
        float(np.sqrt(np.mean(np.diff(x[:n].reshape(-1, m, 3).mean(axis=1), axis=0) ** 2) / 2.0))
        for x in (rates.accel, rates.gyro)
    ]
    return replace(
        spec, accel=replace(spec.accel, random_walk=scatter[0]), gyro=replace(spec.gyro, random_walk=scatter[1])
    )
