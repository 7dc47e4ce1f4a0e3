"""Sampling and readings of an IMU: gaps, jitter, interpolation, held and stuck readings, range, rounding, noise."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TypeAlias

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.characterisation.readings import equal_runs, resolution
from schuler.diagnosis.result import Finding, Severity, number_of
from schuler.recording.series import SENSORS, ImuSeries
from schuler.standstill.unscaled import UnscaledRests

_FASTEST_K_S = 1.0  # a sensor's temperature changes by some kelvins a minute
_MOST = 400_000  # samples looked at for what shows anywhere
_BLOCK = 1 << 16  # samples that are looked at at a time
CHANNELS = ("ax", "ay", "az", "gx", "gy", "gz")
LARGE_STEP = (0.03, 0.1 * units.DEG)  # of a reading [m/s^2], [rad/s]
_RATTLE_S = 0.08  # a knock rings for about as long [s]
_LOST = 0.5  # step of stamps against even ones that is a missing sample [samples]
_LOUD = (0.8, 0.1)  # spread beyond any IMU on anything that rests for a second [m/s^2], [rad/s]
Channels: TypeAlias = tuple[FloatArray, ...]  # readings by channel, shapes (n,)


def check_times(t: FloatArray) -> list[Finding]:
    """Findings ``gaps`` and ``jitter`` of increasing times. [s]"""
    if len(t) < 10:
        return []
    step = np.diff(t)
    interval = float(np.median(step))
    gap = step > 1.5 * interval
    findings = []
    # a clock in whole ticks makes steps of one and two ticks: no loss
    real = step > 2.5 * interval
    lost = float(np.sum(step[real] - interval))
    if real.any():
        k = int(np.argmax(step))
        share = lost / float(t[-1] - t[0])
        bad = step[k] > max(0.3, 5.0 * interval) or share > 0.005
        text = (
            f"{number_of(real.sum(), 'gap')} of more than 2.5 sample intervals, {lost:.3g} s in all; the longest "
            f"lasts {step[k]:.4g} s from {t[k]:.3f} s"
        )
        evidence = {"gaps": int(real.sum()), "lost_s": lost, "longest_s": float(step[k]), "at_s": float(t[k])}
        findings.append(Finding("gaps", "warning" if bad else "note", text, 1.0, "", evidence))
    close = step[~real]
    spread = float(np.quantile(np.abs(close - interval), 0.95))
    if spread > 0.2 * interval:
        rate, lost_samples = counted_rate(t)
        text = (
            f"the time stamps jitter: one step in twenty differs by more than {1e3 * spread:.3g} ms from the "
            f"interval of {1e3 * interval:.4g} ms"
        )
        evidence = {"spread_s": spread, "interval_s": interval, "short_steps": int(gap.sum())}
        fix = "the log as recorded, or stamps of the sensor's own counter"
        if rate is None:
            text += "; samples are missing or their rate changes, so that they cannot be counted instead"
        else:
            text += f" (counted over the log, {rate:.6g} Hz)"
            evidence["rate_hz"] = rate
            fix = f"count the samples: leave the time column out (columns '-') and say rate={rate:.6g}"
        evidence["lost_samples"] = lost_samples
        severity: Severity = "warning" if spread > 0.35 * interval else "note"
        findings.append(Finding("jitter", severity, text, 0.9, fix, evidence))
    return findings


def counted_rate(t: FloatArray) -> tuple[float | None, float]:
    """Rate of samples counted over the log, and the largest step of the stamps against even ones, in samples.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Increasing. [s]

    Returns
    -------
    rate : float or None
        None if samples counted at any one rate would drift off their stamps: a gap would be hidden. [Hz]
    lost : float
        Step of the stamps against samples counted at the rate, jitter taken out by medians. [samples]
    """
    width = min(max(20, len(t) // 200), 400)
    m = len(t) // width
    if m < 4:
        return None, 0.0
    step = float((t[-1] - t[0]) / (len(t) - 1))
    n = np.arange(m * width, dtype=np.float64)
    middle = np.median((t[: m * width] - t[0] - step * n).reshape(m, width), axis=1)
    # medians of samples of one rate lie on a line; a missing sample shifts all after it by an interval
    x = np.arange(m) - 0.5 * (m - 1)
    slope = float(x @ middle / (x @ x))
    left = middle - middle.mean() - slope * x
    lost = float(np.ptp(left)) / step
    if lost > _LOST:
        return None, lost
    interval = step + slope / width
    return 1.0 / interval, lost


def check_temperature(imu: ImuSeries) -> list[Finding]:
    """Finding ``time_unit``: a temperature that changes faster than that of any sensor.

    Parameters
    ----------
    imu : ImuSeries
    """
    T = imu.temperature
    if T is None or len(T) < 100 or not np.all(np.isfinite(T)):
        return []
    low, high = np.quantile(T, (0.01, 0.99))
    span = float(imu.t[-1] - imu.t[0])
    if high - low < 5.0 or high - low < _FASTEST_K_S * span:
        return []
    text = (
        f"the temperature goes from {low:.0f} to {high:.0f} degC within {span:.3g} s, which no sensor does: the stamps "
        "are in another unit, or not those of the samples (a log that was thinned out)"
    )
    evidence = {"lowest": float(low), "highest": float(high), "span_s": span}
    fix = "units='t=...' (ms, us, ns), or the log as recorded"
    return [Finding("time_unit", "warning", text, 0.9, fix, evidence)]


def check_readings(imu: ImuSeries, rests: UnscaledRests, factors: tuple[float, float]) -> list[Finding]:
    """Findings about the values of an IMU log.

    Parameters
    ----------
    imu : ImuSeries
        As read; increments are looked at as they stand.
    rests : UnscaledRests
    factors : (float, float)
        Make the accelerometer's and the gyro's numbers SI rates.
    """
    findings: list[Finding] = []
    y = (*imu.accel.T, *imu.gyro.T)  # views: of a day at 200 Hz a copy is 830 MB
    step = imu.interval if imu.kind == "increment" else 1.0
    scale = np.repeat(factors, 3) / step
    dead = [c for c, x in zip(CHANNELS, y, strict=True) if np.ptp(x) == 0.0]
    grid = [None if c in dead else resolution(x) for c, x in zip(CHANNELS, y, strict=True)]
    clipped = _saturated(imu, y, grid, scale, dead)
    at_rest = noise_at_rest(imu, rests, grid, factors, dead)
    coarse = [c for f in at_rest if f.code == "quantised" for c in f.evidence["axes"]]
    silent = [c for c in dead if not _one_step(c, y, grid, scale, coarse)]
    if silent:
        text = (
            f"{', '.join(silent)} never change{'s' * (len(silent) == 1)}: not connected, not read, or a constant column"
        )
        fix = "columns='...' (name the right columns)"
        findings.append(Finding("dead_axis", "error", text, 1.0, fix, {"axes": silent}))
    held = _held(y, dead)
    passed_over = [*dead, *coarse, *(f.evidence["axis"] for f in clipped)]
    if held:
        findings.append(held)
        # one of each group of equal samples
        fresh = np.concatenate(([True], np.logical_or.reduce([x[1:] != x[:-1] for x in y])))
        findings += _stuck(imu.t[fresh], (x[fresh] for x in y), grid, passed_over)
    else:
        findings += _stuck(imu.t, y, grid, passed_over)
        findings += _interpolated(y, grid, dead)
    findings += clipped
    findings += _spikes(imu, y, scale, dead)
    findings += at_rest
    return findings


def _held(y: Channels, dead: list[str]) -> Finding | None:
    """All channels repeat together in most samples: a log faster than the sensor."""
    if len(dead) > 3:
        return None
    each = [x[1:_MOST] == x[: min(len(x), _MOST) - 1] for x in y]
    same = np.logical_and.reduce(each)
    share = float(np.mean(same))
    # rounding repeats readings at rest, a log faster than its sensor always
    blocks = same[: len(same) // 100 * 100].reshape(-1, 100).mean(axis=1) if len(same) >= 1000 else np.array([share])
    if share < 0.2 or np.quantile(blocks, 0.1) < 0.6 * share:
        return None
    # and it repeats all of them at once
    single = [float(np.mean(x)) for x, c in zip(each, CHANNELS, strict=True) if c not in dead]
    if share < 0.75 * float(np.median(single)):
        return None
    start, length = equal_runs(same.astype(float))
    repeats = length[same[start]]
    if np.quantile(repeats, 0.99) > 3.0 * np.median(repeats) + 3.0:
        return None  # of any length: rounding
    runs = float(1.0 / max(1.0 - share, 1e-9))
    text = (
        f"{100.0 * share:.0f} % of the samples repeat the one before on all axes: the log is about {runs:.2g} "
        f"times faster "
        "than the sensor (samples were held)"
    )
    fix = f"keep one of every {max(round(runs), 2)} rows"
    return Finding("repeated", "warning", text, 0.95, fix, {"share": share, "samples_each": runs})


def _one_step(c: str, y: Channels, grid: list[float | None], scale: FloatArray, coarse: list[str]) -> bool:
    """Whether a constant reading is one of the large steps to which the other axes of its triad are rounded."""
    k = CHANNELS.index(c)
    for i in range(k // 3 * 3, k // 3 * 3 + 3):
        step = grid[i]
        if step is None or CHANNELS[i] not in coarse or step * scale[i] < LARGE_STEP[k // 3]:
            continue
        steps = y[k][0] / step
        if abs(steps - round(steps)) < 1e-3:
            return True
    return False


def _stuck(t: FloatArray, y: Iterable[FloatArray], grid: list[float | None], passed_over: list[str]) -> list[Finding]:
    """Runs of one reading far longer than any other."""
    findings = []
    for c, step, x in zip(CHANNELS, grid, y, strict=True):
        if c in passed_over:
            continue
        start, length = equal_runs(x)
        k = int(np.argmax(length))
        others = np.delete(length, k)
        usual = float(np.quantile(others, 0.999)) if len(others) > 10 else 1.0
        same = int(np.sum(length - 1)) - int(length[k] - 1)
        if same > 0.25 * (len(x) - int(length[k])):
            continue  # rounding repeats most readings
        # several stuck stretches: the tail without the longest ones
        tail = float(np.quantile(length, 0.99))
        seconds = float(t[start[k] + length[k] - 1] - t[start[k]])
        # changes of a step or two: rounding holds a reading as long as it moves slowly
        rounded = step is not None and float(np.median(np.abs(np.diff(x)))) < 2.5 * step
        if seconds < (2.0 if rounded else 0.1):
            continue
        if length[k] < max(25.0, 6.0 * tail, 1.0 + 2.5 * min(usual, 8.0 * tail)):
            continue
        top = x[start[k]] in (x.max(), x.min())
        if top and np.count_nonzero(x == x[start[k]]) > 1.5 * length[k]:
            continue  # the end of the range, not a sensor that stopped
        text = (
            f"{c}: {int(length[k])} samples in a row read {x[start[k]]:.6g} from {t[start[k]]:.3f} s "
            f"({seconds:.3g} s), where otherwise {tail:.0f} is long: the sensor or its reading stopped"
        )
        evidence = {"axis": c, "from_s": float(t[start[k]]), "samples": int(length[k]), "usual": tail}
        findings.append(Finding("stuck", "warning", text, 0.95, "cut this part out", evidence))
    return findings


def _interpolated(y: Channels, grid: list[float | None], dead: list[str]) -> list[Finding]:
    """Samples that lie on the line between their neighbours."""
    share = []
    for k, c in enumerate(CHANNELS):
        x = y[k][:_MOST]
        if c in dead:
            continue
        d2 = np.diff(x, 2)
        size = float(np.quantile(np.abs(d2), 0.9))
        step = grid[k]
        if size <= 0.0 or (step is not None and size < 8.0 * step):
            continue
        flat = float(np.mean(np.abs(d2) < 1e-3 * size))
        by_chance = 0.01 if step is None else min(1.0, 0.5 * step / size + 0.02)
        share.append(max(flat - by_chance, 0.0))
    if not share or np.median(share) < 0.15:
        return []
    value = float(np.median(share))
    text = (
        f"{100.0 * value:.0f} % of the samples lie exactly on the line between their neighbours: the log was "
        f"interpolated "
        "to this rate (resampled), its noise and its times are not those of the sensor"
    )
    return [Finding("resampled", "warning", text, 0.95, "use the log as recorded", {"share": value})]


def _saturated(
    imu: ImuSeries, y: Channels, grid: list[float | None], scale: FloatArray, dead: list[str]
) -> list[Finding]:
    """Readings piled up at the very end of the range."""
    findings = []
    for k, c in enumerate(CHANNELS):
        if c in dead:
            continue
        x = y[k]
        width = float(np.ptp(x))
        step = grid[k] or 0.0
        if width < 60.0 * step:
            continue
        for sign in (1.0, -1.0):
            v = sign * x
            top = float(v.max())
            at = v >= top - 1e-9 * max(abs(top), 1e-300)
            count = int(at.sum())
            near = int(np.count_nonzero(v >= top - max(0.02 * width, 1.5 * step)) - count)
            run = 1
            if count >= 5:
                _, length = equal_runs(at.astype(float))
                first = at[0]
                run = int(length[(0 if first else 1) :: 2].max(initial=1))
            if count < 5 or run < 3 or count < near or abs(top) < 0.3 * np.abs(x).max():
                continue
            limit = sign * top * scale[k]
            unit = "m/s^2" if k < 3 else "rad/s"
            text = (
                f"{c}: {count} samples ({100.0 * count / len(x):.2g} %) stop at {limit:.5g} {unit}, up to "
                f"{run} in a row: the "
                "sensor's range ends there and the true signal is lost"
            )
            evidence = {"axis": c, "samples": count, "limit_si": limit, "run": run, "at_s": float(imu.t[np.argmax(at)])}
            findings.append(
                Finding("saturated", "warning", text, 0.9, "a larger range; leave these parts out", evidence)
            )
            break
    return findings


def _spikes(imu: ImuSeries, y: Channels, scale: FloatArray, dead: list[str]) -> list[Finding]:
    """Single samples far off both neighbours, the neighbours agreeing."""
    names, total, worst, at = [], 0, 0.0, 0.0
    if len(imu) < 100:
        return []
    rattle = max(3, round(_RATTLE_S / imu.interval))
    usual = [_usual_change(x) for x in y]
    alive = [k for k, c in enumerate(CHANNELS) if c not in dead]

    def change(k: int, first: int, stop: int) -> float:
        """Largest of some changes from sample to sample, in the channel's usual ones."""
        return float(np.abs(np.diff(y[k][max(first, 0) : stop + 1])).max(initial=0.0)) / usual[k]

    for k in alive:
        least = max((4.0 if k < 3 else 0.35) / scale[k] if scale[k] > 0.0 else np.inf, 8.0 * usual[k])
        spikes = []
        for j, off in _lone(y[k], least):
            # a knock is felt by the other axes too, however hard, and shakes its own axis for longer than a sample
            others = max((change(i, j - 1, j + 3) for i in alive if i != k), default=0.0)
            if max(others, change(k, j - rattle, j), change(k, j + 2, j + 2 + rattle)) < 2.5:
                spikes.append((off, j))
        if spikes:
            names.append(CHANNELS[k])
            total += len(spikes)
            off, j = max(spikes, key=lambda spike: spike[0])
            if off / usual[k] > worst:
                worst, at = off / usual[k], float(imu.t[j + 1])
    if not total:
        return []
    text = (
        f"{number_of(total, 'single sample')} on {', '.join(names)} {worst:.0f} times further out than the log's "
        f"largest usual change, the worst at {at:.3f} s: spikes of the transmission, not of motion"
    )
    fix = "replace these readings by the mean of their neighbours"
    return [Finding("spikes", "warning", text, 0.9, fix, {"samples": total, "axes": names, "at_s": at})]


