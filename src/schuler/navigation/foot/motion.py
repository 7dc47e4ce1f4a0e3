"""How hard a foot moves, and the noise that sensors have under such motion."""

from __future__ import annotations

import numpy as np

from schuler import units
from schuler.arrays import BoolArray, FloatArray
from schuler.navigation.foot.config import SensorSection
from schuler.recording.series import ImuSeries
from schuler.standstill.detectors import moving_moments

# White noise for each unit of RMS motion, chosen on half of 31 walks and runs (docs/foot-mounted.md) [sqrt(s)]
_ACCEL_SHARE = 0.009
_GYRO_SHARE = 2.5e-4
_LEAST_FORCE, _LEAST_RATE = 1.0, 0.7  # RMS of somebody who shuffles [m/s^2], [rad/s]
_CYCLE_S = 1.5
_SPIKE = 10.0  # of a single sample beyond both its neighbours; 40 walks and runs at 100 Hz have 5.7 at most [rad/s]


def in_motion(imu: ImuSeries) -> BoolArray:
    """Samples of a log in which the foot walks: its mean squared rate over a stride is not far below the usual."""
    rate = np.linalg.norm(imu.rates().gyro, axis=1)
    mean = moving_moments(rate**2, int(np.clip(round(_CYCLE_S / imu.interval), 1, len(imu))))[0]
    walking = mean >= 0.1 * np.quantile(mean, 0.9)  # one who stands for most of the log walks in the rest of it
    moving: BoolArray = mean >= 0.1 * np.median(mean[walking])
    return moving


def spike_doubts(imu: ImuSeries) -> list[str]:
    """Sentence on single angular rates far off both neighbours, which no foot makes; empty where there are none.

    Parameters
    ----------
    imu : ImuSeries

    Returns
    -------
    list of str
        Each turns the attitude by its size times the sampling interval.
    """
    gyro = imu.rates().gyro
    before, after = gyro[1:-1] - gyro[:-2], gyro[1:-1] - gyro[2:]
    off = np.minimum(np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1))
    spikes = np.flatnonzero((off > _SPIKE) & (np.linalg.norm(before - after, axis=1) < 0.3 * off))
    if not len(spikes):
        return []
    return [
        f"{len(spikes)} single angular rates are up to {off[spikes].max():.0f} rad/s off both of their neighbours, the "
        f"first at {imu.t[spikes[0] + 1]:.3f} s: spikes of the transmission, which turn the attitude by up to "
        f"{off[spikes].max() * imu.interval / units.DEG:.1f} deg; replace them by the mean of their neighbours"
    ]


def motion_level(imu: ImuSeries, gravity: float) -> tuple[float, float]:
    """RMS of specific force beyond gravity [m/s^2] and of angular rate [rad/s] while a foot moves.

    Parameters
    ----------
    imu : ImuSeries
    gravity : float
        Local gravity. [m/s^2]
    """
    rates = imu.rates()
    force = np.linalg.norm(rates.accel, axis=1) - gravity
    rate = np.linalg.norm(rates.gyro, axis=1)
    moving = in_motion(imu)
    return float(np.sqrt(np.mean(force[moving] ** 2))), float(np.sqrt(np.mean(rate[moving] ** 2)))


def noise_in_motion(imu: ImuSeries, section: SensorSection, gravity: float) -> tuple[FloatArray, FloatArray, str]:
    """White noise that stands for the errors of sensors on a foot.

    Parameters
    ----------
    imu : ImuSeries
    section : SensorSection
        Values that it states are taken as they are.
    gravity : float
        [m/s^2]

    Returns
    -------
    gyro_psd, accel_psd : ndarray, shape (3,)
        ``N**2``. [rad^2/s], [m^2/s^3]
    note : str
        What was taken, empty if the section states both.

    Notes
    -----
    Scale factors, misalignments, g-sensitivity, clipped heel strikes and sampling leave errors in proportion to the
    motion; on a shoe they are a hundred times the noise of the sensor. As white noise they grow with the RMS of force
    and rate, and a run has three times those of a walk.
    """
    force, rate = motion_level(imu, gravity)
    gyro, accel = section.gyro_noise_deg_s_rthz, section.accel_noise_m_s2_rthz
    N_g = _GYRO_SHARE * max(rate, _LEAST_RATE) if gyro is None else gyro * units.DEG
    N_a = _ACCEL_SHARE * max(force, _LEAST_FORCE) if accel is None else accel
    note = ""
    if gyro is None or accel is None:
        note = (
            f"noise from the motion ({force:.1f} m/s^2, {rate / units.DEG:.0f} deg/s RMS): {N_a:.3g} m/s^2/sqrt(Hz), "
            f"{N_g / units.DEG:.3g} deg/s/sqrt(Hz)"
        )
    return np.full(3, N_g**2), np.full(3, N_a**2), note
