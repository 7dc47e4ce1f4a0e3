"""Files: TOML read with clear errors, writing that never leaves half a file, and checksums for provenance."""

from __future__ import annotations

import hashlib
import json
import os
import re
import tempfile
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from schuler.exceptions import TomlError

_MANY = 4_000_000  # bytes that are worth a thread


def read_toml(path: Path | str, missing: str = "no such configuration file") -> dict[str, Any]:
    """Entries of a TOML file, not checked.

    Parameters
    ----------
    path : Path or str
    missing : str
        Message if there is no such file.

    Raises
    ------
    TomlError
        If there is no such file, it cannot be opened, or it is no TOML.
    """
    path = Path(path)
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise TomlError(missing, path) from None
    except OSError as error:
        raise TomlError(f"cannot be read: {error.strerror}", path) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise TomlError(f"not a TOML file: {error}", path) from None


@contextmanager
def replacing(path: Path | str) -> Iterator[Path]:
    """Yield a temporary path beside ``path``; it takes that name only when the block ends without an error.

    Parameters
    ----------
    path : Path or str
        The file to be written; missing folders are made.

    Yields
    ------
    Path
        Path to write to. Removed again if the block raises or is interrupted.
    """
    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{target.name}.", suffix=target.suffix, dir=target.parent)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, target)
    finally:
        with suppress(FileNotFoundError):
            temporary.unlink()


def write_text(path: Path | str, text: str) -> Path:
    """Write a text file in UTF-8 through :func:`replacing`; return its path."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return Path(path)


def sha256(path: Path | str) -> str:
    """SHA-256 of a file's bytes as hexadecimal text, for the provenance of results."""
    digest = hashlib.sha256()
    with Path(path).open("rb") as stream:
        while block := stream.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


@contextmanager
def hashed(paths: Iterable[Path], root: Path | None = None) -> Iterator[Callable[[], dict[str, str]]]:
    """Yield a function that returns the SHA-256 of each file by its name; large files are read beside what follows.

    Parameters
    ----------
    paths : iterable of Path
    root : Path, optional
        Folder from which on files are named: those of a data set may all be called alike.
    """
    from concurrent.futures import ThreadPoolExecutor  # loaded where threads are used: it takes time

    paths = list(paths)

    def work() -> dict[str, str]:
        return {path.name if root is None else path.relative_to(root).as_posix(): sha256(path) for path in paths}

    if sum(path.stat().st_size for path in paths) < _MANY:
        yield work
        return
    with ThreadPoolExecutor(1) as pool:
        yield pool.submit(work).result


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
        start = next((i for i, line in enumerate(lines) if header.match(line)), None)
        if start is None:
            lines += ["", f"[{section}]"]
            start = len(lines) - 1
        for key, value in values.items():
            remark = (remarks or {}).get(f"{section}.{key}", "")
            new = f"{key} = {_toml_value(value)}" + (f"  # {remark}" if remark else "")
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
            f"[{section}]\n" + "\n".join(f"{key} = {_toml_value(value)}" for key, value in values.items())
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


def _toml_value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(_toml_value(v) for v in value)}]"
    return repr(value) if isinstance(value, (int, float)) else json.dumps(value)


def merged(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    """Nested entries with others put in their place; neither is changed."""
    out = dict(old)
    for key, value in new.items():
        out[key] = merged(out.get(key, {}), value) if isinstance(value, Mapping) else value
    return out
