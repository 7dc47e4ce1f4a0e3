"""Arguments of the noise processes: what is accepted, and as what."""

from __future__ import annotations

from math import isfinite
from typing import Literal, TypeAlias

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.exceptions import InputError

#: How many samples: a number, or a shape (n, axes).
Shape: TypeAlias = int | tuple[int, ...]
Start: TypeAlias = Literal["stationary", "zero"]


def array(value: ArrayLike) -> FloatArray:
    return np.asarray(value, dtype=np.float64)  # unlike as_floats keeps a scalar a scalar


def shape_of(n: Shape) -> tuple[int, ...]:
    shape = n if isinstance(n, tuple) else (n,)
    if not shape or not all(isinstance(k, (int, np.integer)) and k >= 0 for k in shape):
        raise InputError(f"n: expected a number of samples or a shape (n, axes), got {n!r}")
    return shape


def count(value: int, name: str) -> int:
    if not (np.ndim(value) == 0 and value == int(value) and value >= 1):
        raise InputError(f"{name}: expected a whole number of samples, at least 1, got {value!r}")
    return int(value)


def counts(m: ArrayLike) -> FloatArray:
    out = np.asarray(m, dtype=np.float64)
    if not ((out >= 1.0) & (out == np.floor(out))).all():
        raise InputError(f"m: expected whole numbers of samples, at least 1, got {m!r}")
    return out


def times(tau: ArrayLike, name: str = "tau") -> FloatArray:
    """Averaging times."""
    out = array(tau)
    if not ((out > 0.0) & (out < np.inf)).all():
        raise InputError(f"{name}: expected positive finite times in seconds, got {tau!r}")
    return out


def frequencies(f: ArrayLike) -> FloatArray:
    out = array(f)
    if not np.isfinite(out).all():
        raise InputError(f"f: expected finite frequencies in Hz, got {f!r}")
    return out


def over(power: float, x: FloatArray) -> FloatArray:
    """``power / x``: infinite where x is zero, but zero everywhere for no power at all, where 0/0 would be NaN."""
    with np.errstate(divide="ignore"):
        return np.asarray(power / x) if power else np.zeros_like(x)


def since_start(t: ArrayLike) -> FloatArray:
    out = array(t)
    if not ((out >= 0.0) & (out < np.inf)).all():
        raise InputError(f"t: expected finite times in seconds since the start, not negative, got {t!r}")
    return out


def positive(value: float, name: str) -> float:
    if not (np.ndim(value) == 0 and isfinite(value) and value > 0.0):
        raise InputError(f"{name}: expected one positive finite number, got {value!r}")
    return float(value)


def magnitude(value: float, name: str) -> float:
    if not (np.ndim(value) == 0 and isfinite(value) and value >= 0.0):
        raise InputError(f"{name}: expected one finite number, not negative, got {value!r}")
    return float(value)
