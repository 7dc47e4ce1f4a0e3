"""Smallest white noise of an IMU that tuning may choose: what it shows at rest."""

from __future__ import annotations

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.filtering.measurements import POSITION, VELOCITY, MeasurementSchedule
from schuler.navigation.prepared import PreparedRun
from schuler.navigation.tuning.noise import WHITE

_STILL = 0.5  # GNSS speed of what may stand [m/s]


def noise_floors(prepared: PreparedRun) -> dict[str, float]:
    """Smallest factors on the IMU's white noise: what it shows at rest, by its Allan deviation over a second."""
    from schuler.standstill.stationarity import static_intervals

    imu = prepared.imu
    rests = static_intervals(imu, min_s=10.0)
    length = np.where(_unmoved(prepared.schedule, rests.start, rests.stop), rests.duration, 0.0)
    if not length.any():
        return {}
    k = int(np.argmax(length))
    still = imu.between(float(rests.start[k]), float(rests.stop[k])).rates()
    floors = {}
    for name, triad in WHITE.items():
        noise, psd = _white_noise((still.gyro, still.accel)[triad], still.interval), prepared.psd[triad].max()
        if noise > 0.0 and psd > 0.0:
            floors[name] = noise / float(np.sqrt(psd))
    return floors


def _unmoved(schedule: MeasurementSchedule, start: FloatArray, stop: FloatArray) -> BoolArray:
    """Which stretches have fixes within, and none that moves: a smooth ride is as quiet as rest."""
    still = np.zeros(len(start), dtype=bool)
    for i, (a, b) in enumerate(zip(start, stop, strict=True)):
        within = (schedule.t >= a) & (schedule.t <= b)
        r, v = (
            schedule.z[within & (schedule.kind == POSITION), :3],
            schedule.z[within & (schedule.kind == VELOCITY), :3],
        )
        sigma = np.sqrt(np.einsum("nii->n", schedule.R[within & (schedule.kind == POSITION)]))
        if len(r) > 1 and np.all(np.linalg.norm(v[:, :2], axis=1) < _STILL):
            still[i] = bool(np.linalg.norm(r[-1] - r[0]) < 0.1 * (b - a) + 4.0 * np.median(sigma))
    return still


def _white_noise(values: FloatArray, interval: float) -> float:
    """White-noise root density of the quietest axis, from the Allan deviation of means over a second."""
    m = max(1, round(1.0 / interval))
    means = values[: len(values) // m * m].reshape(-1, m, values.shape[1]).mean(axis=1)
    if len(means) < 5:
        return 0.0
    deviation = np.sqrt(0.5 * np.mean(np.diff(means, axis=0) ** 2, axis=0))
    return float(deviation.min() * np.sqrt(m * interval))