def _usual_change(x: FloatArray) -> float:
    """Change from one sample to the next that one in a hundred exceeds."""
    change = np.diff(x)
    return max(float(np.quantile(np.abs(change, out=change), 0.99, overwrite_input=True)), 1e-300)


def _lone(x: FloatArray, least: float) -> Iterator[tuple[int, float]]:
    """Samples further than ``least`` off both neighbours, which agree: number of the one before, and how far off."""
    for start in range(0, len(x) - 2, _BLOCK):
        before, now, after = (x[start + i : min(start + i + _BLOCK, len(x) - 2 + i)] for i in range(3))
        up, down = now - before, now - after
        off = np.minimum(np.abs(up), np.abs(down))
        bad = (np.sign(up) == np.sign(down)) & (off > least) & (np.abs(after - before) < 0.3 * off)
        for j in np.flatnonzero(bad).tolist():
            yield start + j, float(off[j])


def _noise(imu: ImuSeries, factors: tuple[float, float]) -> list[Finding]:
    """Scatter from sample to sample in the quietest tenth of the log, whatever moves slowly. SI rates."""
    per = max(20, round(1.0 / imu.interval))
    m = len(imu) // per
    if m < 5:
        return []
    sd = np.empty((m, 6))
    rows = max(1, _BLOCK // per)  # seconds
    for k, sensor in enumerate(SENSORS):
        y = imu.mean_rates(sensor)[: m * per].reshape(m, per, 3)
        for first in range(0, m, rows):
            part = slice(first, first + rows)
            for i in range(3):
                x = y[part, :, i] * factors[k]
                sd[part, 3 * k + i] = np.sqrt(np.mean(np.diff(x, 2, axis=1) ** 2, axis=1) / 6.0)  # of white noise
        del y
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
    findings = _noise(imu, factors)
    if not len(rests):
        return findings
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
        findings.append(
            Finding("quantised", "warning" if large else "note", text, 0.9, "more digits or bits in the log", evidence)
        )
    return findings
