"""A calibration as a YAML file: complete, readable, the same numbers when it is read back."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from schuler.calibration.result.parameters import GAUGES, unit
from schuler.calibration.result.result import CalibrationResult, Residuals
from schuler.calibration.result.result_entries import FORMAT, RESIDUALS, VERSION, parsed_result
from schuler.calibration.result.sheet import sheet, shown
from schuler.exceptions import FileFormatError, InputError
from schuler.files import note_input, write_text

_HEAD = """\
# Calibration of an IMU. Errors are added to the truth, numbers are SI, 1 sigma (docs/calibration.md):
#   f_meas = b_a + (I + M_a) f,  omega_meas = b_g + (I + M_g) omega + G_g f
# The comment behind a parameter has its meaning, unit, and value with 1 sigma as data sheets have it.
"""


def write_result(result: CalibrationResult, path: Path | str) -> Path:
    """Write a calibration as a YAML file.

    Parameters
    ----------
    result : CalibrationResult
    path : Path or str
        Replaced only when everything is written.

    Returns
    -------
    Path
        Of the file.

    Raises
    ------
    InputError
        If ``extra`` or ``provenance`` hold anything but numbers, text, lists and tables of them.

    Notes
    -----
    Numbers are written with as many digits as they need to be read back unchanged. Arrays and tuples in ``extra`` and
    ``provenance`` come back as lists. Uncertainties stand in comments; what counts is the covariance, of which the
    file has the lower triangle.
    """
    return write_text(path, result_text(result))


def result_text(result: CalibrationResult) -> str:
    """The text :func:`write_result` writes; the same result gives the same text."""
    lines = [
        _HEAD + f"format: {FORMAT}",
        f"version: {VERSION}",
        *_block("method", result.method),
        *_block("status", result.status),
        *_block("gauge", result.gauge),
        *_block("gauge_in_words", GAUGES[result.gauge]),
    ]
    if result.temperature is not None:
        lines.append(f"temperature: {_number(result.temperature)}  # degC")
    accel, gyro = result.nominal
    lines.append(f"nominal: {{accel: {_number(accel)}, gyro: {_number(gyro)}}}  # SI units in a unit of the log")
    sigma = dict(zip(result.names, result.sigma.tolist(), strict=True))
    values = zip(result.names, result.values.tolist(), strict=True)
    lines += _table("parameters", [(n, v, _comment(n, v, sigma[n])) for n, v in values])
    if result.fixed:
        lines += _table("fixed", [(n, v, _comment(n, v, 0.0)) for n, v in result.fixed.items()])
    lines.append("covariance:" + (" []" if not result.names else "  # lower triangle, in the order of the parameters"))
    for i, row in enumerate(result.covariance.tolist()):
        lines.append(f"- [{', '.join(_number(v) for v in row[: i + 1])}]  # {result.names[i]}")
    lines += [
        f"condition: {_number(result.condition)}",
        f"variance_of_unit_weight: {_number(result.variance_of_unit_weight)}",
        f"freedom: {int(result.freedom)}",
        *_block("verdicts", list(result.verdicts)),
    ]
    if result.next_pose:
        lines += _block("next_pose", result.next_pose)
    if result.prior_sigma:
        determined = [
            (n, s, f"[{unit(n)}] = {s / sheet(n).factor:.4g} {sheet(n).unit}") for n, s in result.prior_sigma.items()
        ]
        lines += ["# 1 sigma before the calibration", *_table("prior_sigma", determined)]
    if result.residuals:
        lines += ["# what is left per pose or turn, 1 sigma that was expected, the same before the calibration"]
        lines += _block("residuals", {name: _residuals(r) for name, r in result.residuals.items()})
    if result.history is not None:
        lines += ["# parameters by iteration", *_block("history", np.asarray(result.history).tolist())]
    for name in ("extra", "provenance"):
        content = getattr(result, name)
        if content:
            lines += _block(name, _plain(content, name))
    return "\n".join(lines) + "\n"


def read_result(path: Path | str) -> CalibrationResult:
    """Read a calibration that :func:`write_result` wrote or a person did.

    Parameters
    ----------
    path : Path or str

    Returns
    -------
    CalibrationResult

    Raises
    ------
    FileFormatError
        If the file is missing, no YAML, of another kind or a later version, or has entries that are unknown (the
        message has the nearest known name), missing or impossible.
    """
    path = Path(path)
    note_input(path)
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise FileFormatError("no such file; expected a calibration (docs/calibration.md)", path) from None
    except OSError as error:
        raise FileFormatError(f"cannot be read: {error.strerror}", path) from None
    except UnicodeDecodeError as error:
        raise FileFormatError(f"expected UTF-8 text, got {error.reason} at byte {error.start}", path) from None
    data = _loaded(text, path)
    try:
        return parsed_result(data)
    except InputError as error:
        raise FileFormatError(str(error), path) from None


def _loaded(text: str, path: Path) -> Any:
    import yaml

    class Loader(yaml.SafeLoader):  # type: ignore[misc]
        """Plain data only, and no name twice: plain YAML would silently take the last."""

    def mapping(loader: Any, node: Any) -> dict[Any, Any]:
        seen = set()
        for key, _ in node.value:
            if not isinstance(key.value, str):
                raise FileFormatError("expected a name before the colon", path, _line(key.start_mark))
            if key.value in seen:
                raise FileFormatError(
                    f"the entry {key.value!r} is there twice; remove one", path, _line(key.start_mark)
                )
            seen.add(key.value)
        result: dict[Any, Any] = yaml.SafeLoader.construct_mapping(loader, node, deep=True)
        return result

    Loader.add_constructor("tag:yaml.org,2002:map", mapping)
    try:
        return yaml.load(text, Loader)  # noqa: S506  # a safe loader
    except yaml.YAMLError as error:
        problem = getattr(error, "problem", None) or str(error).splitlines()[0]
        raise FileFormatError(
            f"not a YAML file: {problem}; expected a calibration as schuler calibrate writes it",
            path,
            _line(getattr(error, "problem_mark", None)),
        ) from None
    except RecursionError:
        raise FileFormatError("not a calibration: its entries are nested too deeply", path) from None
    except ValueError as error:  # of dates that do not exist, of numbers of thousands of digits
        raise FileFormatError(f"not a YAML file: {error}", path) from None


def _line(mark: Any) -> int | None:
    return None if mark is None else int(mark.line) + 1


def _residuals(r: Residuals) -> dict[str, Any]:
    columns = {key: getattr(r, key) for key in RESIDUALS}
    return {key: _plain(value, key) for key, value in columns.items() if value is not None}


def _comment(name: str, value: float, sigma: float) -> str:
    s = sheet(name)
    return f"{s.meaning} [{s.si}], {shown(name, value, sigma)}"


def _table(name: str, rows: list[tuple[str, float, str]]) -> list[str]:
    return [
        f"{name}:" + ("" if rows else " {}"),
        *(f"  {key}: {_number(value)}  # {text}" for key, value, text in rows),
    ]


def _block(name: str, value: Any) -> list[str]:
    import yaml

    text: str = yaml.safe_dump({name: value}, sort_keys=False, allow_unicode=True, width=118, default_flow_style=None)
    if text.startswith("{"):  # a table of one entry would be put into braces
        text = yaml.safe_dump({name: value}, sort_keys=False, allow_unicode=True, width=118, default_flow_style=False)
    return [text.rstrip("\n")]


def _number(value: float) -> str:
    import yaml

    return str(yaml.representer.SafeRepresenter().represent_float(float(value)).value)


def _plain(value: Any, where: str) -> Any:
    """Numbers, text, lists and tables of them; anything else would not come back."""
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist(), where)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Mapping):
        return {str(k): _plain(v, f"{where}.{k}") for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v, where) for v in value]
    raise InputError(f"{where}: expected numbers, text, lists or tables, got {type(value).__name__}; convert it first")
