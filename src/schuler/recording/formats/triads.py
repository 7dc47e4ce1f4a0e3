"""An IMU whose accelerometer and gyro are logged one by one, each with stamps of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError

_SAME_S = 1e-6
_PAUSE = 5.0  # sample intervals; nothing is interpolated over a longer one


def joined(
    t_a: FloatArray, f: FloatArray, t_g: FloatArray, w: FloatArray, path: Path, notes: list[str]
) -> dict[str, FloatArray]:
    """Columns of an IMU at the times of its gyro; specific forces are interpolated linearly to them.

    Parameters
    ----------
    t_a, t_g : ndarray, shape (n,), (m,)
        Increasing times of specific forces and of rates. [s]
    f, w : ndarray, shape (n, 3), (m, 3)
        [m/s^2], [rad/s]
    path : Path
        For messages.
    notes : list of str
        Takes a sentence where times differ.

    Raises
    ------
    FileFormatError
        If the two have no time in common.

    Notes
    -----
    Rates are left as they are, since their integral is attitude; a linear interpolation takes up to half of the noise
    variance of a specific force away and delays nothing.
    """
    names = ("ax", "ay", "az", "gx", "gy", "gz")
    if len(t_a) == len(t_g) and np.abs(t_a - t_g).max() < _SAME_S:
        return {"t": t_g, **dict(zip(names, np.column_stack((f, w)).T, strict=True))}
    inside = (t_g >= t_a[0]) & (t_g <= t_a[-1])
    if len(t_a) > 2:
        step = np.diff(t_a)
        within = np.clip(np.searchsorted(t_a, t_g, side="right") - 1, 0, len(step) - 1)
        pause = inside & (step[within] > _PAUSE * np.median(step))
        if pause.any():
            inside &= ~pause
            notes.append(f"{int(pause.sum())} rates fall into pauses of the accelerometer and were left out.")
    if inside.sum() < 2:
        raise FileFormatError(
            f"accelerometer ({t_a[0]:.3f}..{t_a[-1]:.3f} s) and gyro ({t_g[0]:.3f}..{t_g[-1]:.3f} s) have no time in "
            "common",
            path,
        )
    at = np.stack([np.interp(t_g[inside], t_a, f[:, k]) for k in range(3)], axis=1)
    notes.append("Accelerometer and gyro have stamps of their own; specific forces were interpolated to the gyro's.")
    return {"t": t_g[inside], **dict(zip(names, np.column_stack((at, w[inside])).T, strict=True))}
