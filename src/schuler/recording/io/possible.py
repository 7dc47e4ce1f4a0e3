"""Numbers that no vehicle, sensor, satellite and clock has: one gate for all formats and series of a recording."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.io.checks import MAX_FORCE, MAX_RATE, largest, norms
from schuler.recording.io.hint_texts import COUNTS_NOTE
from schuler.recording.recording import TIMED, Recording
from schuler.recording.series import GnssSeries, ImuSeries
from schuler.units import G0

MAX_TIME = 1e11  # seconds since year 0 are 6.4e10; no clock counts more [s]
MAX_FIELD = 0.1  # beyond what a compass survives, two thousand times the Earth's [T]
MAX_COUNT = 1e20  # more than 64 bits count, in any unit
MAX_SPEED = 12e3  # above the escape velocity [m/s]
MAX_WHEEL_SPEED = 1e3  # three times the record on land [m/s]
RADII = (6.33e6, 1e8)  # of the Earth's centre: 11 km below the sea at a pole, twice a geostationary orbit [m]
HEIGHTS = (-12e3, 1e8)  # [m]
MAX_SIGMA = 1e7  # an Earth's radius; receivers state 2**32 mm for "unknown" [m], [m/s]
_TURN = 2.0 * np.pi + 1e-9  # longitudes to either side [rad]
MAX_SIGMA_ANGLE = 1e3  # [rad]
MAX_RANGE = 1e9  # three seconds of light: no receiver's clock is off by more [m]
MAX_RANGE_RATE = 1e6  # a clock off by 0.3 % [m/s]
MAX_CARRIER = 1e12  # five times what RINEX has digits for, and ambiguities start anywhere [cycles]
MAX_CN0 = 1e3  # also of receivers that state a ratio of amplitudes [dB-Hz]
TEMPERATURES = (-273.15, 2e3)  # [degC]
#: From where a reading that stands alone is no motion: rates beyond any usual gyroscope, forces beyond all but crashes
_LONE = (40.0, 50.0 * G0)  # [rad/s], [m/s^2]
_LONE_RATIO = 50.0  # times the readings beside it
_LONE_CHANGE = (
    0.05,
    1.0,
)  # of angle and velocity over the sample: shorter shocks may fall between samples [rad], [m/s]
_LONE_AGREE = (0.5, 2.0)  # the means before and after it: nothing has happened [rad/s], [m/s^2]
_BESIDE = 3  # readings on either side
_LONE_SHARE = 0.01  # of a lone reading, that a blow has along other axes and in the other sensor at the least


class _Quantity(NamedTuple):
    """Numbers of a series, one or several a row, and between what limits they are possible."""

    series: str
    name: str
    values: FloatArray
    limits: tuple[float, float]
    unit: str
    scaled: bool = False  # another unit is likelier than damage where most rows are beyond
    holes: bool = False  # NaN means: not measured


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
    passed = allowed("magnitude") or "magnitude" in str(recording.metadata.options.get("allow", ""))
    recording, notes = _without_impossible_messages(recording, path)

    def refuse(series: str, row: int, text: str) -> None:
        t = getattr(recording, series).t[row]
        message = f"row {row + 1} of {series} ({t:.6g} s): {text}; correct or delete the row"
        if not passed:
            raise FileFormatError(f"{message}, or pass allow='magnitude' if it is right", path)
        notes.append(f"Passed over: {message}.")

    for q in _quantities(recording):
        low, high = q.limits
        if not q.values.size or (q.values.min() >= low and q.values.max() <= high):
            continue
        wrong: BoolArray = ~((q.values >= low) & (q.values <= high))
        if q.holes:
            wrong &= ~np.isnan(q.values)
            if not wrong.any():
                continue
        rows = np.flatnonzero(wrong.reshape(len(wrong), -1).any(axis=1))
        if q.scaled and 2 * len(rows) > len(wrong) and largest(q.values) < MAX_COUNT:
            # counts or another unit, of which the checks of a log say which, and with what option
            share = 100.0 * len(rows) / len(wrong)
            notes.append(f"{share:.0f} % of the rows have a {q.name} beyond {high:.4g} {q.unit}: another unit?")
            continue
        row = int(rows[0])
        value = float(np.atleast_1d(q.values[row])[np.atleast_1d(wrong[row])][0])
        limits = f"{low:.4g} to {high:.4g}" if low != -high else f"up to {high:.4g}"
        refuse(q.series, row, f"{q.name} is {value:.6g} {q.unit}, expected {limits}: a damaged number or another unit")
    for row, text in _lone_readings(recording):
        refuse("imu", row, text)
    return replace(recording, metadata=recording.metadata.noting(*notes)) if notes else recording


def _without_impossible_messages(recording: Recording, path: Path) -> tuple[Recording, list[str]]:
    """The recording without broadcast messages that are no satellite's, and a sentence on them.

    Messages are sent again and again, and a receiver's log may hold empty ones: they are left out, not refused.
    """
    if recording.ephemerides is None:
        return recording, []
    from schuler.gnss.signals import satellite_name

    kept, left_out = recording.ephemerides.possible()
    satellites = [satellite_name(int(sat)) for sat in np.unique(np.concatenate(left_out))]
    if not satellites:
        return recording, []
    n = sum(len(sat) for sat in left_out)
    names = ", ".join(satellites[:8]) + (" and others" if len(satellites) > 8 else "")
    if not len(kept.kepler) and not len(kept.glonass) and all(getattr(recording, name) is None for name in TIMED):
        raise FileFormatError(
            f"none of its {n} broadcast messages ({names}) has numbers that a satellite's orbit and clock can have: "
            "it is damaged or of another format",
            path,
        )
    note = f"{n} broadcast messages ({names}) hold numbers that no satellite has and were left out."
    return replace(recording, ephemerides=kept), [note]


def _lone_readings(recording: Recording) -> Iterator[tuple[int, str]]:
    """First row of the IMU, of rates and of forces, in which a reading stands alone as no motion makes one.

    A crash of 100 g is not over within one sample: it rings, and the vehicle's rate and force are others after it. A
    reading is taken to be damaged if it alone is far beyond all others of the log, the three before and the three after
    it (as many as the log has there) are below a fiftieth of it and agree with each other, and the jump of velocity or
    angle that it claims is more than any shock that is shorter than a sample gives a body.

    Two or three such readings within three rows may be a blow. A blow is felt along all axes (none is along one of the
    sensor's to a hundredth) and by both sensors: where everything but one number of each of these rows goes on as
    beside them, the numbers are damaged.
    """
    imu = recording.imu
    if imu is None or len(imu) <= 2 * _BESIDE or any(COUNTS_NOTE in note for note in recording.metadata.notes):
        return
    both = [_mean_rates(imu, y) for y in (imu.gyro, imu.accel)]
    for i, (what, unit) in enumerate((("angular rate", "rad/s"), ("specific force", "m/s^2"))):
        values = both[i]
        if not largest(values) > 0.5 * _LONE[i]:
            continue
        size = np.abs(values).max(axis=1)
        high = np.flatnonzero(size > 0.5 * _LONE[i])
        if 2 * len(high) > len(size):
            continue
        first = high[np.diff(high, prepend=-_BESIDE) >= _BESIDE]
        last = high[np.diff(high, append=len(size) + _BESIDE) >= _BESIDE]
        if (last - first >= _BESIDE).any():
            continue
        # at an end of the log, those of the other side: what is missing there speaks for nothing
        ago = np.arange(_BESIDE, 0, -1)
        before, after = first[:, None] - ago, last[:, None] + ago[::-1]
        before, after = (
            np.where(before < 0, last[:, None] + ago, before),
            np.where(after >= len(size), first[:, None] - ago[::-1], after),
        )
        rows = np.clip(np.hstack((before, after)), 0, len(size) - 1)
        beside = values[rows]
        usual = np.abs(beside).max(axis=(1, 2))
        runs = [high[(high >= a) & (high <= b)] for a, b in zip(first, last, strict=True)]
        most = np.array([size[run].max() for run in runs])
        change = np.abs(beside[:, _BESIDE:].mean(axis=1) - beside[:, :_BESIDE].mean(axis=1)).max(axis=1)
        damaged = (
            (most > _LONE[i]) & (_LONE_RATIO * usual < most) & (most * imu.interval > _LONE_CHANGE[i])
            & (change < _LONE_AGREE[i])
        )  # fmt: skip
        if damaged.all() and all(
            _one_number_each(both, i, np.arange(a, b + 1), run, rows[k])
            for k, (a, b, run) in enumerate(zip(first, last, runs, strict=True))
            if len(run) > 1
        ):
            row = int(high[0])
            value = values[row, np.argmax(np.abs(values[row]))]
            more = len(runs[0]) - 1
            shock = f"a shock is felt along all axes, this and {more} more beside it are not" if more else ""
            yield (
                row,
                (
                    f"{what} is {value:.6g} {unit}, those of the three samples before and after are up to "
                    f"{usual[0]:.3g}: a damaged number (a decimal point that was lost?), "
                    + (shock or "no shock is over within a sample")
                ),
            )


def _one_number_each(both: list[FloatArray], i: int, rows: IntArray, high: IntArray, beside: IntArray) -> bool:
    """Whether one number of a sensor (0 gyroscope, 1 accelerometer) in each of the high ones of some rows, and no other
    number of either sensor in any of them, differs from those beside.
    """
    values, around = (np.hstack([y[k] for y in both]) for k in (rows, beside))
    usual = np.ptp(around, axis=0) + np.repeat(_LONE_SHARE * np.array(_LONE), 3)
    differs = np.abs(values - np.median(around, axis=0)) > usual
    of_sensor = differs[:, 3 * i : 3 * i + 3].sum(axis=1)
    return bool(np.array_equal(of_sensor, np.isin(rows, high)) and differs.sum() == of_sensor.sum())


def _quantities(recording: Recording) -> Iterator[_Quantity]:
    for name in TIMED:
        series = getattr(recording, name)
        if series is not None and len(series.t):
            yield _Quantity(name, "the stamp", series.t[[0, -1]], (-MAX_TIME, MAX_TIME), "s")
    if (imu := recording.imu) is not None:
        if not any(COUNTS_NOTE in note for note in recording.metadata.notes):
            for y, name, most, unit in (
                (imu.accel, "specific force", MAX_FORCE, "m/s^2"), (imu.gyro, "angular rate", MAX_RATE, "rad/s"),
            ):  # fmt: skip
                yield _Quantity("imu", name, _mean_rates(imu, y), (-most, most), unit, scaled=True)
        if imu.magnetometer is not None and not any(COUNTS_NOTE in note for note in recording.metadata.notes):
            yield _Quantity("imu", "the magnetometer", imu.magnetometer, (-MAX_FIELD, MAX_FIELD), "T", scaled=True)
        if imu.temperature is not None:
            yield _Quantity("imu", "the temperature", imu.temperature, TEMPERATURES, "degC")
    if (gnss := recording.gnss) is not None:
        yield from _quantities_of_fixes(gnss)
    if (odometer := recording.odometer) is not None:
        yield _Quantity("odometer", "speed", odometer.speed, (-MAX_WHEEL_SPEED, MAX_WHEEL_SPEED), "m/s")
        yield _Quantity("odometer", "1-sigma of speed", odometer.sigma, (0.0, MAX_SIGMA), "m/s")
    if (heading := recording.heading) is not None:
        yield _Quantity("heading", "1-sigma", heading.sigma, (0.0, MAX_SIGMA_ANGLE), "rad")
    if (height := recording.height) is not None:
        yield _Quantity("height", "the height", height.value, (-HEIGHTS[1], HEIGHTS[1]), "m")
        yield _Quantity("height", "1-sigma", height.sigma, (0.0, MAX_SIGMA), "m")
    if (seen := recording.observations) is not None:
        for name, values, most, unit in (
            ("pseudorange", seen.pseudorange, MAX_RANGE, "m"),
            ("range rate", seen.range_rate, MAX_RANGE_RATE, "m/s"),
            ("carrier phase", seen.carrier, MAX_CARRIER, "cycles"),
            ("carrier to noise density", seen.cn0, MAX_CN0, "dB-Hz"),
        ):
            yield _Quantity("observations", name, values, (-most, most), unit, holes=True)
    if (ranges := recording.ranges) is not None:
        for name, values, most, unit in (
            ("pseudorange", ranges.pseudorange, MAX_RANGE, "m"),
            ("range rate", ranges.range_rate, MAX_RANGE_RATE, "m/s"),
            ("a satellite's coordinate", ranges.r_sat_e, RADII[1], "m"),
            ("a satellite's velocity", ranges.v_sat_e, MAX_SPEED, "m/s"),
            ("1-sigma of range", ranges.sigma_range, MAX_SIGMA, "m"),
            ("1-sigma of range rate", ranges.sigma_rate, MAX_SIGMA, "m/s"),
            ("carrier to noise density", ranges.cn0, MAX_CN0, "dB-Hz"),
            ("the elevation", ranges.elevation, MAX_SIGMA_ANGLE, "rad"),
            ("the azimuth", ranges.azimuth, MAX_SIGMA_ANGLE, "rad"),
        ):
            yield _Quantity("ranges", name, values, (-most, most), unit, holes=True)
    if (reference := recording.reference) is not None:
        with np.errstate(over="ignore"):  # infinite is beyond all limits
            radius = norms(reference.r_eb_e)
        yield _Quantity("reference", "distance from the Earth's centre", radius, RADII, "m")
        if reference.v_eb_e is not None:
            yield _Quantity("reference", "velocity", reference.v_eb_e, (-MAX_SPEED, MAX_SPEED), "m/s")


def _quantities_of_fixes(gnss: GnssSeries) -> Iterator[_Quantity]:
    yield _Quantity("gnss", "the height", gnss.llh[:, 2], HEIGHTS, "m")
    yield _Quantity("gnss", "the longitude", gnss.llh[:, 1], (-_TURN, _TURN), "rad")
    yield _Quantity("gnss", "1-sigma of position", _sigmas(gnss.cov_r_n), (0.0, MAX_SIGMA), "m")
    if gnss.v_n is not None and gnss.cov_v_n is not None:
        yield _Quantity("gnss", "velocity", gnss.v_n, (-MAX_SPEED, MAX_SPEED), "m/s")
        yield _Quantity("gnss", "1-sigma of velocity", _sigmas(gnss.cov_v_n), (0.0, MAX_SIGMA), "m/s")
    if gnss.received is not None:
        yield _Quantity("gnss", "time of reception", gnss.received, (-MAX_TIME, MAX_TIME), "s")


def check_fixes(gnss: GnssSeries) -> None:
    """Raise InputError at the first number of fixes, as they come live, that no vehicle and no receiver has."""
    for q in _quantities_of_fixes(gnss):
        low, high = q.limits
        wrong = q.values[~((q.values >= low) & (q.values <= high))]
        if wrong.size:
            raise InputError(f"{q.name} is {wrong.flat[0]:.6g} {q.unit}, expected {low:.4g} to {high:.4g}")


def _mean_rates(imu: ImuSeries, y: FloatArray) -> FloatArray:
    """Specific force or angular rate; of increments over the usual interval, which a pause makes larger."""
    if imu.kind == "rate" or len(imu) < 2:
        return y
    dt = np.diff(imu.t, prepend=imu.t[0] - imu.interval)
    with np.errstate(over="ignore"):  # infinite is beyond all limits
        return y / np.maximum(dt, imu.interval, out=dt)[:, None]


def _sigmas(cov: FloatArray) -> FloatArray:
    sigma: FloatArray = np.sqrt(np.einsum("nii->ni", cov))
    return sigma
