"""TOML text: entries put into a file that somebody wrote, and values as TOML spells them."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from typing import Any

from schuler.exceptions import TomlError

_DEEPEST = 50  # sections and lists within one another that a TOML file may have
_TOO_DEEP = "its entries are nested too deeply"


def parsed_toml(text: str) -> dict[str, Any]:
    """Entries of TOML text.

    Raises
    ------
    ValueError
        With the reason, if it is none, or is nested too deeply or has integers beyond 64 bits: both of these pass
        Python's reader and fail in what comes after it.
    """
    try:
        data = tomllib.loads(text)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    left: list[tuple[Any, int]] = [(data, 0)]
    while left:
        value, depth = left.pop()
        if depth > _DEEPEST:
            raise ValueError(_TOO_DEEP)
        if isinstance(value, int) and not -(2**63) <= value < 2**63:
            raise ValueError("an integer has more than 64 bits")
        within = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
        left += [(one, depth + 1) for one in within]
    return data


def toml_with(text: str, entries: Mapping[str, Any], remarks: Mapping[str, str] | None = None) -> str:
    """TOML with entries put in, everything else as it was: order, comments, spelling.

    Parameters
    ----------
    text : str
    entries : mapping
        Nested sections with numbers, truth values, strings and lists of them.
    remarks : mapping of str to str, optional
        Comment behind an entry, by its name with dots.

    Raises
    ------
    TomlError
        If the entries stand in the text in a form that cannot be changed line by line; the message has their lines.
    """
    lines = text.splitlines()
    wanted = merged(tomllib.loads(text), entries)
    sections = list(_sections(entries))
    for section, values in sections:
        header = re.compile(rf"^\s*\[\s*{re.escape(section)}\s*\]")
        start = next((i for i, line in enumerate(lines) if header.match(line)), None) if section else -1
        if start is None:
            lines += ["", f"[{section}]"]
            start = len(lines) - 1
        for key, value in values.items():
            remark = (remarks or {}).get(f"{section}.{key}" if section else key, "")
            new = f"{key} = {toml_value(value)}" + (f"  # {remark}" if remark else "")
            stop = next((i for i in range(start + 1, len(lines)) if re.match(r"^\s*\[", lines[i])), len(lines))
            old = next((i for i in range(start + 1, stop) if re.match(rf"^\s*{re.escape(key)}\s*=", lines[i])), None)
            if old is not None:
                lines[old] = new
                continue
            while stop > start + 1 and (not lines[stop - 1].strip() or lines[stop - 1].lstrip().startswith("#")):
                stop -= 1  # before the remarks of the next section
            lines.insert(stop, new)
    edited = "\n".join(lines) + "\n"
    try:
        right = tomllib.loads(edited) == wanted
    except tomllib.TOMLDecodeError:
        right = False
    if not right:
        body = "\n".join(
            (f"[{section}]\n" if section else "")
            + "\n".join(f"{key} = {toml_value(value)}" for key, value in values.items())
            for section, values in sections
        )
        raise TomlError(f"its entries cannot be changed line by line; put these in their place:\n{body}")
    return edited


def _sections(entries: Mapping[str, Any], name: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Sections by their name with dots, and their own entries."""
    own = {key: value for key, value in entries.items() if not isinstance(value, Mapping)}
    if own:
        yield name, own
    for key, value in entries.items():
        if isinstance(value, Mapping):
            yield from _sections(value, f"{name}.{key}" if name else key)


def toml_value(value: Any) -> str:
    """Number, truth value, text, list or table of them as TOML spells it in one line.

    Parameters
    ----------
    value : Any
    """
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(toml_value(v) for v in value)}]"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{k} = {toml_value(v)}" for k, v in value.items()) + "}"
    return repr(value) if isinstance(value, (int, float)) else json.dumps(value)


def merged(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    """Nested entries with others put in their place; neither is changed."""
    out = dict(old)
    for key, value in new.items():
        out[key] = merged(out.get(key, {}), value) if isinstance(value, Mapping) else value
    return out
