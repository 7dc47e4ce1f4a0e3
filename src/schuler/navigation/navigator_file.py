"""Files of live navigators: JSON with arrays to the last bit, a version and a checksum."""

from __future__ import annotations

import base64
import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from schuler.exceptions import FileFormatError
from schuler.files import write_text

NAVIGATOR_FORMAT = "schuler/navigator/2"
_LARGEST = 200_000_000  # bytes


def write_document(path: Path | str, document: dict[str, Any], form: str = NAVIGATOR_FORMAT) -> Path:
    """Write nested plain data and arrays of float64 and int64.

    Parameters
    ----------
    path : Path or str
        Its file appears complete or not at all.
    document : dict
    form : str
        Format and version that the file says it is of.
    """
    content = json.dumps(_encoded(document), separators=(",", ":"))
    head = {"format": form, "sha256": hashlib.sha256(content.encode()).hexdigest()}
    # in place of the one before, and while a command still runs: it is there in case that is killed
    return write_text(path, f"{json.dumps(head)}\n{content}\n", at_once=True)


def read_document(path: Path | str, form: str = NAVIGATOR_FORMAT) -> dict[str, Any]:
    """Nested data that :func:`write_document` wrote.

    Parameters
    ----------
    path : Path or str
    form : str
        Format and version that is expected.

    Raises
    ------
    FileFormatError
        If the file cannot be read, is of another kind or version, or is not what was written.
    """
    path = Path(path)
    try:
        if path.stat().st_size > _LARGEST:
            raise FileFormatError(f"expected a live navigator, got a file of more than {_LARGEST // 10**6} MB", path)
        head, _, content = path.read_text(encoding="utf-8").partition("\n")
        stated = json.loads(head)
    except OSError as error:
        raise FileFormatError(f"cannot be read: {error.strerror}", path) from None
    except (ValueError, RecursionError):
        stated = None
    if not isinstance(stated, dict) or stated.get("format") != form:
        got = stated.get("format") if isinstance(stated, dict) else "something else"
        raise FileFormatError(f"expected a live navigator of format {form!r}, got {got!r}", path)
    content = content.removesuffix("\n")
    if hashlib.sha256(content.encode()).hexdigest() != stated.get("sha256"):
        raise FileFormatError("is damaged: its content has another checksum than when it was written", path)
    document: dict[str, Any] = json.loads(content, object_hook=_decoded)
    return document


def _encoded(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        kind = "<i8" if value.dtype.kind == "i" else "<f8"
        data = base64.b64encode(np.ascontiguousarray(value, dtype=kind).tobytes()).decode()
        return {"array": data, "type": kind, "shape": list(value.shape)}
    if isinstance(value, dict):
        return {key: _encoded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_encoded(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def _decoded(value: dict[str, Any]) -> Any:
    if "array" not in value:
        return value
    flat = np.frombuffer(base64.b64decode(value["array"]), dtype=value["type"])
    return flat.astype(np.int64 if value["type"] == "<i8" else np.float64).reshape(value["shape"])
