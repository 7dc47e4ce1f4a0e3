"""Noise of readings at rest, and noise that is lost in rounding."""

from __future__ import annotations

import numpy as np

from schuler import units
from schuler.diagnosis.findings import Finding
from schuler.recording.series import ImuSeries
from schuler.standstill.unscaled import UnscaledRests

CHANNELS = ("ax", "ay", "az", "gx", "gy", "gz")
LARGE_STEP = (0.03, 0.1 * units.DEG)  # of a reading [m/s^2], [rad/s]
_LOUD = (0.8, 0.1)  # spread beyond any IMU on anything that rests for a second [m/s^2], [rad/s]


def _noise(imu: ImuSeries, factors: tuple[float, float]) -> list[Finding]:
    """Scatter from sample to sample in the quietest tenth of the log, whatever moves slowly. SI rates."""
    rates = imu.rates()
    per = max(20, round(1.0 / imu.interval))
    m = len(rates.t) // per
    if m < 5:
        return []
    y = np.concatenate((rates.accel * factors[0], rates.gyro * factors[1]), axis=1)[: m * per].reshape(m, per, 6)
    sd = np.sqrt(np.mean(np.diff(y, 2, axis=1) ** 2, axis=1) / 6.0)  # of white noise
    quiet = np.quantile(sd, 0.1, axis=0)
    f_sd, w_sd = float(quiet[:3].max()), float(quiet[3:].max())
    if f_sd <= _LOUD[0] and w_sd <= _LOUD[1]:
        return []
    text = (
        f"even in the quietest seconds a sample scatters by {f_sd:.3g} m/s^2 and {w_sd / units.DEG:.3g} deg/s: "
        f"noise was "
        "added, or the unit stands on something that shakes"
    )
    evidence = {"accel_sd_m_s2": quiet[:3].tolist(), "gyro_sd_rad_s": quiet[3:].tolist()}
    return [Finding("imu_noise", "warning", text, 0.7, "", evidence)]


def noise_at_rest(
    imu: ImuSeries, rests: UnscaledRests, grid: list[float | None], factors: tuple[float, float], dead: list[str]
) -> list[Finding]:
    """Findings ``imu_noise`` and ``quantised``: scatter and rounding of what rests.

    Parameters
    ----------
    imu : ImuSeries
    rests : UnscaledRests
    grid : list of float, optional
        Step of each channel's readings, None where there is none.
    factors : (float, float)
        Make the accelerometer's and the gyro's numbers SI rates.
    dead : list of str
        Channels that never change.
    """
    found = _noise(imu, factors)
    if not len(rests):
        return found
    scale = np.repeat(factors, 3)
    per_step = imu.interval if imu.kind == "increment" else 1.0
    grid = [None if g is None else g / per_step for g in grid]
    # the quietest rest: a running engine is no noise of the sensor
    k = int(np.argmin(rests.gyro_sd.max(axis=1)))
    sd = np.concatenate((rests.accel_sd[k], rests.gyro_sd[k]))
    coarse: list[str] = []
    steps: dict[str, float] = {}
    for i, c in enumerate(CHANNELS):
        step = grid[i]
        if c in dead or step is None:
            continue
        if sd[i] < 0.4 * step:
            size = step * scale[i]
            coarse.append(c)
            steps[c] = size
    if coarse:
        large = any(v > LARGE_STEP[int(name.startswith("g"))] for name, v in steps.items())
        text = (
            f"{', '.join(coarse)}: at rest the noise of a sample is less than half a step of the reading (largest step "
            f"{max(steps.values()):.3g} SI): rounding hides it, noise analysis and biases are limited by it"
        )
        evidence = {"axes": coarse, "steps_si": steps}
        found.append(
            Finding("quantised", "warning" if large else "note", text, 0.9, "more digits or bits in the log", evidence)
        )
    return found
