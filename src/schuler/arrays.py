"""Array aliases and the shape checks shared by public functions."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from schuler.exceptions import InputError

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]
BoolArray: TypeAlias = npt.NDArray[np.bool_]
ArrayLike: TypeAlias = npt.ArrayLike
_BLOCK = 1 << 20  # values that are looked at at a time


def as_floats(value: ArrayLike, name: str, shape: tuple[int | None, ...] | None = None) -> FloatArray:
    """Contiguous float64 array of a given shape, all finite.

    Parameters
    ----------
    value : array_like
        Value the user passed.
    name : str
        Argument name for the message.
    shape : tuple of int or None, optional
        Expected shape; ``None`` stands for any length along that axis.

    Raises
    ------
    InputError
        If the value is not numeric, has another shape or contains NaN or infinity.
    """
    try:
        array = np.asarray(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name}: expected real numbers, got {_describe(value)}") from error
    if array.dtype.kind not in "fiub":
        raise InputError(f"{name}: expected real numbers, got {_describe(value)}")
    if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
        raise InputError(f"{name}: expected plain numbers, got a masked array; fill or cut what is masked")
    array = np.asarray(array, dtype=np.float64, order="C")
    if shape is not None and not _fits(array.shape, shape):
        expected = "(" + ", ".join("n" if s is None else str(s) for s in shape) + ("," if len(shape) == 1 else "") + ")"
        raise InputError(f"{name}: expected shape {expected}, got {array.shape}")
    if not _finite(array):
        rows = np.atleast_1d(array)
        bad = int(np.flatnonzero(~np.isfinite(rows.reshape(len(rows), -1)).all(axis=1))[0])
        raise InputError(f"{name}: expected finite numbers, got NaN or infinity first at index {bad}; cut or fill it")
    return array


def as_vector3(value: ArrayLike, name: str) -> FloatArray:
    """Three finite numbers as a float64 array of shape (3,); see :func:`as_floats` for errors."""
    return as_floats(value, name, (3,))


def readonly(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """The same array with writing switched off, for the fields of frozen data classes."""
    array.setflags(write=False)
    return array


def _finite(array: FloatArray) -> bool:
    """Whether all values are finite, of a long array a part at a time."""
    values = array.reshape(-1)
    return all(bool(np.isfinite(values[k : k + _BLOCK]).all()) for k in range(0, values.size, _BLOCK))


def _fits(shape: tuple[int, ...], expected: tuple[int | None, ...]) -> bool:
    return len(shape) == len(expected) and all(w is None or s == w for s, w in zip(shape, expected, strict=True))


def _describe(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
