"""Rates that a log lost: gyroscopes at the end of their range, and single samples spoiled on the way."""

from __future__ import annotations

import numpy as np

from schuler.arrays import FloatArray, IntArray

_RUN, _FEWEST = 3, 5  # readings in a row, and in all, at the very end of a range
_NEAR = 0.02  # of the range: what a smooth maximum has there, a clipped one has at its end
_SPIKE = 0.6  # of the rate that 0.1 % exceed: off both neighbours, which agree to a third of that; hands make 0.47


def clipped_rates(gyro: FloatArray) -> tuple[IntArray, str]:
    """Samples at which a gyroscope stood at the end of its range, and the axes' names.

    Parameters
    ----------
    gyro : ndarray, shape (n, 3)
        In any unit.
    """
    lost, axes = [], ""
    for axis in range(3):
        x = gyro[:, axis]
        if np.ptp(x) == 0.0:  # no gyroscope
            continue
        for v in (x, -x):
            top = float(v.max())
            at = np.flatnonzero(v >= top - 1e-9 * abs(top))
            if len(at) < _FEWEST or not np.any(at[_RUN - 1 :] - at[: 1 - _RUN] == _RUN - 1):
                continue
            if np.count_nonzero(v >= top - _NEAR * np.ptp(x)) <= 2 * len(at):
                lost.append(at)
                axes += "xyz"[axis] if "xyz"[axis] not in axes else ""
    return (np.unique(np.concatenate(lost)) if lost else np.empty(0, dtype=np.int64)), axes


def spiked_rates(gyro: FloatArray) -> IntArray:
    """Single samples far off both neighbours, which agree with one another."""
    spiked: list[IntArray] = []
    usual = float(np.quantile(np.abs(gyro).max(axis=1), 0.999)) if len(gyro) else 0.0
    for x in gyro.T:
        d = np.diff(x)
        off = np.minimum(np.abs(d[:-1]), np.abs(d[1:]))
        far = np.flatnonzero(off > _SPIKE * usual)
        spiked.append(1 + far[np.abs(d[far] + d[far + 1]) < off[far] / 3.0])
    return np.unique(np.concatenate(spiked))


def lost_rates(t: FloatArray, gyro: FloatArray) -> tuple[IntArray, tuple[str, ...]]:
    """Samples at which rates were lost, and sentences that say why.

    Parameters
    ----------
    t : ndarray, shape (n,)
        [s]
    gyro : ndarray, shape (n, 3)
        Rates in any unit.
    """
    clipped, axes = clipped_rates(gyro)
    spiked = spiked_rates(gyro)
    sentences = []
    if len(clipped):
        sentences.append(
            f"Gyroscope {' and '.join(axes)} stops at the end of its range in {len(clipped)} samples, the first at "
            f"{t[clipped[0]]:.1f} s: clipped; turn more slowly. Turns with such samples are left out where enough "
            "others remain."
        )
    if len(spiked):
        sentences.append(
            f"{len(spiked)} single rates are far off both of their neighbours, the first at {t[spiked[0]]:.2f} s: "
            "spikes of the transmission. Turns with such samples are left out where enough others remain."
        )
    return np.union1d(clipped, spiked), tuple(sentences)
