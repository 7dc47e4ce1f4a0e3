"""An error budget as a TOML file: written by noise identification, read by the simulator and by navigation."""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from schuler.exceptions import ConfigError, FileFormatError, InputError
from schuler.files import read_toml, write_text
from schuler.sensors.sheets import ACCEL_UNITS, GYRO_UNITS
from schuler.sensors.spec import ImuSpec, TriadSpec

FORMAT = "schuler-imu-spec"
VERSION = 1
AXES = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")

_UNITS = {"gyro": GYRO_UNITS, "accel": ACCEL_UNITS}
_FIELDS = tuple(f.name for f in fields(TriadSpec))
_ROOT = ("format", "version", "name", "source", "rate_hz", "gyro", "accel", "uncertainty", "axes", "provenance")
_HEAD = """\
# Error budget of an IMU. Numbers are SI and 1 sigma, noise densities two-sided (docs/sensors.md); the comment behind
# each has its unit and the same in the units of data sheets. Only [gyro] and [accel] are used by simulator and filter.
"""


@dataclass(frozen=True)
class SpecFile:
    """Everything such a file holds.

    Attributes
    ----------
    spec : ImuSpec
        What simulator and filter use.
    sigma : dict of str to dict of str to float
        Relative 1-sigma uncertainty of entries of ``spec``: ``{"gyro": {"random_walk": 0.01}}``.
    axes : dict of str to dict
        Terms of single axes: names of :class:`TriadSpec`, and ``gauss_markov``, a list of [sigma, tau in s].
    provenance : dict
        What the numbers were made from.
    """

    spec: ImuSpec
    sigma: dict[str, dict[str, float]] = field(default_factory=dict)
    axes: dict[str, dict[str, Any]] = field(default_factory=dict)
    provenance: dict[str, Any] = field(default_factory=dict)


def write_spec(
    path: Path | str,
    spec: ImuSpec,
    sigma: Mapping[str, Mapping[str, float]] | None = None,
    axes: Mapping[str, Mapping[str, Any]] | None = None,
    provenance: Mapping[str, Any] | None = None,
) -> Path:
    """Write an error budget as a TOML file.

    Parameters
    ----------
    path : Path or str
        Replaced only when everything is written.
    spec : ImuSpec
    sigma : mapping, optional
        Relative 1-sigma uncertainty of entries: ``{"gyro": {"random_walk": 0.01}, "accel": {...}}``; infinite is
        allowed. [-]
    axes : mapping, optional
        Terms of single axes, for the reader: ``{"gyro_x": {"random_walk": 1e-4, "gauss_markov": [[1e-5, 300.0]]}}``. SI
    provenance : mapping, optional
        Anything TOML can hold.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        If ``sigma`` or ``axes`` have names that are unknown, or values that are no numbers.

    Notes
    -----
    Numbers are written with as many digits as they need to be read back unchanged.
    """
    return write_text(path, spec_text(spec, sigma, axes, provenance))


def spec_text(
    spec: ImuSpec,
    sigma: Mapping[str, Mapping[str, float]] | None = None,
    axes: Mapping[str, Mapping[str, Any]] | None = None,
    provenance: Mapping[str, Any] | None = None,
) -> str:
    """The text :func:`write_spec` writes; the same input gives the same text."""
    _check_sigma(sigma or {})
    _check_axes(axes or {})
    lines = [_HEAD + f"format = {_toml(FORMAT)}", f"version = {VERSION}", f"name = {_toml(spec.name)}"]
    if spec.source:
        lines.append(f"source = {_toml(spec.source)}")
    if spec.rate_hz is not None:
        lines.append(f"rate_hz = {float(spec.rate_hz)!r}  # Hz")
    for sensor, triad in (("gyro", spec.gyro), ("accel", spec.accel)):
        lines += ["", f"[{sensor}]", *_numbers(sensor, triad.to_dict())]
    for sensor, values in (sigma or {}).items():
        lines += ["", f"[uncertainty.{sensor}]  # relative, 1 sigma"]
        lines += [f"{name} = {float(value)!r}  # {100.0 * value:.3g} %" for name, value in values.items()]
    for axis, values in (axes or {}).items():
        lines += ["", f"[axes.{axis}]", *_numbers(axis.split("_")[0], values)]
    if provenance:
        lines += ["", "[provenance]", *(f"{_key(k)} = {_toml(v)}" for k, v in provenance.items())]
    return "\n".join(lines) + "\n"


def read_spec(path: Path | str) -> ImuSpec:
    """Error budget of a file that :func:`write_spec` wrote or a person did; see :func:`read_spec_file`."""
    return read_spec_file(path).spec


def read_spec_file(path: Path | str) -> SpecFile:
    """Read an error budget with its uncertainty, single axes and provenance.

    Parameters
    ----------
    path : Path or str

    Returns
    -------
    SpecFile

    Raises
    ------
    FileFormatError
        If the file is missing, no TOML, of another kind or a later version, or has entries that are unknown (the
        message has the nearest known name), missing or impossible.
    """
    path = Path(path)
    data = read_toml(path, missing="no such file; expected an IMU specification (docs/noise-exports.md)")
    try:
        return _parsed(data)
    except InputError as error:
        raise FileFormatError(str(error), path) from None


