"""Files: TOML read with clear errors, writing that never leaves half a file, and checksums for provenance."""

from __future__ import annotations

import hashlib
import json
import math
import os
import shutil
import signal
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from schuler.exceptions import InputError, OverwriteError, TomlError
from schuler.toml import parsed_toml

_MANY = 4_000_000  # bytes that are worth a thread
_LARGEST_TOML = 10_000_000  # characters
_OF_SHELL = ("/dev/stdin", "/dev/fd/", "/proc/self/fd/")  # how its pipes are called
_MADE_MEANWHILE = "{} was made by another run meanwhile; nothing was written: name another folder"
_HIDDEN = ".schuler-"  # how temporaries begin
LISTED = ".schuler.json"  # list of what commands wrote into a folder that they made


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
    note_input(path)
    if piped := path.is_fifo():
        if not str(path).startswith(_OF_SHELL):
            raise TomlError("expected a file, it is a named pipe and may wait for ever: write its text to a file", path)
        if path in _piped:
            return parsed_toml(_piped[path])
    try:
        with path.open(encoding="utf-8-sig") as file:
            text = file.read(_LARGEST_TOML + 1)
        if len(text) > _LARGEST_TOML:  # a device never ends
            raise ValueError(f"longer than {_LARGEST_TOML:.0e} characters")
        data = parsed_toml(text)
    except FileNotFoundError:
        raise TomlError(missing, path) from None
    except OSError as error:
        raise TomlError(f"cannot be read: {error.strerror}", path) from None
    except ValueError as error:  # also of the encoding, of numbers of thousands of digits
        raise TomlError(f"not a TOML file: {error}", path) from None
    if piped:
        _piped[path] = text
    return data


@dataclass
class _Outputs:
    """Files that a command writes: what it read, and what waits under a temporary name until the command has ended."""

    force: bool
    process: int = field(default_factory=os.getpid)
    inputs: set[tuple[int, int]] = field(default_factory=set)
    waiting: dict[Path, tuple[Path, ExitStack]] = field(default_factory=dict)
    made: dict[Path, tuple[Path, ExitStack]] = field(default_factory=dict)
    empty: set[Path] = field(default_factory=set)


_outputs: _Outputs | None = None
_tidied: set[Path] = set()  # folders in which this process has looked for what a killed one left
_piped: dict[Path, str] = {}  # what came out of a shell's pipes, which give it once, for who asks again


@contextmanager
def outputs(*, force: bool = False) -> Iterator[None]:
    """Hold back the files written inside the block until it ends without an error, and keep those that exist.

    A folder that does not exist is written under a temporary name and renamed; in one that exists, every file is. A
    file that exists is replaced only with ``force``, or in a folder that an earlier block made or found empty, if it is
    as that block left it: a hidden list in the folder has the checksums. A file that was read (:func:`sha256`,
    :func:`hashed`, :func:`read_toml`, :func:`note_input`) is never replaced.

    Parameters
    ----------
    force : bool
        Replace files that exist.

    Raises
    ------
    OverwriteError
        At the first file that would replace one it must not; nothing has been written then.
    """
    global _outputs
    before, _outputs = _outputs, _Outputs(force)
    try:
        yield
        _put_in_place(_outputs)
    finally:
        for _, held in (*_outputs.waiting.values(), *_outputs.made.values()):
            held.close()
        _outputs = before


@contextmanager
def replacing(path: Path | str, *, at_once: bool = False) -> Iterator[Path]:
    """Yield a temporary path beside ``path``; it takes that name only when the block ends without an error.

    Inside :func:`outputs` it takes the name when that block ends, and an existing file may be refused.

    Parameters
    ----------
    path : Path or str
        The file to be written; missing folders are made.
    at_once : bool
        Take the name when this block ends, whatever is there: for a store that grows, or a file edited in place.

    Yields
    ------
    Path
        Path to write to. Removed again if the block raises or is interrupted, by a later run if it is killed.

    Raises
    ------
    InputError
        If ``path`` is neither missing nor a plain file nor a folder, such as a device.
    OSError
        With the name of the file, if it cannot be written.
    """
    target = Path(path)
    run = _outputs if not at_once and _outputs is not None and _outputs.process == os.getpid() else None
    _refuse_devices(target)
    if run is not None:
        _refuse_existing(target, run)
    with ExitStack() as held:
        folder = target.parent
        try:
            if run is None:
                folder.mkdir(parents=True, exist_ok=True)
            else:
                folder = _waiting_folder(target, run)
            temporary = held.enter_context(temporary_folder(folder)) / f"new{target.suffix}"
            temporary.touch(mode=0o600)
            yield temporary
            os.chmod(temporary, 0o666 & ~_umask())
            if run is None:
                os.replace(temporary, target)
        except OSError as error:
            if error.errno is not None and (error.filename is None or _HIDDEN in str(error.filename)):
                error.filename, error.filename2 = str(target), None  # the name that the user knows
            raise
        if run is not None:
            earlier = run.waiting.pop(absolute(target), None)
            if earlier is not None:
                earlier[1].close()
            run.waiting[absolute(target)] = temporary, held.pop_all()


