"""Noise of an IMU log against the budget it is navigated with."""

from __future__ import annotations

import numpy as np

from schuler.arrays import FloatArray
from schuler.recording.series import ImuSeries
from schuler.sensors.spec import ImuSpec

#: Opening of the note, by which the verdict on a run knows it.
NOISIER = "the IMU log is far noisier than its budget even where it is quietest"

#: Opening of the note on noise so large that it is another motion.
NO_NOISE = "no noise of the IMU makes its motion that of the fixes"
_FACTOR = 20.0  # an idling engine makes ten times a good IMU's noise
_MEANS_S = (0.0, 0.1, 0.5)  # single samples, and means, in which quantisation and vibration are small
_WINDOW = 8  # second differences in a window
_SHARE = 0.1  # of the windows, the quietest, that are looked at
_MOST = 60.0  # factor on white noise that any budget may be wrong by: vibration makes at most 47 in the corpus ...
# ... and that the scatter of samples may be exceeded by, since vibration sampled too slowly is not white: at most 1.5
# in logs thinned to a third, where a wrong heading, clock or axis asks for 1.9 and more.
_SCATTER = 1.75


def noise_against_budget(imu: ImuSeries, spec: ImuSpec) -> list[str]:
    """A sentence if the noise of a log exceeds its budget twentyfold where the log is quietest, in means of any length.

    Parameters
    ----------
    imu : ImuSeries
    spec : ImuSpec
        A mean over T has ``N / sqrt(T)``, and a twelfth of the squared resolution as variance.

    Notes
    -----
    Noise is judged by second differences, which smooth motion does not reach: ``x[k-1] - 2 x[k] + x[k+1]`` of white
    noise has six times its variance. A sensor's own low-pass filter makes it smaller; only more noise is noted.
    """
    inc = None if imu.kind == "rate" else imu.increments()
    accel, gyro = (imu.accel, imu.gyro) if inc is None else (inc.dv_ib_b, inc.dtheta_ib_b)
    over = []
    for name, x, triad in (("specific force", accel, spec.accel), ("angular rate", gyro, spec.gyro)):
        ratios = []
        for mean_s in _MEANS_S:
            W = max(1, round(mean_s * imu.rate_hz))
            seen = _white_noise(x, None if inc is None else inc.dt, W)
            allowed = np.hypot(triad.random_walk * np.sqrt(imu.rate_hz / W), (triad.resolution or 0.0) / np.sqrt(12.0))
            ratios.append(seen / max(float(allowed), 1e-300))
        if min(ratios) > _FACTOR:
            over.append(f"{name} {min(ratios):.0f} times")
    return [f"{NOISIER}: {', '.join(over)}"] if over else []


def is_no_noise(imu: ImuSeries, psd: tuple[FloatArray, FloatArray], factors: tuple[float, float]) -> bool:
    """Whether white noise so much larger than stated is more than the log scatters from sample to sample.

    Vibration sampled without a filter before is noise of many times a data sheet's, and the log shows it; what a wrong
    heading, axis or clock asks for is not in the log.

    Parameters
    ----------
    imu : ImuSeries
    psd : tuple of ndarray, shape (3,)
        Two-sided densities stated for gyroscopes [rad^2/s] and accelerometers [m^2/s^3].
    factors : tuple of float
        On the 1-sigma of both.

    Notes
    -----
    Steps between samples of white noise of density ``q`` have the variance ``2 q / T``; turns and accelerations of the
    vehicle are in the steps too, and small there.
    """
    if max(factors) <= _MOST:
        return False
    rates = imu.rates()
    for x, q, factor in zip((rates.gyro, rates.accel), psd, factors, strict=True):
        steps = max(float(np.mean(np.diff(axis) ** 2)) for axis in x.T)
        if factor > _MOST and factor**2 * q.max() > _SCATTER**2 * 0.5 * steps * rates.interval:
            return True
    return False


def _white_noise(x: FloatArray, dt: FloatArray | None, W: int) -> float:
    """Standard deviation of means over W samples (of increments ``x / dt``), by second differences in the quietest
    windows, worst axis; zero if there are few.
    """
    n = max(len(x) // W - 2, 0) // _WINDOW * _WINDOW
    if n < 10 * _WINDOW:
        return 0.0
    worst = 0.0
    for axis in x.T:  # one after the other: of a day at 200 Hz each is 140 MB
        means = (axis if dt is None else axis / dt)[: len(x) // W * W].reshape(-1, W).mean(axis=1)
        d = np.diff(means, n=2)[:n] ** 2 / 6.0
        worst = max(worst, float(np.quantile(d.reshape(-1, _WINDOW).mean(axis=1), _SHARE)))
    return float(np.sqrt(worst))
