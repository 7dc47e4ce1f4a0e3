"""Is this log what it was said to be? Magnitudes, gravity at rest, gaps and jitter.

A wrong unit is the commonest fault of a log and the dearest: everything computed from it looks like a result. Gravity
gives it away wherever the sensor rests for a second, whatever its attitude.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from schuler import units
from schuler.arrays import BoolArray, FloatArray
from schuler.exceptions import FileFormatError
from schuler.recording.io.hint_texts import COUNTS_NOTE
from schuler.recording.recording import TIMED, Recording
from schuler.recording.series import ImuSeries

MAX_RATE = 100.0  # beyond any gyro in use, about 5700 deg/s [rad/s]
MAX_FORCE = 200.0 * units.G0  # [m/s^2]
NORM_TOLERANCE = 0.05  # far above the 0.5 % by which gravity varies and the 3 % of an uncalibrated MEMS sensor [-]
NO_GRAVITY = 0.5  # a log whose median specific force is less is free fall or holds no gravity [m/s^2]
JITTER = 0.2  # of the sample interval [-]
_MANY = 20_000  # samples from which loading compiled code is worth its fraction of a second
_ROOM = 1 << 28  # what any packed log may unpack to [byte]
_PACKED = 100  # times its size that it may, beyond; logs of sensors pack to a third, at best to a twentieth
MAX_TIME = 1e11  # seconds since year 0 are 6.4e10; no clock counts more [s]
MAX_SPEED = 12e3  # above the escape velocity [m/s]
MAX_WHEEL_SPEED = 1e3  # three times the record on land [m/s]
RADII = (6.33e6, 1e8)  # of the Earth's centre: 11 km below the sea at a pole, twice a geostationary orbit [m]
HEIGHTS = (-12e3, 1e8)  # [m]
MAX_SIGMA = 1e7  # an Earth's radius; receivers state 2**32 mm for "unknown" [m], [m/s]
MAX_SIGMA_ANGLE = 1e3  # [rad]
TEMPERATURES = (-273.15, 2e3)  # [degC]


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


def largest(values: FloatArray) -> float:
    """Largest absolute value; no array of absolute values is made for it. 0 if there are none."""
    return float(max(values.max(), -values.min())) if values.size else 0.0


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
    Rest is a specific force steady to 2 % of its own norm on each axis, and rates as quiet as the quietest tenth of
    the log and small against its largest, unless the whole log is equally quiet. Only ratios within the log are used.
    """
    if len(t) < 10:
        return None
    interval = float(np.median(np.diff(t))) if interval is None else interval
    per_window = max(10, int(np.ceil(1.0 / interval)) + 1)
    m = len(t) // per_window
    if m == 0:
        return None
    ends = t[: m * per_window].reshape(m, per_window)
    level, drift, spread, noise, rate = _windows(accel, gyro, m, per_window)
    steady = (spread <= 0.02 * level) & (drift <= 0.01 * level) & (level > 0.0)
    quietest, loudest = np.quantile(noise, 0.1), np.quantile(noise, 0.9)
    quiet = (noise <= 3.0 * quietest) & ((rate <= 0.1 * largest(gyro)) | (loudest <= 3.0 * quietest))
    whole = ends[:, -1] - ends[:, 0] < 1.5 * per_window * interval  # no gap inside
    candidates = np.flatnonzero(steady & quiet & whole)
    return slice(int(candidates[0]) * per_window, int(candidates[0] + 1) * per_window) if len(candidates) else None


def _windows(accel: FloatArray, gyro: FloatArray, m: int, per_window: int) -> FloatArray:
    """Statistics of m windows: mean norm of the force and its change from the first to the second half, the largest
    deviation of an axis of the force and of the rate, norm of the mean rate. Shape (5, m).
    """
    if len(accel) >= _MANY:
        from schuler.recording import _kernels

        _kernels.prepare_windows()
        out = np.empty((5, m))
        _kernels.windows(np.ascontiguousarray(accel), np.ascontiguousarray(gyro), per_window, out)
        return out
    f = accel[: m * per_window].reshape(m, per_window, 3)
    w = gyro[: m * per_window].reshape(m, per_window, 3)
    norm = np.linalg.norm(f, axis=2)
    half = per_window // 2
    drift = np.abs(norm[:, :half].mean(axis=1) - norm[:, half:].mean(axis=1))
    spread, noise = (v.std(axis=1).max(axis=1) for v in (f, w))
    return np.stack((norm.mean(axis=1), drift, spread, noise, np.linalg.norm(w.mean(axis=1), axis=1)))


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


class _Quantity(NamedTuple):
    """Numbers of a series, one or several a row, and between what limits they are possible."""

    series: str
    name: str
    values: FloatArray
    limits: tuple[float, float]
    unit: str
    scaled: bool = False  # another unit is likelier than damage where most rows are beyond