@contextmanager
def new_folder(path: Path | str) -> Iterator[Path]:
    """Yield an empty folder beside ``path``, which takes that name only when the block ends without an error.

    Raises
    ------
    InputError
        If the folder exists: it is not written over.
    """
    path = Path(path)
    if path.exists():
        raise InputError(f"{path} exists; a folder of data is not written over: remove it, or name another")
    path.parent.mkdir(parents=True, exist_ok=True)
    with temporary_folder(path.parent) as folder:
        yield folder
        _name(folder, path)


def write_text(path: Path | str, text: str, *, at_once: bool = False) -> Path:
    """Write a text file in UTF-8 through :func:`replacing`; return its path."""
    with replacing(path, at_once=at_once) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return Path(path)


def check_writable(path: Path) -> None:
    """Make and remove a temporary in the nearest folder of a path that exists; ``OSError`` if that fails."""
    folder = next(p for p in absolute(path).parents if p.is_dir()) if not path.is_dir() else path
    with temporary_folder(folder):
        pass


def check_log(path: Path) -> None:
    """Raise InputError if a path is neither a file nor a folder: a pipe can be read once only and may never end."""
    if path.is_fifo():
        raise InputError(f"{path}: expected a file or folder, it is a pipe: write what comes out of it to a file first")
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")


def absolute(path: Path) -> Path:
    """Path from the root, without ``..``; symbolic links stay."""
    return Path(os.path.abspath(path))


@contextmanager
def temporary_folder(place: Path) -> Iterator[Path]:
    """Yield a new folder under a hidden name, which is removed when the block ends.

    It is locked as long as the process lives: that is how another one tells what a killed one left, and removes it.

    Parameters
    ----------
    place : Path
        Folder in which it is made.
    """
    if place not in _tidied:
        _tidied.add(place)
        _remove_left_over(place)
    while True:
        path = Path(tempfile.mkdtemp(prefix=_HIDDEN, dir=place))
        handle = _lock(path)
        if path.exists():
            break
        if handle is not None:  # taken for a left-over before it was locked
            os.close(handle)
    try:
        yield path
    finally:
        shutil.rmtree(path, ignore_errors=True)
        if handle is not None:
            os.close(handle)


def _lock(path: Path) -> int | None:
    """Handle that locks a path until it is closed; None if another process has it, or there are no such locks."""
    try:
        import fcntl
    except ImportError:
        return None
    try:
        handle = os.open(path, os.O_RDONLY)
    except OSError:
        return None
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(handle)
        return None
    return handle


def _remove_left_over(folder: Path) -> None:
    """Remove temporary folders of processes that were killed."""
    try:
        names = [entry.path for entry in os.scandir(folder) if entry.name.startswith(_HIDDEN) and entry.is_dir()]
    except OSError:
        return
    for name in names:
        if (handle := _lock(Path(name))) is not None:
            shutil.rmtree(name, ignore_errors=True)
            os.close(handle)


def _waiting_folder(target: Path, run: _Outputs) -> Path:
    """Where a file waits: in a hidden twin of the highest folder that does not exist yet, else beside its place."""
    place = absolute(target).parent
    top = next((folder for folder in (place, *place.parents) if folder in run.made), None)
    if top is None:
        missing = [folder for folder in (place, *place.parents) if not folder.exists()]
        if not missing:
            if not any(place.iterdir()):
                run.empty.add(place)
            return place
        top, held = missing[-1], ExitStack()
        run.made[top] = held.enter_context(temporary_folder(top.parent)), held
    return run.made[top][0]


def _refuse_devices(target: Path) -> None:
    if target.exists() and not target.is_file() and not target.is_dir():
        raise InputError(f"{target}: expected the name of a file to write, it is a device or a pipe: give another name")


def _refuse_existing(target: Path, run: _Outputs) -> None:
    if target.is_dir():
        raise OverwriteError(f"{target}: expected the name of a file to write, it is a folder: give another name")
    if not target.is_file():
        return
    check_not_read(target, run)
    if not run.force and not _is_own(absolute(target)):
        raise OverwriteError(f"{target} exists and is kept: give another name, or --force to replace it")


