"""Configuration of a navigation with what the options of ``navigate`` and ``compare`` say instead."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from schuler.exceptions import InputError
from schuler.toml import parsed_toml

if TYPE_CHECKING:
    from schuler.navigation.config import NavigationConfig


def configuration(
    config: Path, changes: Sequence[tuple[str, Any]], outage: Sequence[str], outage_every: str | None
) -> NavigationConfig:
    """The configuration of a file with changed entries and with the outages of ``--outage`` and ``--outage-every``."""
    from schuler.navigation.config import NavigationConfig

    return with_outages(NavigationConfig.load(config, changes, "--set"), outage, outage_every)


def with_outages(config: NavigationConfig, outage: Sequence[str], outage_every: str | None) -> NavigationConfig:
    """The configuration with the outages of ``--outage`` and ``--outage-every``."""
    section = config.outages
    if outage_every is not None:
        section = type(section).model_validate({**section.model_dump(exclude_none=True), **period(outage_every)})
    windows = (*section.windows_s, *(window(text) for text in outage))
    return config.model_copy(update={"outages": section.model_copy(update={"windows_s": windows})})


def window(text: str) -> tuple[float, float]:
    """``START:STOP`` in seconds."""
    numbers = _numbers(text)
    if len(numbers) != 2 or not numbers[1] > numbers[0] or not all(map(math.isfinite, numbers)):
        raise InputError(f"--outage: expected START:STOP in seconds, such as 50:90, got {text!r}")
    return numbers[0], numbers[1]


def period(text: str) -> dict[str, float]:
    """``PERIOD:LENGTH`` or ``PERIOD:LENGTH:FIRST`` in seconds, as entries of the outage section."""
    numbers = _numbers(text)
    if len(numbers) not in (2, 3) or not 0.0 < numbers[1] < numbers[0] or not all(map(math.isfinite, numbers)):
        raise InputError(
            f"--outage-every: expected PERIOD:LENGTH or PERIOD:LENGTH:FIRST in seconds, such as 45:15, got {text!r}"
        )
    return dict(zip(("every_s", "length_s", "first_s"), numbers, strict=False))


def entries(texts: tuple[str, ...], *, sections: bool = True) -> list[tuple[str, Any]]:
    """``SECTION.KEY=VALUE`` with the value in TOML's spelling; what is no TOML is taken as a string.

    Parameters
    ----------
    texts : tuple of str
    sections : bool
        Every entry is one of a section; else ``KEY=VALUE`` is one too.
    """
    pairs = []
    for text in texts:
        key, sign, value = text.partition("=")
        parts = key.strip().split(".")
        if not sign or (sections and len(parts) < 2) or len(parts) > 20 or not all(parts):
            expected = "such as filter.states=21" if sections else "such as gnss.outages_s=[[60,90]], or KEY=VALUE"
            raise InputError(f"--set: expected SECTION.KEY=VALUE, {expected}, got {text!r}")
        try:
            pairs.append((key.strip(), parsed_toml(f"x = {value}")["x"]))
        except tomllib.TOMLDecodeError:
            pairs.append((key.strip(), value.strip()))
        except ValueError as error:
            raise InputError(f"--set {key.strip()}: expected a value as in a configuration: {error}") from None
    return pairs


def check_entries(changes: Sequence[tuple[str, Any]]) -> None:
    """Refuse entries of ``--set`` that no configuration has, before a file is read.

    Parameters
    ----------
    changes : sequence of (str, value)
        See :func:`entries`.

    Raises
    ------
    InputError
        Naming the entry, and the nearest that there is.
    """
    from schuler.navigation.config import NavigationConfig
    from schuler.navigation.sections import change_entry
    from schuler.sensors import catalogue

    data: dict[str, Any] = {}
    for name, value in changes:
        first, *parts = name.split(".")
        if first == "recording" and value is not None:
            _check_hint(name, parts, value)
        elif first != "recording":
            change_entry(data, name, value)
    imu = data.get("imu")
    if isinstance(imu, dict):
        if isinstance(imu.get("catalogue"), str):
            catalogue.entry(imu["catalogue"])
        if not imu.keys() & {"catalogue", "spec", "gyro", "accel"}:
            imu["catalogue"] = "consumer"
    NavigationConfig.parse({"imu": {"catalogue": "consumer"}} | data, "--set")


def _check_hint(name: str, parts: list[str], value: Any) -> None:
    """Refuse a hint on how a log is read that there is not, or whose value cannot be read."""
    from schuler.recording.io.columns import check_known
    from schuler.recording.io.hint_texts import SATELLITES, SERIES
    from schuler.recording.io.hints import ReadHints

    *sections, key = parts
    if len(sections) > 1:
        raise InputError(f"--set {name}: expected recording.KEY=VALUE or recording.PART.KEY=VALUE")
    if sections and sections[0] in ("streams", "scale"):  # a table of their own
        return
    hints, series = list(ReadHints.__dataclass_fields__), (*SERIES, *SATELLITES, "accel", "gyro")
    for part in sections:
        check_known(part, series, f"--set {name}")
    if not sections and key in series and not isinstance(value, dict):
        raise InputError(f"--set {name}={value}: expected a hint on that part, such as {name}.file={value}")
    if not sections and key in series:
        for hint, own in value.items():
            _check_hint(f"{name}.{hint}", [key, hint], own)
        return
    check_known(key, [*hints, "file"] if sections else hints, f"--set {name}")
    if key in ("file", "height", "geoid_separation"):  # the last two go together
        return
    try:
        ReadHints.of(**{key: value})
    except InputError as error:
        raise InputError(f"--set {name}={value}: {str(error).removeprefix(f'{key}: ')}") from None


def _numbers(text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(":")]
    except ValueError:
        return []
