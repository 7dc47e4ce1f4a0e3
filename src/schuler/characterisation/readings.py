"""Readings of a sensor: their resolution, the end of the range, values that repeat."""

from __future__ import annotations

from math import log, sqrt

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, IntArray
from schuler.characterisation.result import FALSE_ALARM, MOST_PLACES, Finding, Severity, finding_at


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


def _pieces(x: FloatArray, number: int = 16) -> FloatArray:
    """Pieces spread over a log, one after the other; all of a short one. Sorting millions of readings takes seconds."""
    length = 4096
    if len(x) <= number * length:
        return x
    first = np.linspace(0, len(x) - length, number).astype(np.int64)
    return np.asarray(x[first[:, None] + np.arange(length)].ravel())


def saturated(
    x: FloatArray, time: FloatArray, axis: str, full_scale: float | None, step: float | None
) -> list[Finding]:
    """Readings at the end of the range: at ``full_scale``, or piled up at the extremes."""
    near = 0.5 * step if step is not None else 1e-9 * float(np.abs(x).max())
    if full_scale is not None:
        clipped = np.abs(x) >= full_scale - near
    else:
        clipped = np.zeros(len(x), dtype=bool)
        # with fewer readings any of them may be the most frequent
        if any(len(np.unique(part)) >= 8 for part in (x[:256], _pieces(x), x)):
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
    return [finding_at("saturated", text, time[k[0]], time[k[-1]], "refused" if share > 0.5 else "warning")]


def stuck(x: FloatArray, time: FloatArray, axis: str, step: float | None) -> list[Finding]:
    """Runs of equal readings longer than rounding to ``step`` explains, and readings that were held."""
    n = len(x)
    start, length = equal_runs(x)
    if length.max() < 5 and np.mean(length > 1) < 0.3:
        return []  # what the limits below come to at least
    d = np.diff(x)
    findings: list[Finding] = []
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
        findings.append(Finding("repeated", text))
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
    for k in where[:MOST_PLACES]:
        a, m = int(start[k]), int(length[k])
        text = (
            f"{axis}: {m} samples in a row read {x[a]:.6g} from {time[a]:.2f} s on, where rounding explains "
            f"about {longest:.0f}; the sensor or its reading stopped: cut this part"
        )
        severity: Severity = "refused" if length[where].sum() > 0.5 * n else "warning"
        findings.append(finding_at("stuck", text, time[a], time[a + m - 1], severity))
    if len(where) > MOST_PLACES:
        others = where[MOST_PLACES:]
        text = f"{axis}: {len(others)} more runs of equal readings, {length[others].sum()} samples"
        findings.append(Finding("stuck", text))
    return findings


def equal_runs(x: FloatArray) -> tuple[IntArray, IntArray]:
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


def coarse(sigma: float, step: float, axis: str) -> Finding:
    """That the noise ``sigma`` of a sample is lost in its rounding."""
    text = (
        f"{axis}: the resolution {step:.3g} is coarse, the noise of a sample is {sigma / step:.2f} of it or less; "
        "rounding is then neither white nor independent of the signal, and short averaging times are not believable; "
        "average more in the sensor or raise its gain; outliers and stuck values cannot be told from rounding here"
    )
    return Finding("coarse", text)
