"""Files dropped onto a page: streamed to disk, bounded, under their name only when they are complete."""

from __future__ import annotations

import shutil
from collections.abc import AsyncIterator
from pathlib import Path

from schuler.exceptions import InputError
from schuler.files import replacing
from schuler.studio.workspace import Workspace

#: Largest file that is taken. [bytes]
LARGEST = 4 << 30
_SPARE = 256 << 20  # bytes of the disk that an upload leaves free


def target_of(workspace: Workspace, name: str, size: int | None) -> Path:
    """Place of a file that is to be uploaded.

    Parameters
    ----------
    workspace : Workspace
    name : str
        Of the file, without folders.
    size : int or None
        As the browser states it. [bytes]

    Raises
    ------
    InputError
        If the name is none, is taken, or the file is too large for the bound or the disk.
    """
    if name != Path(name).name or not name or len(name) > 200 or not name.isprintable() or "\\" in name:
        raise InputError(f"{name[:80]!r}: expected the name of a file without folders")
    target = workspace.inside(name)
    if target.exists():
        raise InputError(f"{name} is in the folder already and is kept: rename one of the two")
    _check_size(name, size or 0)
    if (size or 0) + _SPARE > shutil.disk_usage(workspace.root).free:
        raise InputError(f"{name}: the disk has no room for it: make room, or copy the file to the folder's own disk")
    return target


async def receive(target: Path, blocks: AsyncIterator[bytes], size: int | None) -> int:
    """Write a stream to a file; the number of bytes.

    Raises
    ------
    InputError
        If it grows beyond the bound, or ends before the size that was stated; nothing is left then.
    """
    written = 0
    with replacing(target, at_once=True) as temporary:
        with temporary.open("wb") as stream:
            async for block in blocks:
                written += len(block)
                _check_size(target.name, written)
                stream.write(block)
        if size is not None and written != size:
            raise InputError(f"{target.name}: expected {size} bytes, got {written}: upload it again")
    return written


def _check_size(name: str, size: int) -> None:
    if size > LARGEST:
        raise InputError(
            f"{name}: expected at most {LARGEST >> 30} GiB through the browser, got more: copy it into the folder"
        )
