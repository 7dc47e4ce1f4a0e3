"""Entries of a configuration as fields of a form, made from its JSON schema.

A value is written as in TOML, so that what is typed is what the file will have. Units stand at the end of names, as
everywhere in configurations.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from schuler.exceptions import InputError
from schuler.navigation.config import NavigationConfig
from schuler.navigation.sections import Config
from schuler.toml import parsed_toml, toml_value

_UNITS = (
    ("_deg_s_rthz", "deg/s/√Hz"), ("_deg_hr", "deg/h"), ("_m_s2", "m/s²"), ("_deg_s", "deg/s"), ("_m_s", "m/s"),
    ("_deg", "deg"), ("_mg", "mg"), ("_hz", "Hz"), ("_m", "m"), ("_s", "s"),
)  # fmt: skip
_NO_FORM = ("recording", "outages")  # the page Look, and the timeline
_KEPT_WHOLE = 3  # levels of sections; what lies deeper is a table of the user's own names


@dataclass(frozen=True)
class Field:
    """One entry.

    Attributes
    ----------
    name : str
        With dots: ``gnss.lever_arm_m``.
    help : str
    unit : str
    default : str
        As TOML spells it; empty of an entry that is left out.
    choices : tuple of str
        What it may be, as TOML spells it; empty if anything of its kind.
    switch : bool
        Whether it is a section that is switched on by being there, such as an aid.
    """

    name: str
    help: str
    unit: str
    default: str
    choices: tuple[str, ...] = ()
    switch: bool = False

    @property
    def section(self) -> str:
        """First part of the name; empty of an entry in no section."""
        first, dot, _ = self.name.partition(".")
        return first if dot or self.switch else ""


def fields(model: type[Config] = NavigationConfig) -> tuple[Field, ...]:
    """All entries of a configuration but how the log is read and outages of a run, in the order of the schema.

    Those in no section stand first, as they do in a file.
    """
    schema = model.model_json_schema()
    return tuple(sorted(_fields(schema, schema["$defs"], "", 0), key=lambda field: field.section != ""))


def _fields(schema: Mapping[str, Any], named: Mapping[str, Any], prefix: str, depth: int) -> Iterator[Field]:
    for key, entry in schema.get("properties", {}).items():
        if not prefix and key in _NO_FORM:
            continue
        name = f"{prefix}.{key}" if prefix else key
        options = [_resolved(one, named) for one in entry.get("anyOf", [entry])]
        optional = any(one.get("type") == "null" for one in options)
        options = [one for one in options if one.get("type") != "null"]
        section = next((one for one in options if "properties" in one), None)
        if section is not None and depth < _KEPT_WHOLE:
            if optional:
                yield Field(name, str(section.get("description", "")), "", "", switch=True)
            yield from _fields(section, named, name, depth + 1)
            continue
        stated = entry.get("default", next((one["default"] for one in options if "default" in one), None))
        words = str(entry.get("description") or "")
        yield Field(
            name, words, _unit(key), "" if stated is None or stated == {} else toml_value(stated), _choices(options)
        )


def _resolved(entry: Mapping[str, Any], named: Mapping[str, Any]) -> dict[str, Any]:
    place = entry.get("$ref", "").rpartition("/")[2]
    return {**named[place], **{k: v for k, v in entry.items() if k != "$ref"}} if place else dict(entry)


def _choices(options: list[dict[str, Any]]) -> tuple[str, ...]:
    """What an entry may be; none where one of its kinds is open."""
    values: list[str] = []
    for one in options:
        if one.get("type") == "boolean":
            values += ["true", "false"]
        elif "enum" in one or "const" in one:
            values += [toml_value(v) for v in one.get("enum", [one.get("const")])]
        else:
            return ()
    return tuple(values)


def _unit(key: str) -> str:
    return next((unit for suffix, unit in _UNITS if key.endswith(suffix)), "")


def shown(data: Mapping[str, Any], field: Field) -> str:
    """Value of an entry in a configuration as TOML spells it; empty if it does not state it.

    Parameters
    ----------
    data : mapping
        Nested sections.
    field : Field
    """
    at: Any = data
    for part in field.name.split("."):
        if not isinstance(at, Mapping) or part not in at:
            return ""
        at = at[part]
    return "true" if field.switch else toml_value(at)


def entered(field: Field, text: str) -> Any:
    """Value that was typed, None where the entry is left out.

    Parameters
    ----------
    field : Field
    text : str
        As TOML spells it; a name may stand without quotes.

    Raises
    ------
    InputError
        If it is none.
    """
    text = text.strip()
    if field.switch:
        return {} if text == "true" else None
    if not text:
        return None
    try:
        entries = parsed_toml(f"x = {text}")
    except ValueError:
        entries = {}
    if list(entries) == ["x"]:
        return entries["x"]
    if "\n" in text or text[:1] in "[{\"'" or field.choices:
        expected = " or ".join(field.choices) or "a value as TOML spells it, such as 0.5, [1.0, 0.0, 0.0] or true"
        raise InputError(f"{field.name}: expected {expected}, got {text!r}")
    return text


def changes(
    before: Mapping[str, Any], texts: Mapping[str, str], model: type[Config] = NavigationConfig
) -> dict[str, Any]:
    """Entries that a form states otherwise than a configuration, by name; None of those taken out.

    Parameters
    ----------
    before : mapping
        Nested sections of the file.
    texts : mapping of str to str
        What the form has, by name of the entry.
    model : type
        Of the configuration.

    Raises
    ------
    InputError
        See :func:`entered`.
    """
    by_name = {field.name: field for field in fields(model)}
    return {
        name: entered(by_name[name], text)
        for name, text in texts.items()
        if text.strip() != shown(before, by_name[name])
    }
