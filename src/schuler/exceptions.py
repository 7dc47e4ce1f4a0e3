"""Exceptions of the package.

Every message says what was expected, what came and what to do about it. The command line turns any
:class:`SchulerError` into one line on stderr and exit code 2; anything else is a defect of ours.
"""

from __future__ import annotations

import difflib
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationError


class SchulerError(Exception):
    """Base of every error a user can cause."""


def printable(text: str) -> str:
    """Text without control characters, by which a file could speak to the terminal; line feeds stay.

    Parameters
    ----------
    text : str
        Such as a message with a name from a file.
    """
    return "".join(c if c == "\n" or c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)


class InputError(SchulerError, ValueError):
    """A value, array or option that cannot be used as it is."""


class UnitError(InputError):
    """A unit that is unknown or measures the wrong quantity."""


class ConfigError(InputError):
    """A configuration or scenario file with missing, unknown or contradictory entries."""


class OverwriteError(InputError):
    """A file that exists and is kept."""


class DivergenceError(InputError):
    """A filter whose estimates or covariance broke down on the input."""


class FileFormatError(InputError):
    """A file whose contents cannot be read as what they were said to be.

    Parameters
    ----------
    message : str
        Sentence: what was expected, what came, what to do.
    path : Path, optional
        The file.
    line : int, optional
        One-based line of the file; the message then starts with ``file:line:``.
    """

    def __init__(self, message: str, path: Path | str | None = None, line: int | None = None) -> None:
        self.path = None if path is None else Path(path)
        self.line = line
        where = "" if path is None else f"{path}: " if line is None else f"{path}:{line}: "
        super().__init__(where + message)


class ReaderError(FileFormatError):
    """A file at which a reader gave up in a way it does not foresee: damaged, or a defect of the reader."""


class TomlError(ConfigError, FileFormatError):
    """A TOML file that is missing, cannot be opened, or is no TOML."""


class MissingExtraError(SchulerError, ImportError):
    """An optional library is needed for what was asked.

    Parameters
    ----------
    library : str
        The import name that failed.
    extra : str
        The extra of this package that installs it.
    purpose : str
        Task that needs the library.
    """

    def __init__(self, library: str, extra: str, purpose: str) -> None:
        super().__init__(f"{purpose} needs {library}, which is not installed: pip install 'schuler[{extra}]'")


def missing_extra(library: str, extra: str, purpose: str) -> MissingExtraError | None:
    """Error for an optional library that is not installed, None if it is; the library is not loaded.

    Parameters
    ----------
    library, extra, purpose : str
        As of :class:`MissingExtraError`.
    """
    from importlib.util import find_spec

    try:
        missing = find_spec(library) is None
    except (ImportError, ValueError):
        missing = True
    return MissingExtraError(library, extra, purpose) if missing else None


def sentences(error: ValidationError, model: type[BaseModel]) -> list[str]:
    """One sentence for each fault: where, what is wrong, what came, and the nearest known name.

    Parameters
    ----------
    error : ValidationError
    model : type of BaseModel
        The model that was being validated.
    """
    lines: list[str] = []
    branches: dict[tuple[str, str], list[str]] = {}  # of an entry that may be of several kinds, what each of them wants
    for fault in error.errors():
        place = fault["loc"]
        short = fault["type"] == "missing" and isinstance(place[-1], int)  # a list that ends too early
        if short:
            place = place[:-1]
        where = ".".join(str(part) for part in place if not _is_branch(part)) or "the file"
        if fault["type"] == "extra_forbidden":
            names = _fields_at(model, place[:-1])
            near = difflib.get_close_matches(str(place[-1]), names, n=1)
            hint = f"did you mean {near[0]}?" if near else f"known are {', '.join(names)}"
            lines.append(f"{where}: unknown entry; {hint}")
        elif fault["type"] == "missing" and not short:
            lines.append(f"{where}: missing")
        else:
            came = "" if isinstance(fault["input"], dict) else f", got {_as_written(fault['input'])}"
            wants = branches.setdefault((where, came), [])
            wants.append(_wanted(fault["type"], fault.get("ctx", {}), fault["msg"]))
    for (where, came), wants in branches.items():
        others = [want.removeprefix("expected ") for want in wants[1:]]
        lines.append(f"{where}: {', or '.join(dict.fromkeys([wants[0], *others]))}{came}")
    return lines


_WANTED = {
    "float_type": "a number",
    "float_parsing": "a number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "string_type": "a text",
    "tuple_type": "a list",
    "list_type": "a list",
    "dict_type": "a section",
    "model_type": "a section",
    "model_attributes_type": "a section",
    "finite_number": "a finite number",
    "greater_than": "more than {gt:g}",
    "greater_than_equal": "at least {ge:g}",
    "less_than": "less than {lt:g}",
    "less_than_equal": "at most {le:g}",
    "literal_error": "{expected}",
    "missing": "more values",
    "too_short": "at least {min_length} values",
    "too_long": "at most {max_length} values",
}


def _wanted(kind: str, bounds: dict[str, Any], message: str) -> str:
    """What a value should have been, by the kind of pydantic's fault; its own message for kinds not known here."""
    if kind not in _WANTED:
        return message.removeprefix("Value error, ").replace("Input should be", "expected")
    return f"expected {_WANTED[kind].format(**bounds)}"


def _as_written(value: Any) -> str:
    """A value as one writes it in TOML."""
    if isinstance(value, bool):
        return str(value).lower()
    return str(list(value)) if isinstance(value, tuple) else repr(value)


def _is_branch(part: int | str) -> bool:
    """Whether a part of a place is pydantic's name for one kind of value, as ``literal[9,15]`` or ``float``."""
    return isinstance(part, str) and (
        part in ("float", "int", "str", "bool") or re.search(r"[\[\]-]", part) is not None
    )


def _fields_at(model: type[BaseModel], place: tuple[int | str, ...]) -> list[str]:
    """Names of the entries a section at a place may have; descends through optional and repeated sections."""
    for part in place:
        if isinstance(part, int):
            continue
        field = model.model_fields.get(part)
        inner = None if field is None else _model_in(field.annotation)
        if inner is None:
            return []
        model = inner
    return list(model.model_fields)


def _model_in(annotation: object) -> type[BaseModel] | None:
    from typing import get_args

    from pydantic import BaseModel

    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for inner in get_args(annotation):
        model = _model_in(inner)
        if model is not None:
            return model
    return None