def anchored(data: dict[str, Any], path: Path | str) -> dict[str, Any]:
    """Configuration data whose ``imu.spec``, if it has one, is relative to the file it was read from.

    Parameters
    ----------
    data : dict
        A scenario or a navigation configuration; not changed.
    path : Path or str
        The TOML file ``data`` was read from.
    """
    imu = data.get("imu")
    if not isinstance(imu, dict) or not isinstance(imu.get("spec"), str):
        return data
    return {**data, "imu": {**imu, "spec": str(Path(path).resolve().parent / imu["spec"])}}


def configured_spec(path: str) -> ImuSpec:
    """Error budget of the file an ``imu.spec`` entry names; what is wrong with it is a :class:`ConfigError`."""
    try:
        return read_spec(path)
    except FileFormatError as error:
        raise ConfigError(f"imu.spec: {error}") from None


def _parsed(data: dict[str, Any]) -> SpecFile:
    if data.get("format") != FORMAT:
        raise InputError(f"expected format = {FORMAT!r} at the top of an IMU specification, got {data.get('format')!r}")
    version = data.get("version")
    if version != VERSION or isinstance(version, bool):
        raise InputError(f"expected version = {VERSION}, got {version!r}; a later version needs a later schuler")
    _check_names(data, _ROOT, "the file")
    for key in ("name", "gyro", "accel"):
        if key not in data:
            raise InputError(f"expected the entry {key!r}, got {', '.join(data)}")
    triads = {}
    for sensor in ("gyro", "accel"):
        table = _table(data[sensor], f"[{sensor}]")
        try:
            triads[sensor] = TriadSpec.from_dict(table)
        except InputError as error:
            raise InputError(f"[{sensor}]: {error}") from None
    for key in ("name", "source"):
        if not isinstance(data.get(key, ""), str):
            raise InputError(f"{key}: expected text in quotes, got {data[key]!r}")
    rate_hz = None if data.get("rate_hz") is None else _number(data["rate_hz"], "rate_hz")
    spec = ImuSpec(data["name"], triads["gyro"], triads["accel"], rate_hz, data.get("source", ""))
    sigma = {k: dict(_table(v, f"[uncertainty.{k}]")) for k, v in _table(data.get("uncertainty", {})).items()}
    axes = {k: dict(_table(v, f"[axes.{k}]")) for k, v in _table(data.get("axes", {})).items()}
    _check_sigma(sigma)
    _check_axes(axes)
    return SpecFile(spec, sigma, axes, _table(data.get("provenance", {}), "[provenance]"))


def _check_sigma(sigma: Mapping[str, Mapping[str, float]]) -> None:
    _check_names(sigma, ("gyro", "accel"), "uncertainty")
    for sensor, values in sigma.items():
        _check_names(values, _FIELDS, f"[uncertainty.{sensor}]")
        for name, value in values.items():
            if value != float("inf"):  # not determined at all
                _number(value, f"[uncertainty.{sensor}] {name}")


def _check_axes(axes: Mapping[str, Mapping[str, Any]]) -> None:
    _check_names(axes, AXES, "axes")
    for axis, values in axes.items():
        _check_names(values, (*_FIELDS, "gauss_markov"), f"[axes.{axis}]")
        for name, value in values.items():
            if name != "gauss_markov":
                _number(value, f"[axes.{axis}] {name}")
                continue
            pairs = value if isinstance(value, list | tuple) else [()]
            if not all(isinstance(pair, list | tuple) and len(pair) == 2 for pair in pairs):
                raise InputError(f"[axes.{axis}] gauss_markov: expected a list of [sigma, tau in s], got {value!r}")
            for pair in pairs:
                for number in pair:
                    _number(number, f"[axes.{axis}] gauss_markov")


def _check_names(data: Mapping[str, Any], entries: Iterable[str], where: str) -> None:
    names = list(entries)
    for key in data:
        if key not in names:
            near = difflib.get_close_matches(str(key), names, n=1, cutoff=0.5)
            hint = f"did you mean {near[0]}?" if near else "known are " + ", ".join(names)
            raise InputError(f"{where}: unknown entry {key!r}; {hint}")


def _table(value: Any, where: str = "the file") -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError(f"{where}: expected a table, got {value!r}")
    return value


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < float("inf"):
        raise InputError(f"{where}: expected a finite number, not negative, got {value!r}")
    return float(value)


def _numbers(sensor: str, values: Mapping[str, Any]) -> list[str]:
    """Lines of a table of terms: the number, what it is, its unit, and the same as data sheets have it."""
    lines = []
    for name, value in values.items():
        if name == "gauss_markov":
            pairs = ", ".join(f"[{float(sigma)!r}, {float(tau)!r}]" for sigma, tau in value)
            lines.append(f"gauss_markov = [{pairs}]  # [sigma, correlation time in s] of each process")
            continue
        label, si, sheet, factor = _UNITS[sensor][name]
        same = "" if sheet == si else f" = {value / factor:.6g} {sheet}"
        lines.append(f"{name} = {float(value)!r}  # {label.strip()}{f' [{si}]' if si else ''}{same}")
    return lines


def _key(name: object) -> str:
    text = str(name)
    return text if re.fullmatch(r"[A-Za-z0-9_-]+", text) else _toml(text)


def _toml(value: Any) -> str:
    """A value as TOML; what TOML cannot hold is written as text."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(float(value) if isinstance(value, float) else value)  # a NumPy float has another repr
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_key(k)} = {_toml(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_toml(v) for v in value) + "]"
    # JSON's escapes are TOML's but for DEL, which TOML wants escaped
    return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")
