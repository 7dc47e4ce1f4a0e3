"""Is this log what it was said to be? Magnitudes, gravity at rest, gaps and jitter.

A wrong unit is the commonest fault of a log and the dearest: everything computed from it looks like a result. Gravity
gives it away wherever the sensor rests for a second, whatever its attitude.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from schuler import units
from schuler.arrays import BoolArray, FloatArray

MAX_RATE = 100.0  # beyond any gyro in use, about 5700 deg/s [rad/s]
MAX_FORCE = 200.0 * units.G0  # [m/s^2]
NORM_TOLERANCE = 0.05  # far above the 0.5 % by which gravity varies and the 3 % of an uncalibrated MEMS sensor [-]
NO_GRAVITY = 0.5  # a log whose median specific force is less is free fall or holds no gravity [m/s^2]
_ANOTHER_ATTITUDE = 30.0 * units.DEG  # between rests that tell a bias from a turntable [rad]
JITTER = 0.2  # of the sample interval [-]
_MANY = 20_000  # samples from which loading compiled code is worth its fraction of a second
_BLOCK = 1 << 15  # rows that are looked at together
_ROOM = 1 << 28  # what any packed log may unpack to [byte]
_PACKED = 100  # times its size that it may, beyond; logs of sensors pack to a third, at best to a twentieth


def check_unpacked(claimed: int, size: int) -> None:
    """Refuse a packed file that claims more memory than any log of its size: one budget for all of its parts.

    Parameters
    ----------
    claimed : int
        What its parts so far unpack to. [byte]
    size : int
        Of the file. [byte]

    Raises
    ------
    ValueError
        For the reader, which names the place.
    """
    if claimed > max(_ROOM, _PACKED * size):
        raise ValueError(f"its parts unpack to {claimed} bytes and more, in a file of {size}")


def too_large(values: FloatArray, limit: float) -> int | None:
    """First row with a component beyond a limit, ``None`` if there is none. Shape (n, 3)."""
    if not largest(values) > limit:
        return None
    return int(np.flatnonzero(np.any(np.abs(values) > limit, axis=1))[0])


def unit_quaternions(q: FloatArray, refused: Callable[[int, str], Exception], tolerance: float = 1e-2) -> FloatArray:
    """Quaternions of norm 1: those that were printed to some digits are divided by their norm, exact ones stay.

    Parameters
    ----------
    q : ndarray, shape (n, 4)
        As read.
    refused : callable
        Exception of a row and a sentence on it.
    tolerance : float
        Most that a norm may differ from 1.

    Returns
    -------
    ndarray, shape (n, 4)

    Raises
    ------
    Exception
        What ``refused`` makes of the first row of another norm.
    """
    given = q
    for start in range(0, len(q), _BLOCK):
        k = slice(start, start + _BLOCK)
        norm = np.linalg.norm(np.clip(given[k], -2.0, 2.0), axis=1)  # damaged numbers do not overflow
        bad = np.flatnonzero(~(np.abs(norm - 1.0) <= tolerance))
        if len(bad):
            raise refused(start + int(bad[0]), f"expected a unit quaternion, got norm {norm[bad[0]]:.4g}")
        rounded = np.flatnonzero(np.abs(norm - 1.0) > 1e-12)
        if len(rounded):
            q = q.copy() if q is given else q
            q[start + rounded] /= norm[rounded, None]
    return q


def largest(values: FloatArray) -> float:
    """Largest absolute value; no array of absolute values is made for it. 0 if there are none."""
    return float(max(values.max(), -values.min())) if values.size else 0.0


def norms(values: FloatArray) -> FloatArray:
    """Sizes of vectors, made a part at a time: squares and copies of all take twice what they do. Shape (n,)."""
    size = np.empty(len(values))
    for start in range(0, len(values), _BLOCK):
        size[start : start + _BLOCK] = np.linalg.norm(values[start : start + _BLOCK], axis=1)
    return size


def find_rest(t: FloatArray, accel: FloatArray, gyro: FloatArray, interval: float | None = None) -> slice | None:
    """First window of a second or more in which the sensor rests, judged without trusting any unit.

    Parameters
    ----------
    t : ndarray, shape (n,)
        [s]
    accel, gyro : ndarray, shape (n, 3)
        Specific force and angular rate in whatever unit.
    interval : float, optional
        Median spacing of the samples, if it is known. [s]

    Returns
    -------
    slice or None
        Rows of the window.

    Notes
    -----
    Rest is a specific force steady to 2 % of its own norm on each axis, and rates as :func:`quiet_rates` has them. Only
    ratios within the log are used.
    """
    if len(t) < 10:
        return None
    interval = float(np.median(np.diff(t))) if interval is None else interval
    per_window = max(10, int(np.ceil(1.0 / interval)) + 1)
    m = len(t) // per_window
    if m == 0:
        return None
    ends = t[: m * per_window].reshape(m, per_window)
    (level, drift, spread, noise), force, rate = np.split(_windows(accel, gyro, m, per_window), [4, 7])
    steady = (spread <= 0.02 * level) & (drift <= 0.01 * level) & (level > 0.0)
    quiet = quiet_rates(noise, rate.T, force.T, steady, largest(gyro))
    whole = ends[:, -1] - ends[:, 0] < 1.5 * per_window * interval  # no gap inside
    candidates = np.flatnonzero(steady & quiet & whole)
    return slice(int(candidates[0]) * per_window, int(candidates[0] + 1) * per_window) if len(candidates) else None


def quiet_rates(
    noise: FloatArray, rate: FloatArray, force: FloatArray, steady: BoolArray, largest_rate: float, factor: float = 3.0
) -> BoolArray:
    """Windows as quiet as the quietest tenth, whose mean rate is the bias there.

    Parameters
    ----------
    noise : ndarray, shape (m,)
        Largest standard deviation of the rate on an axis.
    rate, force : ndarray, shape (m, 3)
        Mean angular rate and mean specific force, in whatever unit.
    steady : ndarray of bool, shape (m,)
        Windows of constant specific force.
    largest_rate : float
        Of the log, on any axis.
    factor : float
        Largest noise, as a multiple of that of the quietest tenth.

    Returns
    -------
    ndarray of bool, shape (m,)

    Notes
    -----
    A rate that is not small beside those of the log may be that of a turntable; but specific force stays constant only
    if the axis of turning is vertical, so the same rate with gravity along other axes is a bias, such as the 20 deg/s
    of cheap gyroscopes.
    """
    quietest, loudest = np.quantile(noise, 0.1), np.quantile(noise, 0.9)
    quiet = np.asarray(noise <= factor * quietest)
    if loudest <= factor * quietest:
        return quiet
    size = np.linalg.norm(rate, axis=1)
    tolerance = 2.0 * np.maximum(quietest, 1e-300) + 0.005 * float(np.quantile(size, 0.98))

    def of_bias(windows: BoolArray) -> BoolArray:
        """Quiet windows whose mean rate is that of the quietest of some."""
        bias = np.median(rate[windows & (noise <= np.quantile(noise[windows], 0.1))], axis=0)
        return np.asarray(quiet & (np.linalg.norm(rate - bias, axis=1) <= tolerance))

    resting = of_bias(np.ones(len(noise), dtype=bool))
    up = force[resting & steady]
    up = up / np.linalg.norm(up, axis=1, keepdims=True)
    if len(up) and float((up @ up[0]).min()) <= np.cos(_ANOTHER_ATTITUDE):
        return resting
    small = quiet & (size <= 0.1 * largest_rate)
    if not (resting & small & steady).any() and small.any():
        resting = of_bias(small)  # the quietest turn on a table
    return np.asarray(resting & small)


def _windows(accel: FloatArray, gyro: FloatArray, m: int, per_window: int) -> FloatArray:
    """Statistics of m windows: mean norm of the force and its change from the first to the second half, the largest
    deviation of an axis of the force and of the rate, mean force, mean rate. Shape (10, m).
    """
    if len(accel) >= _MANY:
        from schuler.recording import _kernels

        _kernels.prepare_windows()
        out = np.empty((10, m))
        _kernels.windows(np.ascontiguousarray(accel), np.ascontiguousarray(gyro), per_window, out)
        return out
    f = accel[: m * per_window].reshape(m, per_window, 3)
    w = gyro[: m * per_window].reshape(m, per_window, 3)
    norm = np.linalg.norm(f, axis=2)
    half = per_window // 2
    drift = np.abs(norm[:, :half].mean(axis=1) - norm[:, half:].mean(axis=1))
    spread, noise = (v.std(axis=1).max(axis=1) for v in (f, w))
    return np.vstack((norm.mean(axis=1), drift, spread, noise, f.mean(axis=1).T, w.mean(axis=1).T))


def gravity_fault(
    t: FloatArray, accel: FloatArray, gyro: FloatArray, unit: str, interval: float, kind: str, rest: float | None
) -> tuple[str | None, str | None, int | None]:
    """Fault in the specific force at rest, a sentence on what was found, and the row where the rest begins.

    Parameters
    ----------
    t : ndarray, shape (n,)
        [s]
    accel, gyro : ndarray, shape (n, 3)
        Mean specific force [m/s^2] and angular rate [rad/s] as the stated units make them.
    unit : str
        Unit stated for the accelerometer, for the message.
    interval : float
        Sample interval. [s]
    kind : {"rate", "increment"}
        Stated kind of samples.
    rest : float or None
        Stillness stated for the start; looked for if ``None``. [s]
    """
    if rest is not None:
        window: slice | None = slice(0, max(int(np.searchsorted(t, t[0] + rest, side="right")), 1))
    else:
        window = find_rest(t, accel, gyro, interval)
    if window is None:
        level = float(np.median(np.linalg.norm(accel, axis=1)))
        if level >= NO_GRAVITY:
            return (
                None,
                "No second of rest was found, so the unit of specific force was not checked against gravity.",
                None,
            )
        causes = norm_causes(level, unit, interval, kind) or "gravity was taken out of the log, or the unit is wrong"
        return f"expected gravity in the log, got a median specific force of {level:.4g} m/s^2: {causes}", None, None
    mean = accel[window].mean(axis=0)
    level = float(np.linalg.norm(accel[window], axis=1).mean())
    span = f"{t[window.start]:.3f}..{t[window.stop - 1]:.3f} s"
    if abs(level / 9.81 - 1.0) > NORM_TOLERANCE:
        causes = norm_causes(level, unit, interval, kind) or "an unknown scale, or a sensor that needs calibration"
        return (
            (
                f"expected the specific force at rest ({span}) to be gravity, 9.81 m/s^2 within 5 %, "
                f"got {level:.4g} m/s^2: {causes}"
            ),
            None,
            window.start,
        )
    note = f"At rest ({span}) the mean specific force is {level:.3f} m/s^2."
    if mean[2] > 0.7 * level:
        note += (
            " It points along the down axis, where a level sensor shows its opposite: the sensor is mounted upside "
            "down, its axes were not stated (axes='FLU' or the like), or the log holds gravity, not specific force."
        )
    return None, note, window.start


def norm_causes(level: float, unit: str, interval: float, kind: str) -> str:
    """Causes that would turn the norm seen at rest into gravity; empty if nothing simple would.

    Parameters
    ----------
    level : float
        Norm with the stated unit. [m/s^2]
    unit : str
        The stated unit.
    interval : float
        Sample interval. [s]
    kind : {"rate", "increment"}
    """
    if level <= 0.0:
        return ""
    bare = unit.split("*")[0].strip()
    stated = {"g": units.G0, "mg": units.MG, "ug": units.UG, "m/s^2": 1.0, "ft/s^2": units.FT, "cm/s^2": 0.01}
    causes = []
    if bare in stated:
        for other, value in stated.items():
            if other != bare and _is_gravity(level / stated[bare] * value):
                causes.append(f"the numbers look like {other}, not {bare}")
    if kind == "rate" and _is_gravity(level / interval):
        causes.append("the numbers look like increments (kind='increment', for example units='m/s,rad')")
    if kind == "increment" and _is_gravity(level * interval):
        causes.append("the numbers look like rates, not increments (kind='rate')")
    return " or ".join(causes)


def _is_gravity(level: float) -> bool:
    return abs(level / 9.81 - 1.0) < 0.08


def timing_notes(t: FloatArray, step: FloatArray | None = None, interval: float | None = None) -> list[str]:
    """Sentences on gaps (steps above 1.5 intervals) and on jitter above a fifth of the interval.

    Parameters
    ----------
    t : ndarray, shape (n,)
        [s]
    step : ndarray, shape (n - 1,), optional
        Its differences, if they are known, and
    interval : float, optional
        their median. [s]
    """
    if len(t) < 3:
        return []
    step = np.diff(t) if step is None else step
    interval = float(np.median(step)) if interval is None else interval
    gap = step > 1.5 * interval
    notes = []
    if gap.any():
        longest = int(np.argmax(step))
        notes.append(
            f"The log has {int(gap.sum())} gap{'s' if gap.sum() > 1 else ''} of more than 1.5 sample intervals; the "
            f"longest is {step[longest]:.4g} s at {t[longest]:.3f} s. Nothing was filled in."
        )
    # the quantile is taken only where some step is as far off as would be told
    off = np.abs(step - interval) if not gap.any() else np.abs(step[~gap] - interval)
    spread = float(np.quantile(off, 0.95)) if len(off) and off.max() > JITTER * interval else 0.0
    if spread > JITTER * interval:
        notes.append(
            f"The time stamps jitter: one step in twenty differs from the interval of {interval * 1e3:.4g} ms by more "
            f"than {spread * 1e3:.3g} ms."
        )
    return notes