def check_possible(recording: Recording, path: Path, allowed: Callable[[str], bool]) -> Recording:
    """The recording, if no vehicle, sensor and clock makes its numbers impossible: one gate for all formats.

    Parameters
    ----------
    recording : Recording
        As read.
    path : Path
        For messages.
    allowed : callable
        Whether a check is passed over by its name; then a note of the recording says what was.

    Raises
    ------
    FileFormatError
        At the first impossible number of a series, with its row and time. Where most rows of an IMU are beyond what is
        possible it is their unit and no damage: a note says so, and the checks of a log tell the unit.
    """
    from dataclasses import replace

    passed = allowed("magnitude") or "magnitude" in str(recording.metadata.options.get("allow", ""))
    notes = []
    for q in _quantities(recording):
        low, high = q.limits
        if not q.values.size or (q.values.min() >= low and q.values.max() <= high):
            continue
        wrong: BoolArray = ~((q.values >= low) & (q.values <= high))
        rows = np.flatnonzero(wrong.reshape(len(wrong), -1).any(axis=1))
        if q.scaled and 2 * len(rows) > len(wrong):
            # counts or another unit, of which the checks of a log say which, and with what option
            share = 100.0 * len(rows) / len(wrong)
            notes.append(f"{share:.0f} % of the rows have a {q.name} beyond {high:.4g} {q.unit}: another unit?")
            continue
        row = int(rows[0])
        value = float(np.atleast_1d(q.values[row])[np.atleast_1d(wrong[row])][0])
        limits = f"{low:.4g} to {high:.4g}" if low != -high else f"up to {high:.4g}"
        t = getattr(recording, q.series).t[row]
        message = (
            f"row {row + 1} of {q.series} ({t:.6g} s): {q.name} is {value:.6g} {q.unit}, expected {limits}: a damaged "
            "number or another unit; correct or delete the row"
        )
        if not passed:
            raise FileFormatError(f"{message}, or pass allow='magnitude' (--allow magnitude) if it is right", path)
        notes.append(f"Passed over: {message}.")
    return replace(recording, metadata=recording.metadata.noting(*notes)) if notes else recording


def _quantities(recording: Recording) -> Iterator[_Quantity]:
    for name in TIMED:
        series = getattr(recording, name)
        if series is not None and len(series.t):
            yield _Quantity(name, "the stamp", series.t[[0, -1]], (-MAX_TIME, MAX_TIME), "s")
    if (imu := recording.imu) is not None:
        if not any(COUNTS_NOTE in note for note in recording.metadata.notes):
            accel, gyro = _mean_rates(imu)
            yield _Quantity("imu", "specific force", accel, (-MAX_FORCE, MAX_FORCE), "m/s^2", scaled=True)
            yield _Quantity("imu", "angular rate", gyro, (-MAX_RATE, MAX_RATE), "rad/s", scaled=True)
        if imu.temperature is not None:
            yield _Quantity("imu", "the temperature", imu.temperature, TEMPERATURES, "degC")
    if (gnss := recording.gnss) is not None:
        yield _Quantity("gnss", "the height", gnss.llh[:, 2], HEIGHTS, "m")
        yield _Quantity("gnss", "1-sigma of position", _sigmas(gnss.cov_r_n), (0.0, MAX_SIGMA), "m")
        if gnss.v_n is not None and gnss.cov_v_n is not None:
            yield _Quantity("gnss", "velocity", gnss.v_n, (-MAX_SPEED, MAX_SPEED), "m/s")
            yield _Quantity("gnss", "1-sigma of velocity", _sigmas(gnss.cov_v_n), (0.0, MAX_SIGMA), "m/s")
        if gnss.received is not None:
            yield _Quantity("gnss", "time of reception", gnss.received, (-MAX_TIME, MAX_TIME), "s")
    if (odometer := recording.odometer) is not None:
        yield _Quantity("odometer", "speed", odometer.speed, (-MAX_WHEEL_SPEED, MAX_WHEEL_SPEED), "m/s")
        yield _Quantity("odometer", "1-sigma of speed", odometer.sigma, (0.0, MAX_SIGMA), "m/s")
    if (heading := recording.heading) is not None:
        yield _Quantity("heading", "1-sigma", heading.sigma, (0.0, MAX_SIGMA_ANGLE), "rad")
    if (height := recording.height) is not None:
        yield _Quantity("height", "the height", height.value, (-HEIGHTS[1], HEIGHTS[1]), "m")
        yield _Quantity("height", "1-sigma", height.sigma, (0.0, MAX_SIGMA), "m")
    if (reference := recording.reference) is not None:
        radius = np.linalg.norm(reference.r_eb_e, axis=1)
        yield _Quantity("reference", "distance from the Earth's centre", radius, RADII, "m")
        if reference.v_eb_e is not None:
            yield _Quantity("reference", "velocity", reference.v_eb_e, (-MAX_SPEED, MAX_SPEED), "m/s")


def _mean_rates(imu: ImuSeries) -> tuple[FloatArray, FloatArray]:
    """Specific force and angular rate; of increments over the usual interval, which a pause makes larger."""
    if imu.kind == "rate" or len(imu) < 2:
        return imu.accel, imu.gyro
    dt = np.maximum(np.diff(imu.t, prepend=imu.t[0] - imu.interval), imu.interval)[:, None]
    return imu.accel / dt, imu.gyro / dt


def _sigmas(cov: FloatArray) -> FloatArray:
    sigma: FloatArray = np.sqrt(np.einsum("nii->ni", cov))
    return sigma