def check_not_read(path: Path, run: _Outputs | None = None) -> None:
    """Raise OverwriteError if the command that runs has read this file, whatever is to be done to it."""
    run = _outputs if run is None else run
    if run is not None and path.is_file() and _identity(path) in run.inputs:
        raise OverwriteError(f"{path} was read by this command and is not written over: give another name to write to")


def _identity(path: Path) -> tuple[int, int]:
    """What a file is by whatever name: device and number on it."""
    status = path.stat()
    return status.st_dev, status.st_ino


def _is_own(target: Path) -> bool:
    """Whether an earlier command wrote this file into a folder it made, and nobody has changed it since."""
    top = _marked(target)
    return top is not None and _checksum(target) in _listed(top).get(target.relative_to(top).as_posix(), ())


def _marked(target: Path) -> Path | None:
    return next((folder for folder in target.parents if (folder / LISTED).is_file()), None)


def _listed(top: Path) -> dict[str, list[str]]:
    """Checksums of the files that commands wrote into a folder, by their names; none if the list is damaged."""
    try:
        entries = json.loads((top / LISTED).read_text(encoding="utf-8"))["files"]
        return {name: [str(checksum) for checksum in checksums] for name, checksums in entries.items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return {}


def _put_in_place(run: _Outputs) -> None:
    """Give every waiting file its name, folders first; all are looked at before the first is moved."""
    lists: dict[Path, dict[str, list[str]]] = {}
    for target, (temporary, _) in run.waiting.items():
        if not any(folder in run.made for folder in target.parents):
            _refuse_existing(target, run)
        top = _marked(target) or next((f for f in reversed(target.parents) if f in run.made or f in run.empty), None)
        if top is not None:
            earlier = lists.setdefault(top, _listed(top))
            name = target.relative_to(top).as_posix()
            earlier[name] = [*earlier.get(name, [])[-1:], _checksum(temporary)]  # either may be there after a kill
    for top in run.made:
        if top.exists():
            raise InputError(_MADE_MEANWHILE.format(top))
    for top, entries in lists.items():
        folder = run.made[top][0] if top in run.made else top
        text = json.dumps({"written by": "schuler; files that are still as listed may be replaced", "files": entries})
        write_text(folder / LISTED, text, at_once=True)
    with _undisturbed():
        for top, (folder, _) in run.made.items():
            for target, (temporary, held) in run.waiting.items():
                if top in target.parents:
                    place = folder / target.relative_to(top)
                    place.parent.mkdir(parents=True, exist_ok=True)
                    os.replace(temporary, place)
                    held.close()
            _name(folder, top)
        for target, (temporary, _) in run.waiting.items():
            if not any(top in target.parents for top in run.made):
                os.replace(temporary, target)


def _name(folder: Path, place: Path) -> None:
    """Give a hidden folder its name, which another run may have taken in this moment."""
    os.chmod(folder, 0o777 & ~_umask())
    try:
        os.rename(folder, place)
    except OSError as error:
        if place.exists():
            raise InputError(_MADE_MEANWHILE.format(place)) from None
        error.filename, error.filename2 = str(place), None  # the name that the user knows
        raise


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Hold interrupts and requests to end back until the block has ended: of several files all are new, or none."""
    if threading.current_thread() is not threading.main_thread():  # where Python never delivers them
        yield
        return
    came: list[int] = []
    earlier = {n: signal.signal(n, lambda number, _: came.append(number)) for n in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in earlier.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        if came:
            signal.raise_signal(came[0])


@cache
def package_version() -> str:
    """Version of this package, for the provenance of results; reading it takes as long as fitting accelerometers."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("schuler")
    except PackageNotFoundError:
        return "not installed"


def sha256(path: Path | str) -> str:
    """SHA-256 of a file's bytes as hexadecimal text, for the provenance of results."""
    note_input(path)
    return _checksum(Path(path))


def _checksum(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        while block := stream.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def note_input(path: Path | str) -> None:
    """Keep a file that is read from being replaced by the command that reads it, see :func:`outputs`."""
    if _outputs is not None:
        with suppress(OSError):
            _outputs.inputs.add(_identity(Path(path)))


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
    for path in paths:
        note_input(path)

    def work() -> dict[str, str]:
        return {path.name if root is None else path.relative_to(root).as_posix(): sha256(path) for path in paths}

    if sum(path.stat().st_size for path in paths) < _MANY:
        yield work
        return
    with ThreadPoolExecutor(1) as pool:
        yield pool.submit(work).result


def json_text(data: dict[str, Any]) -> str:
    """One JSON object as text; numbers that do not exist become null."""
    return json.dumps(_plain(data), indent=1, allow_nan=False)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(v) for v in value]
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, (np.integer, np.bool_)):
        return value.item()
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    return value
