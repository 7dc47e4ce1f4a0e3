"""Steps of the sensor model: bias history, clipping, rounding, and the inverse of the linear response."""

from __future__ import annotations

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, IntArray, as_floats
from schuler.exceptions import InputError
from schuler.sensors.noise import NoiseModel, quantise, quantise_increments
from schuler.sensors.spec import TriadSpec


def draw_M(triad: TriadSpec, z: FloatArray) -> FloatArray:
    """M from normal numbers z, shape (6, 3): scale factors on the diagonal, misalignments off it. Shape (3, 3)"""
    cross = z[1:4] * triad.misalignment
    np.fill_diagonal(cross, triad.scale_factor * np.diag(z[1:4]))
    return cross


def as_pair(gyro: ArrayLike, accel: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Angular rate and specific force (or their increments) as arrays of one shape (n, 3)."""
    omega = as_floats(gyro, "gyro", (None, 3))
    return omega, as_floats(accel, "accel", omega.shape)


def as_interval(dt: float) -> float:
    """One positive sampling interval. [s]"""
    if np.ndim(dt) != 0:
        raise InputError(f"dt: expected one sampling interval in seconds, got shape {np.shape(dt)}; resample the log")
    if not (np.isfinite(dt) and dt > 0.0):
        raise InputError(f"dt: expected a positive number of seconds, got {dt!r}")
    return float(dt)


def biases(
    b: FloatArray,
    per_kelvin: FloatArray,
    noise: NoiseModel,
    warmth: FloatArray | None,
    n: int,
    dt: float,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Bias history and white noise, both shape (n, 3), each from its own child of ``rng``."""
    white_rng, in_run_rng = rng.spawn(2)
    history = noise.in_run.sample((n, 3), dt, in_run_rng) + at_temperature(b, per_kelvin, warmth)
    return history, noise.white.sample((n, 3), dt, white_rng)


def at_temperature(b: FloatArray, per_kelvin: FloatArray, warmth: FloatArray | None) -> FloatArray:
    """Constants at a temperature ``warmth`` above the reference [K]."""
    return b if warmth is None else b + warmth * per_kelvin


def inverse_response(M: FloatArray, per_kelvin: FloatArray, warmth: FloatArray | None, x: FloatArray) -> FloatArray:
    """``(I + M)^-1 x`` for every row of ``x``."""
    try:
        if warmth is None or not per_kelvin.any():
            return np.asarray(np.linalg.solve(np.eye(3) + M, x.T).T)
        scaled = np.eye(3) + M + np.eye(3) * (warmth * per_kelvin)[:, None, :]
        return np.asarray(np.linalg.solve(scaled, x[:, :, None])[:, :, 0])
    except np.linalg.LinAlgError as error:
        raise InputError(f"I + M has no inverse, so measurements cannot be compensated; M is {M.tolist()}") from error


def scaled(value: float | None, factor: float) -> float | None:
    """Limit in other units; None stays None."""
    return None if value is None else value * factor


def clipped(x: FloatArray, limit: float | None) -> tuple[FloatArray, IntArray]:
    """Signal within its range, and samples cut off per axis, shape (3,)."""
    if limit is None:
        return x, np.zeros(3, dtype=np.int64)
    return np.clip(x, -limit, limit), np.count_nonzero(np.abs(x) > limit, axis=0).astype(np.int64)


def rounded(x: FloatArray, resolution: float | None, quantum: float | None) -> FloatArray:
    """Samples rounded one by one, or sums rounded to pulses; as they are where both are None."""
    if resolution is not None:
        return quantise(x, resolution)
    return x if quantum is None else quantise_increments(x, quantum)
