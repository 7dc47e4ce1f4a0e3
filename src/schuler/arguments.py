"""Wrong arguments of public functions, said in a sentence: which one, what was expected, what came."""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from typing import Any, ParamSpec, TypeVar

from schuler.exceptions import InputError

P = ParamSpec("P")
R = TypeVar("R")

#: What an annotation of this name takes; of classes it is the class.
_TAKES: dict[str, type | tuple[type, ...]] = {
    "None": type(None),
    "str": str,
    "Path": (str, PathLike),
    "bool": bool,
    "int": int,
    "float": (int, float),
    "dict": dict,
    "Mapping": Mapping,
    "Sequence": Sequence,
}


def explains_arguments(function: Callable[P, R]) -> Callable[P, R]:
    """Public function whose wrong arguments end in an :class:`InputError` instead of a traceback from its inside.

    Arguments are compared with the annotations only after a ``TypeError`` or ``AttributeError``: a call that works
    costs nothing, and an error with arguments of the annotated types passes as it is. A string in the place of a
    sequence is found before: the call would take its letters one by one.
    """

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        if any(type(value) is str for value in (*args, *kwargs.values())) and (
            sentence := _mismatch(function, args, kwargs, of_letters=True)
        ):
            raise InputError(sentence)
        try:
            return function(*args, **kwargs)
        except (TypeError, AttributeError) as error:
            if sentence := _mismatch(function, args, kwargs):
                raise InputError(sentence) from error
            raise

    return call


def _mismatch(
    function: Callable[..., Any], args: tuple[Any, ...], kwargs: Mapping[str, Any], *, of_letters: bool = False
) -> str:
    """First argument that is not what its annotation says, or that is a string in the place of a sequence only; empty
    if there is none, or the call does not even bind.
    """
    signature = inspect.signature(function)
    try:
        given = signature.bind(*args, **kwargs).arguments
    except TypeError:
        return ""
    for name, value in given.items():
        parameter = signature.parameters[name]
        if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
            continue
        expected = str(parameter.annotation)
        if of_letters and not (isinstance(value, str) and expected.startswith("Sequence[")):
            continue
        if not _is_one_of(value, expected, function.__globals__):
            return (
                f"{function.__name__}: {name}: expected {expected.replace(' | ', ' or ')}, "
                f"got {type(value).__name__}{_remedy(value, expected)}"
            )
    return ""


def _is_one_of(value: object, annotation: str, names: Mapping[str, Any]) -> bool:
    """Whether a value is one of the alternatives of an annotation; names that are no class are believed."""
    for alternative in _split(annotation, "|"):
        name, inside = re.fullmatch(r"([\w.]*)(?:\[(.*)\])?.*", alternative, re.DOTALL).groups()  # type: ignore[union-attr]
        kind = _TAKES.get(name, names.get(name))
        if kind is None and name[:1].isupper():  # imported for annotations only
            fits = name in {c.__name__ for c in type(value).__mro__}
        else:
            believed = kind is Any or not isinstance(kind, type | tuple) or getattr(kind, "_is_protocol", False)
            fits = believed or isinstance(value, kind)  # type: ignore[arg-type]
        if fits and name == "Sequence" and inside:
            fits = all(_is_one_of(item, inside, names) for item in value)  # type: ignore[attr-defined]
        if fits and not (name == "Sequence" and isinstance(value, str)):
            return True
    return False


def _split(text: str, mark: str) -> list[str]:
    """Parts of a text between marks that are outside of brackets."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter == "[") - (letter == "]")
        if letter == mark and not depth:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts]


def _remedy(value: object, expected: str) -> str:
    if expected.startswith("Sequence[str]") and isinstance(value, str):
        return f", give a list: [{value!r}]"
    if expected.startswith("Sequence[ImuSeries]") and isinstance(value, str | PathLike):
        return f", read each first: [schuler.read({str(value)!r}).imu]"
    if "Recording" in expected and isinstance(value, str | PathLike):
        return f", read it first: schuler.read({str(value)!r})"
    if "Recording" in expected and type(value).__name__ == "ImuSeries":
        return ", make one of it: schuler.Recording(imu=...)"
    if "ImuSeries" in expected and type(value).__name__ == "Recording":
        return ", take its series: recording.imu"
    return ""
