"""What a campaign is of: a fingerprint of its function and its scenario, so that a store is not filled from two."""

from __future__ import annotations

import enum
import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from schuler.exceptions import InputError
from schuler.files import sha256

_LONG = 64  # arrays of more elements stand in the plain form with a digest of their bytes


def plain(value: Any, where: str = "scenario") -> Any:
    """A value as JSON can hold it, the same for equal values and different for others.

    Parameters
    ----------
    value : object
        Numbers, texts, dates and paths, None, arrays, dictionaries, lists, tuples, sets, dataclasses, enumerations,
        pydantic models, importable functions and ``functools.partial`` of them; of an existing file named by a ``Path``
        the contents count, not the place. An object with a method ``fingerprint()`` is what that returns.
    where : str
        Named in the error.

    Raises
    ------
    InputError
        For an object of which it cannot be told what it holds, and for numbers that are not.
    """
    if hasattr(value, "fingerprint") and not isinstance(value, type):
        return {"type": _name(type(value)), "is": plain(value.fingerprint(), where)}
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, enum.Enum):
        return {"type": _name(type(value)), "is": value.name}
    if isinstance(value, float):
        if math.isnan(value):
            raise InputError(f"{where} is not a number (NaN)")
        return value if math.isfinite(value) else {"number": repr(value)}
    if isinstance(value, (np.ndarray, np.generic)):
        return _array(np.asarray(value), where)
    if isinstance(value, Path):
        return {"file": sha256(value)} if value.is_file() else {"path": str(value)}
    if isinstance(value, Mapping):
        return _mapping(value, where)
    if isinstance(value, (list, tuple)):
        return [plain(v, f"{where}[{k}]") for k, v in enumerate(value)]
    if isinstance(value, (set, frozenset)):
        return sorted((plain(v, where) for v in value), key=lambda v: json.dumps(v, sort_keys=True))
    if hasattr(value, "isoformat"):
        return {"time": value.isoformat()}
    return _object(value, where)


def _mapping(value: Mapping[Any, Any], where: str) -> Any:
    if all(isinstance(k, str) for k in value):
        return {k: plain(v, f"{where}.{k}") for k, v in value.items()}
    return {"pairs": [[plain(k, where), plain(v, f"{where}[{k!r}]")] for k, v in value.items()]}


def _object(value: Any, where: str) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        held = {f.name: plain(getattr(value, f.name), f"{where}.{f.name}") for f in fields(value)}
        return {"type": _name(type(value)), **held}
    if hasattr(value, "model_dump"):
        return {"type": _name(type(value)), "is": plain(value.model_dump(mode="json"), where)}
    if hasattr(value, "func") and hasattr(value, "keywords"):
        return {"call": plain(value.func, where), "with": [plain(value.args, where), plain(value.keywords, where)]}
    name = getattr(value, "__qualname__", "")
    if callable(value) and name and "<" not in name and not hasattr(value, "__self__"):
        return {"function": _name(value)}
    raise InputError(
        f"{where}: cannot tell what is in {_name(type(value))} {value!r:.60}; give numbers, texts, arrays, "
        "dictionaries, dataclasses or functions of a module, or an object with a method fingerprint() that returns such"
    )


def fingerprint(value: Any, where: str = "scenario") -> str:
    """SHA-256 of :func:`plain`, hexadecimal."""
    text = json.dumps(plain(value, where), sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _array(x: np.ndarray[Any, Any], where: str) -> Any:
    if x.dtype.hasobject:
        raise InputError(f"{where}: an array of objects; give one of numbers")
    if x.ndim == 0 and x.dtype.kind in "biufU":
        return plain(x.item(), where)
    if x.size <= _LONG and x.dtype.kind in "biu":
        return {"array": x.tolist(), "dtype": x.dtype.name}
    data = np.ascontiguousarray(x.astype(x.dtype.newbyteorder("<"))).tobytes()
    return {"array": hashlib.sha256(data).hexdigest(), "dtype": x.dtype.name, "shape": list(x.shape)}


def _name(thing: Any) -> str:
    return f"{thing.__module__}.{thing.__qualname__}"
