"""Health of a log at rest, checked before any noise parameter is estimated.

Every statistical test here is for Gaussian noise of any colour that has stationary increments (white, flicker, random
walk, Gauss-Markov, ramp): such a log draws a finding of one kind with probability :data:`.FALSE_ALARM` at most.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray
from schuler.characterisation.readings import coarse, equal_runs, resolution, saturated, stuck
from schuler.characterisation.result import AXES, FALSE_ALARM, MOST_PLACES, Finding, finding_at
from schuler.characterisation.shifts import abrupt_shifts
from schuler.characterisation.variance import allan_variances, integrate_signal
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.timebase import check_times
from schuler.units import G0

#: Fewer samples than this give no number at all.
FEWEST = 200
_BLOCK_S = 1.0  # a disturbance is looked for in blocks of this length, at least 32 samples
_WARMING_K, _PARTS = 2.0, 60  # change of temperature worth a word, and parts of a log whose means are compared


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
        time, findings = np.arange(len(values)) / rate_hz, []
    else:
        time = check_times(t, "t")
        if len(time) != len(values):
            raise InputError(f"t: expected {len(values)} times, one for each sample, got {len(time)}")
        findings, time = gaps(time), time - time[0]
    good = np.isfinite(values)
    if not good.all() and good.any():
        k = int(np.flatnonzero(~good)[0])
        findings.append(
            finding_at(
                "missing",
                f"{axis}: {np.count_nonzero(~good)} of {len(good)} samples are missing, the first at {time[k]:.2f} s; "
                "they are left out",
                time[k],
                time[np.flatnonzero(~good)[-1]],
            )
        )
    if not good.all():
        values, time = values[good], time[good]
    n = len(values)
    if n < FEWEST:
        text = f"{axis}: {n} samples are too few for any noise parameter; record at least {FEWEST}, better an hour"
        return [*findings, Finding("too_short", text, severity="refused")]
    if np.ptp(values) == 0.0:
        text = f"{axis}: every sample reads {values[0]:.6g}; the axis is not connected or not read, there is no noise"
        return [*findings, finding_at("stuck", text, time[0], time[-1], "refused")]
    start, length = equal_runs(values)
    k = int(np.argmax(length))
    if length[k] > 0.5 * n:
        a = int(start[k])
        text = f"{axis}: from {time[a]:.2f} s on {length[k]} of {n} samples read {values[a]:.6g}; no noise to judge"
        return [*findings, finding_at("stuck", text, time[a], time[a + length[k] - 1], "refused")]
    del start, length  # of a long log as large as it is
    step = resolution(values) if lsb is None else float(lsb)
    clipped = saturated(values, time, axis, full_scale, step)
    findings += clipped
    if any(f.severity == "refused" for f in clipped):
        return findings
    b = min(max(32, round(_BLOCK_S * rate_hz)), n // 20)
    moved, odd, sigma = _disturbed(values, b, step)
    if step is not None and sigma < 0.5 * step:
        # readings jump between a few levels: long runs and far neighbours are what rounding makes
        findings.append(coarse(sigma, step, axis))
        odd[:] = False
    else:
        findings += stuck(values, time, axis, step)
    findings += _motion(moved, time, b, axis)
    findings += _outliers(values, odd, time, b, sigma, axis)
    # a step must be seen across a disturbance, too: leave those blocks out, replace single bad samples
    clean = values[: len(moved) * b].reshape(-1, b).copy()
    np.copyto(clean, np.median(clean, axis=1, keepdims=True), where=odd)
    time = time[: clean.size].reshape(-1, b)
    if moved.any():
        clean, time = clean[~moved], time[~moved]
    findings += abrupt_shifts(clean.ravel(), time.ravel(), axis, step)
    del clean, time
    return findings + _allan_reach(values, rate_hz, axis)


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
        Largest readings of gyroscopes [rad/s] and accelerometers [m/s^2].

    Returns
    -------
    dict of str to list of Finding
        Keys ``gyro_x`` ... ``accel_z``, see :func:`check_static_log`, and ``recording`` for gaps, for a mean specific
        force more than 3 % from gravity, for slow tilting by more than 0.01 rad, and for a temperature in the log that
        rises or falls by more than 2 K (codes ``gap``, ``not_at_rest``, ``warm_up``).
    """
    scale = imu.interval if imu.kind == "increment" else 1.0  # the median: dividing by each would hide the resolution
    rate_hz = imu.rate_hz
    findings = {}
    for k, name in enumerate(AXES):
        x, limit = (imu.gyro if k < 3 else imu.accel)[:, k % 3] / scale, full_scale[k // 3]
        # gaps are told once for the recording; the stamps are there for the places of all else
        findings[name] = [f for f in check_static_log(x, rate_hz, name, imu.t, full_scale=limit) if f.code != "gap"]
    findings["recording"] = gaps(imu.t) + _warming(imu)
    if imu.accel.any():  # a log without accelerometers holds zeros in their place
        findings["recording"] += _attitude(imu.accel, scale, imu.t - imu.t[0], gravity)
    return findings


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


def gaps(t: ArrayLike) -> list[Finding]:
    """Pauses longer than one and a half sample intervals, the longest first; one more sentence for the rest of them."""
    time = check_times(t, "t")
    step = np.diff(time)
    if not len(step):
        return []
    where = np.flatnonzero(step > 1.5 * np.median(step))
    where = where[np.argsort(-step[where], kind="stable")]
    findings = [
        finding_at(
            "gap",
            f"no samples for {step[k]:.3f} s from {time[k] - time[0]:.2f} s on; estimators treat them as missing",
            time[k] - time[0],
            time[k + 1] - time[0],
        )
        for k in where[:MOST_PLACES]
    ]
    if len(where) > MOST_PLACES:
        text = f"{len(where) - MOST_PLACES} more gaps, {step[where[MOST_PLACES:]].sum():.3f} s in all"
        findings.append(Finding("gap", text))
    return findings


# ---------------------------------------------------------------------------------------------- each kind of finding


def _less_drift(x: FloatArray, b: int) -> FloatArray:
    """Blocks of b samples less a line through the blocks' medians: a random walk would widen them. Shape (k, b)"""
    blocks = x[: len(x) // b * b].reshape(-1, b)
    centre = b * np.arange(len(blocks)) + 0.5 * (b - 1)
    drift = np.interp(np.arange(blocks.size), centre, np.median(blocks, axis=1))
    return np.asarray(blocks - drift.reshape(-1, b))


def _variance_limit(v: FloatArray, b: int) -> tuple[float, float]:
    """Limit of the block variances v, and the degrees of freedom that their scatter shows."""
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
        others = d[j][~odd[j]]
        if np.count_nonzero(odd[j]) <= max(2, 0.05 * b) and others.var(ddof=1) <= limit:
            moved[j] = False
    odd[moved] = False
    return moved, odd, sigma


def _motion(moved: BoolArray, time: FloatArray, b: int, axis: str) -> list[Finding]:
    findings = []
    edge = np.diff(np.concatenate(([False], moved, [False])).astype(np.int8))
    first, last = np.flatnonzero(edge == 1), np.flatnonzero(edge == -1)
    order = np.argsort(first - last, kind="stable")
    for i in order[:MOST_PLACES]:
        a, z = time[first[i] * b], time[last[i] * b - 1]
        text = (
            f"{axis}: a disturbance from {a:.1f} s to {z:.1f} s, more noise than the rest of the log can explain; "
            "leave it out, or the short averaging times are too large"
        )
        findings.append(finding_at("motion", text, a, z))
    if len(order) > MOST_PLACES:
        text = f"{axis}: {len(order) - MOST_PLACES} more disturbances, {b * np.count_nonzero(moved)} samples in all"
        findings.append(Finding("motion", text))
    return findings


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
    return [finding_at("outliers", text, time[k[0]], time[k[-1]], "warning" if added > 0.01 else "note")]


def _allan_reach(x: FloatArray, rate_hz: float, axis: str) -> list[Finding]:
    """Whether the log is long enough to leave the white part of the Allan curve."""
    n = len(x)
    largest = max(1, int(n * 1.0 / length_needed(1.0)))
    m = np.unique(np.geomspace(1, largest, 12).astype(np.int64))
    avar, _ = allan_variances(integrate_signal(x, "rate", 1.0 / rate_hz), "overlapping", m)
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


def _warming(imu: ImuSeries) -> list[Finding]:
    """Whether the temperature in the log goes from one value to another, and from when on it stays near the last."""
    if imu.temperature is None or len(good := np.flatnonzero(np.isfinite(imu.temperature))) < FEWEST:
        return []
    T, t = (
        np.array([part.mean() for part in np.array_split(x[good], _PARTS)]) for x in (imu.temperature, imu.t - imu.t[0])
    )
    change = float(T[-1] - T[0])
    if abs(change) < max(_WARMING_K, 0.7 * float(np.ptp(T))):
        return []
    far = np.flatnonzero(np.abs(T - T[-1]) > max(0.1 * abs(change), 0.5))
    settled = float(t[far[-1] + 1])
    advice = f"leave out what is before {settled:.0f} s" if settled < 0.6 * t[-1] else "record again when it is warm"
    text = (
        f"the temperature in the log goes from {T[0]:.1f} to {T[-1]:.1f} degC and is near its end from {settled:.0f} s "
        f"on: a sensor that warms up drifts, and long averaging times show that; {advice}"
    )
    return [finding_at("warm_up", text, 0.0, settled)]


def _attitude(accel: FloatArray, scale: float, time: FloatArray, gravity: float) -> list[Finding]:
    """Findings on the size and the direction of the mean of ``accel / scale``, shape (n, 3)."""
    findings = []
    k = max(min(20, len(accel) // 10), 1)
    n = len(accel) // k
    mean, levels, spread = np.empty(3), np.empty((k, 3)), np.empty((k, 3))
    for j in range(3):
        f = accel[:, j] / scale
        parts = f[: k * n].reshape(k, n)
        mean[j], levels[:, j], spread[:, j] = f.mean(), parts.mean(axis=1), parts.std(axis=1)
    size = float(np.linalg.norm(mean))
    if abs(size - gravity) > 0.03 * gravity:
        text = (
            f"the mean specific force is {size:.3f} m/s^2, not {gravity:.3f}: not at rest, not calibrated to 3 %, or "
            "wrong units or scale"
        )
        findings.append(Finding("not_at_rest", text))
    if k >= 3 and size > 0.0:
        # turning against the first tenth, beyond what the means themselves scatter
        across = levels - levels @ mean[:, None] / size**2 * mean
        angle = np.linalg.norm(across - across[0], axis=1) / size
        j = int(np.argmax(angle))
        if angle[j] > 0.01 + 6.0 * float(spread.mean()) / size / sqrt(n):
            a = time[min(j * n, len(time) - 1)]
            text = (
                f"the specific force has turned by {angle[j]:.3f} rad by {a:.0f} s: the unit was tilted or its biases "
                "drift; level it on something solid"
            )
            findings.append(finding_at("not_at_rest", text, 0.0, a))
    return findings
