"""Satellite parts of a recording in our own files: one long table each, and the constants that go with them.

Ephemerides are one table too: Keplerian rows first, then GLONASS states; columns of the other kind are NaN, or 0 where
they are whole numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from types import MappingProxyType
from typing import Any

import numpy as np

from schuler.gnss.ephemerides import Ephemerides, GlonassRecords, KeplerRecords
from schuler.gnss.observations import Observations
from schuler.gnss.ranges import Ranges
from schuler.recording.recording import Recording

Columns = dict[str, np.ndarray[Any, np.dtype[Any]]]

#: Columns of whole numbers.
INTEGERS = frozenset({"sat", "signal", "group", "reason", "arc", "lock", "health", "issue", "source", "channel"})
#: Columns that files of earlier versions do not have.
LATER = frozenset({"lock", "carrier_range", "arc", "wavelength", "bands_apart", "a_dot", "delta_n_dot"})
_AXES = ("x", "y", "z")
_WIDTH = MappingProxyType({"group_delay": 2, "r_e": 3, "v_e": 3, "a_e": 3, "r_sat_e": 3, "v_sat_e": 3})
_PLACES = ("position_e", "station_e", "eccentricity_n")
_COEFFICIENTS = MappingProxyType(
    {"klobuchar_alpha": 4, "klobuchar_beta": 4, "galileo_ai": 3, "beidou_alpha": 4, "beidou_beta": 4}
)
_CONSTANTS = frozenset({"signals", "groups", "notes", "epoch_gps_s", "glonass_channels", "antenna", *_PLACES})
_UNIT_OF_FIELD = MappingProxyType(
    {
        **dict.fromkeys(("t", "toe", "toc", "sent", "af0", "group_delay"), "s"),
        "af2": "1/s",
        "sqrt_a": "m^0.5",
        **dict.fromkeys(("i0", "omega0", "omega", "m0", "cuc", "cus", "cic", "cis", "elevation", "azimuth"), "rad"),
        **dict.fromkeys(("delta_n", "idot", "omega_dot"), "rad/s"),
        **dict.fromkeys(("crc", "crs", "accuracy", "r_e", "r_sat_e", "pseudorange", "sigma_range"), "m"),
        **dict.fromkeys(("carrier_range", "wavelength", "bands_apart"), "m"),
        **dict.fromkeys(("v_e", "v_sat_e", "range_rate", "sigma_rate"), "m/s"),
        "a_e": "m/s^2",
        "clock": "s",
        "carrier": "cycle",
        "cn0": "dB-Hz",
    }
)


def _layout(kind: type) -> dict[str, tuple[str, ...]]:
    """Columns of every array of a data class."""
    names = [f.name for f in fields(kind) if f.name not in _CONSTANTS]
    return {name: _columns(name) for name in names}


def _columns(name: str) -> tuple[str, ...]:
    width = _WIDTH.get(name, 1)
    if width == 1:
        return (name,)
    return tuple(f"{name}_{axis}" for axis in _AXES) if width == 3 else tuple(f"{name}_{k + 1}" for k in range(width))


_KEPLER, _GLONASS = _layout(KeplerRecords), _layout(GlonassRecords)
#: Columns of each table, in order.
TABLES: MappingProxyType[str, tuple[str, ...]] = MappingProxyType(
    {
        "observations": tuple(c for names in _layout(Observations).values() for c in names),
        "ranges": tuple(c for names in _layout(Ranges).values() for c in names),
        "ephemerides": tuple(
            dict.fromkeys(c for layout in (_KEPLER, _GLONASS) for names in layout.values() for c in names)
        ),
    }
)
#: Unit of each column.
UNITS = MappingProxyType(
    {
        column: _UNIT_OF_FIELD.get(name, "1")
        for kind in (KeplerRecords, GlonassRecords, Observations, Ranges)
        for name, names in _layout(kind).items()
        for column in names
    }
)


def flatten(recording: Recording) -> dict[str, Columns]:
    """Columns of the satellite parts that a recording has and that have rows. Shapes (n,)."""
    flat: dict[str, Columns] = {}
    for name in ("observations", "ranges"):
        part = getattr(recording, name)
        if part is not None and len(part):
            flat[name] = _split(part)
    broadcast = recording.ephemerides
    if broadcast is not None and len(broadcast.kepler) + len(broadcast.glonass):
        kepler, glonass = _split(broadcast.kepler), _split(broadcast.glonass)
        sizes = (len(broadcast.kepler), len(broadcast.glonass))
        flat["ephemerides"] = {
            c: np.concatenate([_filled(part, c, n) for part, n in zip((kepler, glonass), sizes, strict=True)])
            for c in TABLES["ephemerides"]
        }
    return flat


def constants(recording: Recording) -> dict[str, Any]:
    """Constants of the satellite parts, as plain values for JSON."""
    values: dict[str, Any] = {}
    if (o := recording.observations) is not None:
        values["observations"] = {
            "signals": list(o.signals),
            "epoch_gps_s": o.epoch_gps_s,
            "glonass_channels": {str(sat): int(channel) for sat, channel in o.glonass_channels.items()},
            **{name: _listed(getattr(o, name)) for name in _PLACES},
            "antenna": o.antenna,
            "notes": list(o.notes),
        }
    if (r := recording.ranges) is not None:
        values["ranges"] = {"groups": list(r.groups), "notes": list(r.notes)}
    if (e := recording.ephemerides) is not None:
        values["ephemerides"] = {
            "kepler_rows": len(e.kepler),
            "glonass_rows": len(e.glonass),
            **{name: _listed(getattr(e, name)) for name in _COEFFICIENTS},
            "leap_seconds": e.leap_seconds,
            "notes": list(e.notes),
        }
    return values


def unflatten(name: str, flat: Columns, constants: Mapping[str, Any]) -> Observations | Ranges | Ephemerides:
    """A satellite part of its columns and constants; the inverse of :func:`flatten` and :func:`constants`.

    Parameters
    ----------
    name : {"observations", "ranges", "ephemerides"}
    flat : dict
        Columns; none at all of a part without rows.
    constants : mapping
        The part's entry of :func:`constants`.

    Raises
    ------
    KeyError, TypeError, ValueError
        If a column or constant is missing or impossible.
    """
    notes = tuple(str(note) for note in constants["notes"])
    if name == "observations":
        constants["position_e"]  # the others came later
        places: dict[str, Any] = {name: constants.get(name) for name in _PLACES}
        places = {name: None if place is None else _tuple(place, 3) for name, place in places.items()}
        return Observations(
            **_join(_layout(Observations), flat),
            signals=tuple(str(s) for s in constants["signals"]),
            epoch_gps_s=float(constants["epoch_gps_s"]),
            glonass_channels={int(sat): int(channel) for sat, channel in constants["glonass_channels"].items()},
            **places,
            antenna=str(constants.get("antenna", "")),
            notes=notes,
        )
    if name == "ranges":
        groups = tuple(str(g) for g in constants["groups"])
        return Ranges(**_join(_layout(Ranges), flat), groups=groups, notes=notes)
    split, rows = int(constants["kepler_rows"]), len(flat["sat"]) if flat else 0
    if rows != split + int(constants["glonass_rows"]):
        raise ValueError(f"{rows} rows instead of {split} Keplerian and {constants['glonass_rows']} of GLONASS")
    leap = constants["leap_seconds"]
    constants["klobuchar_alpha"], constants["klobuchar_beta"], constants["galileo_ai"]  # the others came later
    values = {key: constants.get(key) for key in _COEFFICIENTS}
    tuples: dict[str, Any] = {
        key: None if value is None else _tuple(value, _COEFFICIENTS[key]) for key, value in values.items()
    }
    return Ephemerides(
        KeplerRecords(**_join(_KEPLER, {c: values[:split] for c, values in flat.items()})),
        GlonassRecords(**_join(_GLONASS, {c: values[split:] for c, values in flat.items()})),
        **tuples,
        leap_seconds=None if leap is None else int(leap),
        notes=notes,
    )


def _split(part: Any) -> Columns:
    flat: Columns = {}
    for name, names in _layout(type(part)).items():
        values = getattr(part, name)
        flat |= {names[0]: values} if len(names) == 1 else {c: values[:, k] for k, c in enumerate(names)}
    return flat


def _join(layout: Mapping[str, tuple[str, ...]], flat: Columns) -> dict[str, Any]:
    if not flat:
        return {name: np.zeros(0 if len(names) == 1 else (0, len(names))) for name, names in layout.items()}
    return {
        name: flat[names[0]] if len(names) == 1 else np.stack([flat[c] for c in names], axis=1)
        for name, names in layout.items()
        if name in flat or name not in LATER
    }


def _filled(flat: Columns, column: str, rows: int) -> np.ndarray[Any, np.dtype[Any]]:
    if column in flat:
        return flat[column]
    return np.zeros(rows, dtype=np.int64) if column in INTEGERS else np.full(rows, np.nan)


def _listed(values: tuple[float, ...] | None) -> list[float] | None:
    return None if values is None else [float(v) for v in values]


def _tuple(values: Any, length: int) -> Any:
    if len(values) != length:
        raise ValueError(f"{values!r} instead of {length} numbers")
    return tuple(float(v) for v in values)
