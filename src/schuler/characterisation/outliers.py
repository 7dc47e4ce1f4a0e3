"""Single samples far from their neighbours, put back to where noise alone would have left them."""

from __future__ import annotations

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray
from schuler.exceptions import InputError

_WINDOW = 65  # samples whose median is the level; short against any drift worth modelling
_LIMIT = 4.5  # robust sigmas: one good sample in 150 000 is taken for an outlier


def without_outliers(x: ArrayLike, seed: int = 0) -> tuple[FloatArray, BoolArray]:
    """Signal with its outliers replaced by the local median plus noise of the local spread.

    Parameters
    ----------
    x : array_like, shape (n,)
        Missing samples (NaN) stay missing.
    seed : int
        Of the noise put in.

    Returns
    -------
    repaired : ndarray, shape (n,)
    outlier : ndarray of bool, shape (n,)
        Which samples were replaced.

    Notes
    -----
    Leaving the samples out instead would leave hardly a long cluster complete; putting in the bare median would take
    white noise away. The spread is the median absolute deviation from the local median over the whole signal, which up
    to half of the samples cannot move much.
    """
    from scipy.ndimage import median_filter

    x = np.asarray(x, dtype=np.float64)
    if x.ndim != 1:
        raise InputError(f"x: expected one signal, got shape {x.shape}")
    present = np.isfinite(x)
    filled = np.where(present, x, np.median(x[present]) if present.any() else 0.0)
    level = median_filter(filled, size=_WINDOW, mode="nearest")
    residual = np.where(present, filled - level, 0.0)
    spread = 1.4826 * float(np.median(np.abs(residual[present]))) if present.any() else 0.0
    outlier = present & (np.abs(residual) > _LIMIT * spread) if spread > 0.0 else np.zeros(len(x), dtype=bool)
    repaired = x.copy()
    count = int(outlier.sum())
    repaired[outlier] = level[outlier] + spread * np.random.default_rng(seed).standard_normal(count)
    return repaired, outlier
