"""Sentences for the faults pydantic finds in a configuration, shared by scenarios and navigation runs."""

from __future__ import annotations

import difflib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationError


def sentences(error: ValidationError, model: type[BaseModel]) -> list[str]:
    """One sentence for each fault: where, what is wrong, what came, and the nearest known name.

    Parameters
    ----------
    error : ValidationError
    model : type of BaseModel
        The model that was being validated.
    """
    lines = []
    for fault in error.errors():
        where = ".".join(str(part) for part in fault["loc"]) or "the file"
        if fault["type"] == "extra_forbidden":
            known = _fields_at(model, fault["loc"][:-1])
            near = difflib.get_close_matches(str(fault["loc"][-1]), known, n=1)
            hint = f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}"
            lines.append(f"{where}: unknown entry; {hint}")
        elif fault["type"] == "missing":
            lines.append(f"{where}: missing")
        else:
            message = fault["msg"].removeprefix("Value error, ")
            came = "" if isinstance(fault["input"], dict) else f", got {fault['input']!r}"
            lines.append(f"{where}: {message}{came}")
    return lines


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
        found = _model_in(inner)
        if found is not None:
            return found
    return None
