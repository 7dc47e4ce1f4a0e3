"""How wrong readings are whose sensor's parameters are uncertain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from schuler.arrays import FloatArray
from schuler.recording.series import ImuSeries


def reading_sigma(
    names: Sequence[str], covariance: FloatArray, imu: ImuSeries, at_rest: FloatArray | None = None
) -> tuple[float, float]:
    """1-sigma of readings whose parameters are uncertain, RMS over axes and over a log.

    Parameters
    ----------
    names : sequence of str
        See :mod:`schuler.calibration.result.parameters`.
    covariance : ndarray, shape (p, p)
        SI.
    imu : ImuSeries
        How large specific forces and rates are; means over a second, to leave vibration out.
    at_rest : ndarray, shape (3,), optional
        Specific force at which g-sensitivity has no effect since its offset was taken off. [m/s^2]

    Returns
    -------
    accel, gyro : float
        [m/s^2], [rad/s]

    Notes
    -----
    The error of a reading is linear in the parameters, ``J p``; its mean square over the log is ``sum_kl P_kl
    mean(J_k J_l)``.
    """
    f, w = _means(imu)
    sources = {"M_a": f, "M_g": w, "G_g": f if at_rest is None else f - at_rest}
    sums = {"a": 0.0, "g": 0.0}
    for triad in sums:
        for axis in "xyz":
            own = [k for k, n in enumerate(names) if n[2] == triad and n[4] == axis]
            J = np.ones((len(f), len(own)))
            for i, k in enumerate(own):
                if names[k][0] != "b":
                    J[:, i] = sources[names[k][:3]][:, "xyz".index(names[k][5])]
            sums[triad] += float(np.sum(covariance[np.ix_(own, own)] * (J.T @ J))) / len(f)
    return float(np.sqrt(sums["a"] / 3.0)), float(np.sqrt(sums["g"] / 3.0))


def _means(imu: ImuSeries) -> tuple[FloatArray, FloatArray]:
    """Means over whole seconds. Shapes (n, 3). [m/s^2], [rad/s]"""
    rates = imu.rates()
    m = round(rates.rate_hz)
    n = len(rates) // m * m
    f, w = (x[:n].reshape(-1, m, 3).mean(axis=1) for x in (rates.accel, rates.gyro))
    return f, w
