"""Abrupt shifts of level in a log."""

from __future__ import annotations

from math import ceil

import numpy as np

from schuler.arrays import FloatArray
from schuler.characterisation.findings import FALSE_ALARM, SHOWN, Finding, found_at

_STAY_S = 5.0  # a shift of level lasts at least this long


def steps(x: FloatArray, time: FloatArray, axis: str, step: float | None) -> list[Finding]:
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
        if len(taken) >= 20 * SHOWN:
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
        found.append((abs(after - before), found_at("step", text, at, at)))
    found.sort(key=lambda pair: -pair[0])
    out = [finding for _, finding in found[:SHOWN]]
    if len(found) > SHOWN:
        out.append(Finding("step", f"{axis}: {len(found) - SHOWN} smaller shifts of level; perhaps popcorn noise"))
    return out
