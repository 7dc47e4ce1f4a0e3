"""Configurations as TOML with their evidence in comments."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from typing import Any

from schuler.toml import toml_value


def toml_of(data: Mapping[str, Any], remarks: Mapping[str, str]) -> str:
    """Text of nested sections, what is worth saying above each entry.

    Parameters
    ----------
    data : mapping
    remarks : mapping of str to str
        By name with dots.
    """
    return "\n".join(section_lines(data, "", remarks)).lstrip("\n") + "\n"


def section_lines(data: Mapping[str, Any], name: str, remarks: Mapping[str, str]) -> list[str]:
    """Lines of a section of TOML and of those in it, what is worth saying above each entry.

    Parameters
    ----------
    data : mapping
    name : str
    remarks : mapping of str to str
        By name with dots.
    """
    lines: list[str] = []
    own = {key: value for key, value in data.items() if not isinstance(value, Mapping)}
    if name and (own or not data):
        lines += ["", *comment(remarks.get(name, "")), f"[{name}]"]
    for key, value in own.items():
        plain = ",".join(sorted(value)) if isinstance(value, (set, frozenset)) else value
        lines += [*comment(remarks.get(f"{name}.{key}", "")), f"{key} = {toml_value(plain)}"]
    for key, value in data.items():
        if isinstance(value, Mapping):
            lines += section_lines(value, f"{name}.{key}" if name else key, remarks)
    return lines


def comment(text: str) -> list[str]:
    """Comment lines of a text.

    Parameters
    ----------
    text : str
    """
    return textwrap.wrap(text, 116, initial_indent="# ", subsequent_indent="#   ")
