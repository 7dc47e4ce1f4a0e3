"""What is wrong with a log at rest, before any noise parameter is made of it.

Every statistical test here is for Gaussian noise of any colour that has stationary increments (white, flicker, random
walk, Gauss-Markov, ramp): such a log draws a finding of one kind with probability :data:`FALSE_ALARM` at most.
"""

from __future__ import annotations

from math import ceil, log, sqrt

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray
from schuler.characterisation import sums
from schuler.characterisation.findings import Finding
from schuler.characterisation.result import AXES
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries, check_times
from schuler.units import G0

#: Probability of a false finding of one kind (motion, outliers, steps, stuck values) in a clean log.
FALSE_ALARM = 0.01
#: Fewer samples than this give no number at all.
FEWEST = 200
_SHOWN = 3  # places named for one kind of finding
_STAY_S = 5.0  # a shift of level lasts at least this long
_BLOCK_S = 1.0  # a disturbance is looked for in blocks of this length, at least 32 samples


def check_static_log(
    x: ArrayLike,
    rate_hz: float,
    axis: str = "gyro_x",
    t: ArrayLike | None = None,
    full_scale: float | None = None,
    lsb: float | None = None,
) -> list[Finding]:
    """Findings about one axis of a log taken at rest.

    Parameters
    ----------
    x : array_like, shape (n,)
        Rate or specific force; NaN or infinity marks a missing sample. [rad/s] or [m/s^2]
    rate_hz : float
        Sampling rate.
    axis : str
        For the sentences.
    t : array_like, shape (n,), optional
        Times, to find gaps. None: evenly spaced. [s]
    full_scale : float, optional
        Largest value the sensor can show; None: only values piled up at the extremes are seen. [x]
    lsb : float, optional
        Resolution; None: found from the values, see :func:`resolution`. [x]

    Returns
    -------
    list of Finding
        Codes ``too_short``, ``gap``, ``missing``, ``stuck``, ``repeated``, ``saturated``, ``motion``, ``outliers``,
        ``step``, ``coarse``; empty if there is nothing to say. Severity ``refused`` where no number should be given.

    Raises
    ------
    InputError
        If x is not one-dimensional, times do not increase, or an option is not positive.

    Notes
    -----
    =============  =====================================================================================================
    motion         variance of a block (1 s, at least 32 samples) against the chi-square distribution, whose degrees of
                   freedom are reduced to the spread of the log variances of all blocks; blocks disturbed by single
                   samples are left to outliers
    outliers       distance from the block's median against the normal distribution of robust scale (median absolute
                   deviation)
    step           third differences of neighbouring window means on scales of 16 samples to 1/40 of the log, each
                   against Student's distribution about their own median absolute deviation: drift of any colour widens
                   all of them, a step is an outlier among them
    stuck          runs of equal values against the run length that rounding explains at the worst place of the mean
    =============  =====================================================================================================

    Drift as large as the white noise within one block makes false motion more likely (one log in ten where K of a
    random walk is 3 N per second). A popcorn (burst) noise is made of steps and is reported as such. What changes
    slowly is left to :mod:`schuler.characterisation.trends`.
    """
    values = np.asarray(x, dtype=np.float64)
    if values.ndim != 1:
        raise InputError(f"x: expected one axis, shape (n,), got {values.shape}; check axes one by one")
    for name, number in (("rate_hz", rate_hz), ("full_scale", full_scale), ("lsb", lsb)):
        if number is not None and not (np.isfinite(number) and number > 0.0):
            raise InputError(f"{name}: expected a positive number, got {number}")
    if t is None:
        time, found = np.arange(len(values)) / rate_hz, []
    else:
        time = check_times(t, "t")
        if len(time) != len(values):
            raise InputError(f"t: expected {len(values)} times, one for each sample, got {len(time)}")
        found, time = gaps(time), time - time[0]
    good = np.isfinite(values)
    if not good.all() and good.any():
        k = int(np.flatnonzero(~good)[0])
        found.append(
            _finding(
                "missing",
                f"{axis}: {np.count_nonzero(~good)} of {len(good)} samples are missing, the first at {time[k]:.2f} s; "
                "they are left out",
                time[k],
                time[np.flatnonzero(~good)[-1]],
            )
        )
    values, time = values[good], time[good]
    n = len(values)
    if n < FEWEST:
        text = f"{axis}: {n} samples are too few for any noise parameter; record at least {FEWEST}, better an hour"
        return [*found, Finding("too_short", text, severity="refused")]
    if np.ptp(values) == 0.0:
        text = f"{axis}: every sample reads {values[0]:.6g}; the axis is not connected or not read, there is no noise"
        return [*found, _finding("stuck", text, time[0], time[-1], "refused")]
    start, length = _equal_runs(values)
    k = int(np.argmax(length))
    if length[k] > 0.5 * n:
        a = int(start[k])
        text = f"{axis}: from {time[a]:.2f} s on {length[k]} of {n} samples read {values[a]:.6g}; no noise to judge"
        return [*found, _finding("stuck", text, time[a], time[a + length[k] - 1], "refused")]
    step = resolution(values) if lsb is None else float(lsb)
    saturated = _saturated(values, time, axis, full_scale, step)
    found += saturated
    if any(f.severity == "refused" for f in saturated):
        return found
    b = min(max(32, round(_BLOCK_S * rate_hz)), n // 20)
    moved, odd, sigma = _disturbed(values, b, step)
    if step is not None and sigma < 0.5 * step:
        # readings jump between a few levels: long runs and far neighbours are what rounding makes
        found.append(_coarse(sigma, step, axis))
        odd[:] = False
    else:
        found += _stuck(values, time, axis, step)
    found += _motion(moved, time, b, axis)
    found += _outliers(values, odd, time, b, sigma, axis)
    # a step must be seen across a disturbance, too: leave those blocks out, replace single bad samples
    clean = values[: len(moved) * b].reshape(-1, b).copy()
    np.copyto(clean, np.median(clean, axis=1, keepdims=True), where=odd)
    found += _steps(clean[~moved].ravel(), time[: clean.size].reshape(-1, b)[~moved].ravel(), axis, step)
    return found + _allan_reach(values, rate_hz, axis)


def check_static_imu(
    imu: ImuSeries,
    gravity: float = G0,
    full_scale: tuple[float | None, float | None] = (None, None),
) -> dict[str, list[Finding]]:
    """Findings about every axis of an IMU log taken at rest, and about the recording.

    Parameters
    ----------
    imu : ImuSeries
    gravity : float
        Local gravity. [m/s^2]
    full_scale : (float or None, float or None)
        Of gyroscopes [rad/s] and accelerometers [m/s^2].

    Returns
    -------
    dict of str to list of Finding
        Keys ``gyro_x`` ... ``accel_z``, see :func:`check_static_log`, and ``recording`` for gaps, for a mean specific
        force more than 3 % from gravity and for slow tilting by more than 0.01 rad (codes ``gap``, ``not_at_rest``).
    """
    scale = imu.interval if imu.kind == "increment" else 1.0  # the median: dividing by each would hide the resolution
    signals = np.concatenate((imu.gyro, imu.accel), axis=1).T / scale
    rate_hz = imu.rate_hz
    found = {}
    for name, x in zip(AXES, signals, strict=True):
        limit = full_scale[0 if name.startswith("gyro") else 1]
        # gaps are told once for the recording; the stamps are there for the places of all else
        found[name] = [f for f in check_static_log(x, rate_hz, name, imu.t, full_scale=limit) if f.code != "gap"]
    found["recording"] = gaps(imu.t) + _attitude(signals[3:].T, imu.t - imu.t[0], gravity)
    return found


def resolution(x: ArrayLike) -> float | None:
    """Step between neighbouring readings, or None if the values do not lie on a grid that can be seen.

    Parameters
    ----------
    x : array_like, shape (n,)

    Returns
    -------
    float or None
        [x]

    Notes
    -----
    Of a long log 16 pieces of 4096 samples are looked at: a grid that does not show there is too fine to matter.
    """
    values = _pieces(np.asarray(x, dtype=np.float64))
    level = np.unique(values[np.isfinite(values)])
    if not 2 <= len(level) <= 0.5 * len(values):
        return None
    d = np.diff(level)
    d = d[d > 1e-7 * np.ptp(level)]  # readings that differ by rounding of the file only
    multiple = np.round(d / d.min())
    on_grid = np.abs(d / d.min() - multiple) < 0.05
    return float(np.median(d / multiple)) if np.mean(on_grid) > 0.95 else None


def length_needed(tau_s: float, relative_sigma: float = 0.25) -> float:
    """Length of a log whose Allan deviation at ``tau_s`` is to be known to ``relative_sigma`` (1 sigma). [s]

    Parameters
    ----------
    tau_s : float
        Averaging time. [s]
    relative_sigma : float
        Standard deviation of the deviation relative to it.

    Notes
    -----
    From ``1 / (2 edf) = relative_sigma^2`` with the degrees of freedom of flicker noise at long averaging times,
    ``edf = 5 r^2 / (4 (r + 3))``, r the length over ``tau_s``; 25 % takes about 9 averaging times.

    References
    ----------
    Riley (2008), NIST SP 1065, table 5 (overlapping estimator, flicker of the rate).
    """
    edf = 0.5 / relative_sigma**2
    return float(tau_s * 0.4 * (edf + sqrt(edf**2 + 15.0 * edf)))


def gaps(t: ArrayLike, factor: float = 1.5) -> list[Finding]:
    """Pauses longer than ``factor`` sample intervals, the longest first; one more sentence for the rest of them."""
    time = check_times(t, "t")
    step = np.diff(time)
    if not len(step):
        return []
    where = np.flatnonzero(step > factor * np.median(step))
    where = where[np.argsort(-step[where], kind="stable")]
    found = [
        _finding(
            "gap",
            f"no samples for {step[k]:.3f} s from {time[k] - time[0]:.2f} s on; estimators treat them as missing",
            time[k] - time[0],
            time[k + 1] - time[0],
        )
        for k in where[:_SHOWN]
    ]
    if len(where) > _SHOWN:
        text = f"{len(where) - _SHOWN} more gaps, {step[where[_SHOWN:]].sum():.3f} s in all"
        found.append(Finding("gap", text))
    return found


# ---------------------------------------------------------------------------------------------- each kind of finding


def _pieces(x: FloatArray, number: int = 16, length: int = 4096) -> FloatArray:
    """Pieces spread over a log, one after the other; all of a short one. Sorting millions of readings takes seconds."""
    if len(x) <= number * length:
        return x
    first = np.linspace(0, len(x) - length, number).astype(np.int64)
    return np.asarray(x[first[:, None] + np.arange(length)].ravel())


def _saturated(
    x: FloatArray, time: FloatArray, axis: str, full_scale: float | None, step: float | None
) -> list[Finding]:
    near = 0.5 * step if step is not None else 1e-9 * float(np.abs(x).max())
    if full_scale is not None:
        clipped = np.abs(x) >= full_scale - near
    else:
        clipped = np.zeros(len(x), dtype=bool)
        # with fewer readings any of them may be the most frequent
        if len(np.unique(_pieces(x))) >= 8 or len(np.unique(x)) >= 8:
            for sign in (1.0, -1.0):
                y = sign * x
                top = y.max()
                at_top = y >= top - 1e-9 * abs(top)
                below = (y >= top - (1.5 * step if step is not None else 0.02 * np.ptp(y))) & ~at_top
                # noise thins out towards its extremes: the last reading is not more frequent than those next to it
                last, others = np.count_nonzero(at_top), np.count_nonzero(below)
                if last >= 5 and (last > 3 * others or last - others > 5.0 * sqrt(last + others)):
                    clipped |= at_top
    k = np.flatnonzero(clipped)
    if not len(k):
        return []
    share = len(k) / len(x)
    text = (
        f"{axis}: {len(k)} samples ({100.0 * share:.2g} %) are at the end of the range, {x[k[0]]:.6g}; the true signal "
        "is not known there, so its variance comes out too small; raise the range or cut that part"
    )
    return [_finding("saturated", text, time[k[0]], time[k[-1]], "refused" if share > 0.5 else "warning")]


def _stuck(x: FloatArray, time: FloatArray, axis: str, step: float | None) -> list[Finding]:
    n = len(x)
    start, length = _equal_runs(x)
    if length.max() < 5 and np.mean(length > 1) < 0.3:
        return []  # what the limits below come to at least
    d = np.diff(x)
    found: list[Finding] = []
    share = np.mean(d == 0.0)
    typical = float(np.sqrt(np.median(d[d != 0.0] ** 2))) / 0.6745  # of the changes, were they normal
    expected = 0.0 if step is None else step / (sqrt(2.0 * np.pi) * typical)
    # nearly all runs alike: held samples; some much longer than the others: stuck
    held = np.mean(length > 1) > 0.3 + 3.0 * expected and np.mean(length > 2 * np.median(length) + 1) < 0.01
    if held:
        text = (
            f"{axis}: {100.0 * share:.0f} % of the samples repeat the one before, more than rounding explains; the log "
            f"is faster than the sensor (about {np.mean(length):.1f} samples each): thin it out, or white noise is "
            "misjudged"
        )
        found.append(Finding("repeated", text))
    # at the worst the mean is in the middle of a step, and a reading repeats with probability p
    p = 0.5 if held else 0.0
    if step is not None:
        p = max(p, _repeats(0.5 * float(np.median(_block_variances(d))), step))
    p = max(p, 1e-4)
    longest = np.inf if p >= 1.0 - 1e-9 else max(5.0, 1.0 + log(FALSE_ALARM / n) / log(p))
    # noise that comes and goes makes longer runs: none may be beyond the tail of the others either
    q = float(np.quantile(length, 0.99))
    tail = np.sort(length[length > q] - q)[:-3]
    if len(tail) and (held or step is not None):  # readings that are not rounded do not repeat at all
        longest = max(longest, q + float(np.mean(tail)) * log(len(tail) / FALSE_ALARM))
    where = np.flatnonzero(length > longest)
    where = np.array([k for k in where if length[k] > _longest_here(x, start, length, int(k), step)], dtype=np.int64)
    where = where[np.argsort(-length[where], kind="stable")]
    for k in where[:_SHOWN]:
        a, m = int(start[k]), int(length[k])
        text = (
            f"{axis}: {m} samples in a row read {x[a]:.6g} from {time[a]:.2f} s on, where rounding explains "
            f"about {longest:.0f}; the sensor or its reading stopped: cut this part"
        )
        severity = "refused" if length[where].sum() > 0.5 * n else "warning"
        found.append(_finding("stuck", text, time[a], time[a + m - 1], severity))
    if len(where) > _SHOWN:
        text = f"{axis}: {len(where) - _SHOWN} more runs of equal readings, {length[where[_SHOWN:]].sum()} samples"
        found.append(Finding("stuck", text))
    return found


def _equal_runs(x: FloatArray) -> tuple[IntArray, IntArray]:
    """First sample and length of each run of equal readings."""
    start = np.concatenate(([0], np.flatnonzero(np.diff(x) != 0.0) + 1))
    return start, np.diff(np.concatenate((start, [len(x)])))


def _repeats(sigma2: float, step: float) -> float:
    """Probability that rounding to ``step`` gives the reading again with the mean in the middle of a step, at worst."""
    from scipy.special import erf

    return float(erf(0.5 * step / sqrt(2.0 * max(sigma2 - step**2 / 12.0, 1e-4 * step**2))))


def _longest_here(x: FloatArray, start: IntArray, length: IntArray, k: int, step: float | None) -> float:
    """Longest run that the 100 runs before and after run k explain, by their lengths and by their readings."""
    first, last = max(k - 100, 0), min(k + 100, len(length) - 1)
    around = np.sort(np.concatenate((length[first:k], length[k + 1 : last + 1])))
    p = 1.0 - 1.0 / float(np.mean(around[: max(1, len(around) - 2)]))  # two of them may be stuck as well
    if step is not None:
        readings = np.concatenate((x[start[first] : start[k]], x[start[k] + length[k] : start[last] + length[last]]))
        p = max(p, _repeats(float(np.median(_block_variances(readings, 32))), step))
    return float(np.inf) if p > 1.0 - 1e-9 else 1.0 + log(FALSE_ALARM / len(x)) / log(max(p, 1e-4))


def _block_variances(x: FloatArray, b: int = 64) -> FloatArray:
    b = min(b, len(x))
    return np.asarray(x[: len(x) // b * b].reshape(-1, b).var(axis=1, ddof=1))


def _less_drift(x: FloatArray, b: int) -> FloatArray:
    """Blocks of b samples less a line through the blocks' medians: a random walk would widen them. Shape (k, b)"""
    blocks = x[: len(x) // b * b].reshape(-1, b)
    centre = b * np.arange(len(blocks)) + 0.5 * (b - 1)
    drift = np.interp(np.arange(blocks.size), centre, np.median(blocks, axis=1))
    return np.asarray(blocks - drift.reshape(-1, b))


def _variance_limit(v: FloatArray, b: int) -> tuple[float, float]:
    """What the largest of the block variances v may be, and the degrees of freedom their scatter shows."""
    from scipy.stats import chi2

    z = np.log(np.maximum(v, 1e-300))
    spread = 1.4826 * float(np.median(np.abs(z - np.median(z))))
    freedom = float(np.clip(2.0 / max(spread, 1e-9) ** 2, 1.0, b - 1))
    # a chi-square distribution of the same scatter has a thinner tail than one of coloured noise: 0.7, by simulation;
    # twice the usual variance is no disturbance worth a word
    ratio = max(2.0, float(chi2.isf(FALSE_ALARM / len(v), 0.7 * freedom) / chi2.median(0.7 * freedom)))
    return ratio * float(np.median(v)), freedom


def _disturbed(x: FloatArray, b: int, step: float | None) -> tuple[BoolArray, BoolArray, float]:
    """Blocks with too much variance (k,), outlying samples elsewhere (k, b), robust deviation of a sample."""
    from scipy.stats import norm

    d = _less_drift(x, b)
    # rounding to a few levels makes the median absolute deviation jump: spread the readings over their step
    dither = 0.0 if step is None else step * (np.random.default_rng(0).random(d.shape) - 0.5)
    scale = max(1.4826 * float(np.median(np.abs(d + dither))), 1e-300)
    odd = np.abs(d) > scale * sqrt(1.0 + 1.6 / b) * norm.isf(0.5 * FALSE_ALARM / x.size) + 0.5 * (step or 0.0)

    v = np.maximum(d.var(axis=1, ddof=1), 0.0 if step is None else step**2 / 12.0)
    limit, freedom = _variance_limit(v, b)
    rounding = 0.0 if step is None else step**2 / 12.0
    sigma = sqrt(max(min(float(np.median(v)) - rounding, scale**2 - 2.0 * rounding), 0.0))
    moved = v > limit
    if freedom < 0.5 * (b - 1):
        # drift within a block makes the variance scatter wider than any chi-square; it hardly shows in differences
        v_d = np.maximum(np.diff(d, axis=1).var(axis=1, ddof=1), 0.0 if step is None else step**2 / 6.0)
        moved &= v_d > _variance_limit(v_d, b - 1)[0]
    for j in np.flatnonzero(moved):
        rest = d[j][~odd[j]]
        if np.count_nonzero(odd[j]) <= max(2, 0.05 * b) and rest.var(ddof=1) <= limit:
            moved[j] = False
    odd[moved] = False
    return moved, odd, sigma


def _motion(moved: BoolArray, time: FloatArray, b: int, axis: str) -> list[Finding]:
    found = []
    edge = np.diff(np.concatenate(([False], moved, [False])).astype(np.int8))
    first, last = np.flatnonzero(edge == 1), np.flatnonzero(edge == -1)
    order = np.argsort(first - last, kind="stable")
    for i in order[:_SHOWN]:
        a, z = time[first[i] * b], time[last[i] * b - 1]
        text = (
            f"{axis}: a disturbance from {a:.1f} s to {z:.1f} s, more noise than the rest of the log can explain; "
            "leave it out, or the short averaging times are too large"
        )
        found.append(_finding("motion", text, a, z))
    if len(order) > _SHOWN:
        text = f"{axis}: {len(order) - _SHOWN} more disturbances, {b * np.count_nonzero(moved)} samples in all"
        found.append(Finding("motion", text))
    return found


def _outliers(x: FloatArray, odd: BoolArray, time: FloatArray, b: int, sigma: float, axis: str) -> list[Finding]:
    k = np.flatnonzero(odd.ravel())
    if not len(k):
        return []
    d = np.abs(_less_drift(x, b)).ravel()[k]
    worst = int(np.argmax(d))
    size = f", {d[worst] / sigma:.0f} sigma" if sigma > 0.0 else ""
    # what they add to the variance of white noise decides whether they matter
    added = float(np.sum(d**2)) / (odd.size * max(sigma, 1e-300) ** 2)
    text = (
        f"{axis}: {len(k)} outliers ({100.0 * len(k) / odd.size:.2g} % of the samples), the largest {d[worst]:.3g} off"
        f"{size} at {time[k[worst]]:.2f} s; they add {100.0 * added:.2g} % to the variance"
        + ("; use a robust estimator or leave them out" if added > 0.01 else ", too little to matter")
    )
    return [_finding("outliers", text, time[k[0]], time[k[-1]], "warning" if added > 0.01 else "note")]


def _coarse(sigma: float, step: float, axis: str) -> Finding:
    text = (
        f"{axis}: the resolution {step:.3g} is coarse, the noise of a sample is {sigma / step:.2f} of it or less; "
        "rounding is then neither white nor independent of the signal, and short averaging times are not believable; "
        "average more in the sensor or raise its gain; outliers and stuck values cannot be told from rounding here"
    )
    return Finding("coarse", text)


def _steps(x: FloatArray, time: FloatArray, axis: str, step: float | None) -> list[Finding]:
    """Shifts of level, the largest first."""
    from scipy.stats import t as student

    base = max(4, len(x) // 32768)
    if len(x) // base < 4 * 40:
        return []
    y = x[: len(x) // base * base].reshape(-1, base).mean(axis=1)
    interval = float(np.median(np.diff(time)))
    total = np.concatenate(([0.0], np.cumsum(y - y.mean())))
    candidates, scales, m = [], 0, 4
    rounding = 1e-300 if step is None else step  # means of pulses are good to a pulse in the window
    while len(y) >= 40 * m:
        starts = np.arange(0, len(y) - 4 * m + 1, m // 4)  # windows of m base blocks
        w = [(total[starts + (j + 1) * m] - total[starts + j * m]) / m for j in range(4)]
        # change between the middle windows less what a smooth drift makes of it
        e = 1.5 * (w[2] - w[1]) - 0.5 * (w[3] - w[0])
        e -= np.median(e)
        z = e / max(1.4826 * float(np.median(np.abs(e))), rounding / (m * base))
        # the median absolute deviation of k values is as good as the deviation of 0.37 k, if independent
        freedom = 0.37 * 0.375 * len(e)
        scales += 1
        # every scale has the same share of the false alarms: the long ones have few windows and show the small shifts
        p = len(e) * 2.0 * student.sf(np.abs(z), freedom)
        score = 0.5 * (freedom + 1.0) * np.log1p(z**2 / freedom)  # orders what underflows in p
        candidates += [(-score[i], p[i], starts[i] + m, m) for i in np.flatnonzero(p < FALSE_ALARM)]
        m *= 2
    found: list[tuple[float, Finding]] = []
    taken: list[int] = []
    for _, p, a, m in sorted(candidates):
        if p * scales > FALSE_ALARM:
            continue
        if len(taken) >= 20 * _SHOWN:
            break
        if any(a - m <= other <= a + 3 * m for other in taken):
            continue  # a window holds a shift found already
        part = y[a : a + 2 * m]
        split = a + 1 + int(np.argmax(np.abs(np.cumsum(part - part.mean())[:-1])))
        taken.append(split)
        before, after = (y[max(split - m, 0) : split].mean(), y[split : split + m].mean())
        # a bump comes back, a shift stays: for four windows and five seconds
        stay = max(4 * m, ceil(_STAY_S / (base * interval)))
        change = y[split + 1 : split + stay].mean() - y[max(split - stay, 0) : split].mean()
        if change * np.sign(after - before) <= 0.5 * abs(after - before):
            continue
        at = time[split * base]
        text = (
            f"{axis}: the level shifts by {after - before:+.3g} at {at:.1f} s, more abruptly than the drift of the "
            "rest of the log; cut there, or long averaging times show the shift and not the sensor"
        )
        found.append((abs(after - before), _finding("step", text, at, at)))
    found.sort(key=lambda pair: -pair[0])
    out = [finding for _, finding in found[:_SHOWN]]
    if len(found) > _SHOWN:
        out.append(Finding("step", f"{axis}: {len(found) - _SHOWN} smaller shifts of level; perhaps popcorn noise"))
    return out


def _allan_reach(x: FloatArray, rate_hz: float, axis: str) -> list[Finding]:
    """Whether the log is long enough to leave the white part of the Allan curve."""
    n = len(x)
    largest = max(1, int(n * 1.0 / length_needed(1.0)))
    m = np.unique(np.geomspace(1, largest, 12).astype(np.int64))
    avar, _ = sums.variance(sums.signal(x, "rate", 1.0 / rate_hz), "overlapping", m)
    tau, density = m / rate_hz, avar * m / rate_hz
    if density[-1] > 2.0 * density.min():
        return []
    floor = sqrt(avar[-1]) / 0.664
    text = (
        f"{axis}: {n / rate_hz:.0f} s are too short to see a bias instability: at {tau[-1]:.3g} s, the longest "
        f"averaging time known to 25 %, the Allan deviation {sqrt(avar[-1]):.2g} still is that of white noise, so B is "
        f"below about {1.5 * floor:.2g}; to see one of {floor / 3.0:.2g} takes {9.0 * n / rate_hz:.0f} s"
    )
    return [Finding("too_short", text, severity="note")]


def _attitude(f: FloatArray, time: FloatArray, gravity: float) -> list[Finding]:
    found = []
    mean = f.mean(axis=0)
    size = float(np.linalg.norm(mean))
    if abs(size - gravity) > 0.03 * gravity:
        text = (
            f"the mean specific force is {size:.3f} m/s^2, not {gravity:.3f}: not at rest, not calibrated to 3 %, or "
            "wrong units or scale"
        )
        found.append(Finding("not_at_rest", text))
    k = min(20, len(f) // 10)
    if k >= 3 and size > 0.0:
        parts = f[: len(f) // k * k].reshape(k, -1, 3)
        levels = parts.mean(axis=1)
        # turning against the first tenth, beyond what the means themselves scatter
        across = levels - levels @ mean[:, None] / size**2 * mean
        angle = np.linalg.norm(across - across[0], axis=1) / size
        j = int(np.argmax(angle))
        if angle[j] > 0.01 + 6.0 * float(parts.std(axis=1).mean()) / size / sqrt(parts.shape[1]):
            a = time[min(j * parts.shape[1], len(time) - 1)]
            text = (
                f"the specific force has turned by {angle[j]:.3f} rad by {a:.0f} s: the unit was tilted or its biases "
                "drift; level it on something solid"
            )
            found.append(_finding("not_at_rest", text, 0.0, a))
    return found


def _finding(code: str, text: str, start: float, stop: float, severity: str = "warning") -> Finding:
    return Finding(code, text, float(start), float(stop), severity)  # type: ignore[arg-type]
