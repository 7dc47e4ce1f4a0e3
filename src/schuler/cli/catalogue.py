"""``schuler catalogue``."""

from __future__ import annotations

from typing import Any, Literal

from schuler.cli.output import Flag, print_json, say
from schuler.sensors import catalogue as sensors
from schuler.sensors.catalogue import Entry
from schuler.sensors.sheets import ACCEL_UNITS, GYRO_UNITS

_TRIADS: tuple[tuple[Literal["gyro", "accel"], str], ...] = (("gyro", "gyroscopes"), ("accel", "accelerometers"))


def catalogue(name: str | None = None, /, *, json: Flag = False) -> None:
    """List the IMUs of the catalogue, or show one: each value with its unit and page, unknown where unstated.

    Parameters
    ----------
    name
        Name, alias or part of a name; case, spaces, hyphens and underscores do not matter.
    json
        Print one JSON object instead of text.
    """
    chosen = sensors.names() if name is None else sensors.matches(name)
    exact = None
    if name is not None:
        # an entry of that very name is meant, also where longer names begin with it
        exact = sensors.entry(name if len(chosen) != 1 else chosen[0]) if _is_one(name, chosen) else None
    shown = chosen if exact is None else [exact.name]
    devices = [n for n in shown if sensors.entry(n).is_device]
    constructs = [n for n in shown if n not in devices]
    if json:
        entries = {n: described(sensors.entry(n)) for n in shown}
        print_json({"command": "catalogue", "devices": devices, "constructs": constructs, "entries": entries})
    elif exact is not None:
        print(text(exact))
        if others := [n for n in chosen if n != exact.name]:
            say(f"similar names: {', '.join(others)}")
    else:
        parts = (("devices", devices), ("grades, classes and sets of theses", constructs))
        print("\n\n".join(f"{title}\n\n{sensors.table(listed)}" for title, listed in parts if listed))


def _is_one(name: str, chosen: list[str]) -> bool:
    """Whether a name means one entry; with no match at all it does, and :func:`.entry` says what is near."""
    plain = {sensors.plain(alias) for n in chosen for alias in (n, *sensors.entry(n).aliases)}
    return len(chosen) < 2 or sensors.plain(name) in plain


def described(e: Entry) -> dict[str, Any]:
    """Entry as JSON has it."""
    return {
        "kind": e.kind, "device": e.is_device, "source": e.source, "notes": e.notes, "aliases": e.aliases,
        "rate_hz": e.rate_hz, **{which: _triad(e, which) for which, _ in _TRIADS}, "printed": dict(e.printed),
        "printed_pages": {key: e.pages.get(f"printed.{key}") for key in e.printed}, "unstated": e.unstated,
    }  # fmt: skip


def _triad(e: Entry, which: Literal["gyro", "accel"]) -> dict[str, Any] | None:
    if not (e.gyro if which == "gyro" else e.accel):
        return None
    si = sensors.triad(e.name, which)
    units = GYRO_UNITS if which == "gyro" else ACCEL_UNITS
    return {
        field: None
        if stated is None
        else {
            "label": units[field][0].strip(), "value": stated[0], "unit": stated[1], "si": getattr(si, field),
            "si_unit": units[field][1], "page": e.pages.get(f"{which}.{field}"),
        }
        for field, stated in sensors.quantities(e, which).items()
    }  # fmt: skip


def text(e: Entry) -> str:
    """Entry for the terminal: every quantity of the error budget, then what the source states besides."""
    lines = [
        f"{e.name}" + (f" (also {', '.join(e.aliases)})" if e.aliases else ""),
        f"{'device' if e.is_device else 'no device'}, kind {e.kind}",
        f"source: {e.source}",
        f"rate: {'unknown' if e.rate_hz is None else f'{e.rate_hz:g} Hz'}",
    ]
    for which, title in _TRIADS:
        if {"gyro": "accel", "accelerometer": "gyro"}.get(e.kind) == which:
            continue
        values = _triad(e, which)
        lines += ["", title + (": unknown" if values is None else "")]
        units = GYRO_UNITS if which == "gyro" else ACCEL_UNITS
        for field, value in (values or {}).items():
            stated = "unknown" if value is None else f"{value['value']:g} {value['unit']}".rstrip()
            page = (value or {}).get("page") or ""
            lines.append(f"  {units[field][0].strip():<32}{stated:<24}{page}".rstrip())
        density = (e.gyro if which == "gyro" else e.accel).get("density")
        lines += [f"  {'noise density taken as':<32}{density}"] if density else []
    if e.printed:
        lines += ["", "stated besides (each key names its unit)"]
        lines += [
            f"  {key:<44}{_plain(value):<24}{e.pages.get(f'printed.{key}', '')}".rstrip()
            for key, value in e.printed.items()
        ]
    if e.unstated:
        lines += [
            "",
            f"unknown, not zero: {', '.join(e.unstated)}; navigation takes turn-on biases typical of the class",
        ]
    if e.notes:
        lines += ["", e.notes]
    return "\n".join(lines)


def _plain(value: Any) -> str:
    return ", ".join(f"{v:g}" for v in value) if isinstance(value, list) else f"{value:g}"
