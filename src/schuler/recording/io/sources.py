"""The hashes of the files a recording is made of, taken while other work goes on."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

from schuler import files

_MANY = 4_000_000  # bytes that are worth a thread


@contextmanager
def hashed(paths: Iterable[Path], root: Path | None = None) -> Iterator[Callable[[], dict[str, str]]]:
    """Yield a function that returns the SHA-256 of each file by its name; large files are read beside what follows.

    Parameters
    ----------
    paths : iterable of Path
    root : Path, optional
        Folder from which on files are named: those of a data set may all be called alike.
    """
    paths = list(paths)

    def work() -> dict[str, str]:
        return {path.name if root is None else path.relative_to(root).as_posix(): files.sha256(path) for path in paths}

    if sum(path.stat().st_size for path in paths) < _MANY:
        yield work
        return
    with ThreadPoolExecutor(1) as pool:
        yield pool.submit(work).result
