"""Entries of a calibration file, checked one by one."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.calibration.result.parameters import GAUGES, unit
from schuler.calibration.result.result import CalibrationResult, Residuals
from schuler.exceptions import InputError

FORMAT = "schuler-calibration"
VERSION = 1

_NEEDED = ("format", "version", "method", "gauge", "parameters", "covariance")
_KNOWN = (
    "format", "version", "method", "status", "gauge", "gauge_in_words", "temperature", "nominal", "parameters", "fixed",
    "covariance", "condition", "variance_of_unit_weight", "freedom", "verdicts", "next_pose", "prior_sigma",
    "residuals", "history", "extra", "provenance",
)  # fmt: skip
_STATUS = ("ok", "warning", "refused")
RESIDUALS = ("unit", "label", "value", "sigma", "before", "direction")


def parsed_result(data: Any) -> CalibrationResult:
    """A result from the entries of a file, see :func:`schuler.calibration.result.result_file.read_result`.

    Raises
    ------
    InputError
        If an entry is unknown, missing or impossible.
    """
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        came = repr(data.get("format")) if isinstance(data, dict) else "no table of entries"
        raise InputError(f"expected format: {FORMAT} at the top of a calibration, got {came}")
    if data.get("version") != VERSION or isinstance(data["version"], bool):
        raise InputError(
            f"expected version: {VERSION}, got {data.get('version')!r}; a later version needs a later schuler"
        )
    _check_names(data, _KNOWN, "the file")
    for key in _NEEDED:
        if key not in data:
            raise InputError(f"expected the entry {key!r}, got {', '.join(map(str, data))}")
    parameters, fixed = (_numbers(data.get(key) or {}, key) for key in ("parameters", "fixed"))
    nominal = _given(data, "nominal", dict, {"accel": 1.0, "gyro": 1.0})
    _check_names(nominal, ("accel", "gyro"), "nominal")
    factors = [_number_of(nominal.get(name, 1.0), f"nominal {name}") for name in ("accel", "gyro")]
    if min(factors) <= 0.0:
        raise InputError(f"nominal: expected positive factors, got {factors}")
    freedom = data.get("freedom", 0)
    if isinstance(freedom, bool) or not isinstance(freedom, int) or freedom < 0:
        raise InputError(f"freedom: expected a number of degrees of freedom, 0 or more, got {freedom!r}")
    temperature, history = data.get("temperature"), data.get("history")
    verdicts = _given(data, "verdicts", list, [])
    return CalibrationResult(
        method=_given(data, "method", str, ""),
        names=tuple(parameters),
        values=np.array(list(parameters.values())),
        covariance=_covariance(data["covariance"], list(parameters)),
        gauge=_one_of(data["gauge"], GAUGES, "gauge"),
        fixed=fixed,
        nominal=(factors[0], factors[1]),
        status=_one_of(data.get("status", "ok"), _STATUS, "status"),
        verdicts=tuple(str(v) for v in verdicts),
        condition=_number_of(data.get("condition", np.nan), "condition", finite=False),
        prior_sigma=_numbers(data.get("prior_sigma") or {}, "prior_sigma", finite=False),
        variance_of_unit_weight=_number_of(
            data.get("variance_of_unit_weight", np.nan), "variance_of_unit_weight", finite=False
        ),
        freedom=freedom,
        residuals={str(k): _read_residuals(v, k) for k, v in _given(data, "residuals", dict, {}).items()},
        next_pose=_given(data, "next_pose", str, ""),
        temperature=None if temperature is None else _number_of(temperature, "temperature"),
        history=None if history is None else _array(history, "history", (None, len(parameters))),
        extra=_given(data, "extra", dict, {}),
        provenance=_given(data, "provenance", dict, {}),
    )  # fmt: skip


def _covariance(rows: Any, names: list[str]) -> FloatArray:
    p = len(names)
    if not isinstance(rows, list) or [len(r) if isinstance(r, list) else -1 for r in rows] != list(range(1, p + 1)):
        raise InputError(
            f"covariance: expected the lower triangle, rows of 1 to {p} numbers in the order of the {p} parameters; "
            "a row and a column go with each parameter that is added or removed"
        )
    C = np.zeros((p, p))
    for i, row in enumerate(rows):
        numbers = [_number_of(v, f"covariance, row of {names[i]}", finite=False) for v in row]
        C[i, : i + 1] = C[: i + 1, i] = numbers
    allowed = np.isfinite(np.diag(C))
    if np.isnan(C).any() or (np.diag(C) < 0.0).any():
        i = int(np.argmax((np.diag(C) < 0.0) | np.isnan(C).any(axis=1)))
        raise InputError(
            f"covariance: expected numbers and no negative variance, got {C[i, : i + 1].tolist()} for {names[i]}"
        )
    part = C[np.ix_(allowed, allowed)]
    s = np.sqrt(np.where(np.diag(part) > 0.0, np.diag(part), 1.0))
    if len(part) and np.linalg.eigvalsh(part / np.outer(s, s)).min() < -1e-6:
        raise InputError("covariance: expected a covariance, got correlations beyond 1; a number was changed by hand")
    return C


def _read_residuals(data: Any, name: str) -> Residuals:
    where = f"residuals {name}"
    if not isinstance(data, dict):
        raise InputError(f"{where}: expected a table with {', '.join(RESIDUALS)}, got {data!r}")
    _check_names(data, RESIDUALS, where)
    for key in RESIDUALS[:4]:
        if key not in data:
            raise InputError(f"{where}: expected the entry {key!r}, got {', '.join(map(str, data))}")
    label = tuple(str(v) for v in data["label"]) if isinstance(data["label"], list) else ()
    n = len(label)
    columns = {}
    for key, shape in (("value", (n,)), ("sigma", (n,)), ("before", (n,)), ("direction", (n, 3))):
        given = data.get(key)
        columns[key] = None if given is None else _array(given, f"{where} {key}", shape)
    return Residuals(label=label, unit=str(data["unit"]), **columns)  # type: ignore[arg-type]


def _array(value: Any, where: str, shape: tuple[int | None, ...]) -> FloatArray:
    try:
        array = np.array(value, dtype=np.float64)  # text such as 1e-5, which YAML takes for a word, is a number too
    except (TypeError, ValueError):
        raise InputError(f"{where}: expected lists of numbers, got {str(value)[:60]}") from None
    if array.size == 0:
        array = array.reshape([0 if s is None else s for s in shape])
    if array.ndim != len(shape) or any(s is not None and s != n for s, n in zip(shape, array.shape, strict=True)):
        expected = " x ".join("any number" if s is None else str(s) for s in shape)
        raise InputError(f"{where}: expected {expected} numbers, got {' x '.join(map(str, array.shape))}")
    return array


def _check_names(data: Mapping[Any, Any], allowed: Iterable[str], where: str) -> None:
    names = list(allowed)
    for key in data:
        if key not in names:
            near = difflib.get_close_matches(str(key), names, n=1, cutoff=0.5)
            hint = f"did you mean {near[0]}?" if near else "known are " + ", ".join(names)
            raise InputError(f"{where}: unknown entry {key!r}; {hint}")


def _numbers(data: Any, where: str, *, finite: bool = True) -> dict[str, float]:
    if not isinstance(data, dict):
        raise InputError(f"{where}: expected a table of names and numbers, got {data!r}")
    values = {}
    for name, value in data.items():
        try:
            unit(str(name))
        except InputError as error:
            raise InputError(f"{where}: {error}") from None
        values[str(name)] = _number_of(value, f"{where} {name}", finite=finite)
    return values


def _number_of(value: Any, where: str, *, finite: bool = True) -> float:
    """A number; YAML 1.1 takes 1e-5, without a point, for a word."""
    try:
        if isinstance(value, bool):
            raise ValueError
        number = float(value)
    except (TypeError, ValueError):
        raise InputError(f"{where}: expected a number, got {value!r}") from None
    if finite and not np.isfinite(number):
        raise InputError(f"{where}: expected a finite number, got {value!r}")
    return number


def _one_of(value: Any, allowed: Iterable[str], where: str) -> Any:
    if value not in list(allowed):
        raise InputError(f"{where}: expected one of {', '.join(allowed)}, got {value!r}")
    return value


def _given(data: Mapping[str, Any], key: str, kind: type, default: Any) -> Any:
    value = data.get(key, default)
    if not isinstance(value, kind):
        word = "text" if kind is str else "a table" if kind is dict else "a list"
        raise InputError(f"{key}: expected {word}, got {value!r}")
    return value
