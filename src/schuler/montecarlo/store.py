"""Results of a campaign in a folder: a part for every batch that finished, one table at the end.

A part is written under another name and renamed when it is whole, so it is there or it is not. What the campaign is of
stands in ``manifest.json``. When all runs are there, the parts become ``runs.parquet``, sorted by run: the same bytes
whatever happened on the way.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from schuler.exceptions import FileFormatError, InputError
from schuler.files import package_version, write_text
from schuler.montecarlo.part_file import FORMAT, document_of, pieces, pyarrow_needed, writer
from schuler.montecarlo.rows import Rows

MANIFEST, TABLE = "manifest.json", "runs.parquet"
_PART = re.compile(r"part-(\d{10})-(\d{10})\.parquet")


class Span(NamedTuple):
    """Runs ``first`` to ``last``, both included."""

    first: int
    last: int

    @property
    def runs(self) -> int:
        """How many."""
        return self.last - self.first + 1


class Store:
    """The folder of a campaign, open for writing; see :func:`opened`."""

    def __init__(self, folder: Path, identity: Mapping[str, Any]) -> None:
        self.folder, self.identity = folder, dict(identity)
        self._files: dict[Span, Path] = {}
        for path in sorted(folder.iterdir()):
            if path.name.startswith((".part-", f".{TABLE}", f".{MANIFEST}")):
                path.unlink()  # half written when something ended the campaign
            elif match := _PART.fullmatch(path.name):
                self._files[Span(int(match[1]), int(match[2]))] = path
        table = folder / TABLE
        if table.is_file():
            stored = Span(0, document_of(table)["runs"] - 1)
            for span in [s for s in self._files if s.last <= stored.last]:
                self._files.pop(span).unlink()  # the table was made, but its parts not yet taken away
            self._files[stored] = table

    @property
    def stored(self) -> int:
        """Number of runs in it."""
        return sum(span.runs for span in self._files)

    def missing(self, runs: int) -> list[Span]:
        """Runs from 0 to ``runs - 1`` that are not there."""
        gaps, following = [], 0
        for span in sorted(self._files):
            if span.first > following:
                gaps.append(Span(following, min(span.first, runs) - 1))
            following = max(following, span.last + 1)
            if following >= runs:
                break
        if following < runs:
            gaps.append(Span(following, runs - 1))
        return [g for g in gaps if g.runs > 0]

    def put(self, span: Span, rows: Rows) -> None:
        """Store the runs of a batch; afterwards nothing but the loss of the disk takes them away."""
        path = self.folder / f"part-{span.first:010d}-{span.last:010d}.parquet"
        with writer(path, rows, {**self.identity, "first": span.first, "runs": span.runs}, rows.failures) as write:
            write(rows)
        self._files[span] = path

    def rows(self, runs: int) -> Iterator[Rows]:
        """What is stored of runs 0 to ``runs - 1``, in order, a piece at a time."""
        for span in sorted(self._files):
            for piece in pieces(self._files[span]):
                kept = piece.where(0, runs - 1)
                if len(kept.runs) or kept.failures:
                    yield kept

    def finish(self) -> Path:
        """Make one table of the parts, all of whose runs are there.

        Raises
        ------
        InputError
            If runs are missing.
        """
        table, runs = self.folder / TABLE, self.stored
        if self.missing(runs):
            raise InputError(f"{self.folder}: not all runs are there; go on with the campaign first")
        parts = [span for span, path in self._files.items() if path != table]
        if not parts:
            return table
        failures: dict[int, str] = {}
        like: Rows | None = None
        for span in sorted(self._files):
            held = document_of(self._files[span])
            failures |= {int(k): why for k, why in held["failures"].items()}
            if like is None and held["columns"]:
                like = next(piece for piece in pieces(self._files[span]) if len(piece.runs))
        empty = Rows(np.zeros(0, dtype=np.int64), {})
        with writer(table, like or empty, {**self.identity, "first": 0, "runs": runs}, failures) as write:
            for rows in self.rows(runs):
                write(rows)
        for span in parts:
            self._files.pop(span).unlink()
        self._files = {Span(0, runs - 1): table}
        return table


@contextmanager
def opened(folder: Path | str, identity: Mapping[str, Any], *, resume: bool = True) -> Iterator[Store]:
    """Open the store of a campaign, or make it.

    Parameters
    ----------
    folder : Path or str
    identity : dict
        Identity of the campaign: ``function``, ``scenario`` (fingerprints), ``seed``, ``schuler`` (version), and
        ``about`` for people to read.
    resume : bool
        False refuses a folder that holds runs.

    Raises
    ------
    InputError
        If the folder is the store of another campaign or of something else, or another process is writing to it.
    MissingExtraError
        Without pyarrow (extra ``data``).
    """
    pyarrow_needed()
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: expected a folder for the results of the campaign, this is a file")
    folder.mkdir(parents=True, exist_ok=True)
    _refuse_other(folder)  # before anything is left in it
    about = identity.get("about")
    identity = {k: v for k, v in identity.items() if k != "about"}
    with _alone(folder):
        path = folder / MANIFEST
        if path.is_file():
            _check(read_manifest(folder), identity, folder)
        else:
            _refuse_other(folder)
            document = {"format": FORMAT, **identity, "about": about}
            write_text(path, json.dumps(document, indent=1, sort_keys=True) + "\n", at_once=True)
        store = Store(folder, identity)
        if store.stored and not resume:
            raise InputError(
                f"{folder} already holds {store.stored} runs of this campaign; say that you want to go on with it "
                "(--resume, resume=True) or give another folder"
            )
        yield store


def _refuse_other(folder: Path) -> None:
    """Raise InputError if a folder holds files and is no store."""
    strange = [p.name for p in sorted(folder.iterdir()) if not p.name.startswith(".")]
    if strange and MANIFEST not in strange:
        raise InputError(
            f"{folder}: expected an empty folder or the store of a campaign, it holds {strange[0]}; give another folder"
        )


def read_manifest(folder: Path | str) -> dict[str, Any]:
    """What the campaign of a store is of.

    Raises
    ------
    FileFormatError
        If the folder is no store, or of a version of this package that this one does not know.
    """
    path = Path(folder) / MANIFEST
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise FileFormatError("no such file: the folder is not the store of a campaign", path) from None
    except (ValueError, RecursionError) as error:
        raise FileFormatError(f"not a manifest of a campaign: {error}", path) from None
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        what = manifest.get("format") if isinstance(manifest, dict) else manifest
        raise FileFormatError(f"expected the format {FORMAT}, got {what!r}", path)
    return manifest


def read_rows(folder: Path | str) -> Iterator[Rows]:
    """All runs of a store, ascending, a piece at a time; also while a campaign is still filling it."""
    folder = Path(folder)
    read_manifest(folder)
    paths = {}
    for path in folder.iterdir():
        if match := _PART.fullmatch(path.name):
            paths[int(match[1])] = path
    table, after = folder / TABLE, 0
    if table.is_file():
        after = document_of(table)["runs"]
        yield from pieces(table)
    for first in sorted(k for k in paths if k >= after):
        yield from pieces(paths[first])


_DIFFERENT = {
    "scenario": "of another scenario",
    "function": "of another function",
    "seed": "with another seed",
    "schuler": "of another version of schuler",
}


def _check(manifest: Mapping[str, Any], identity: Mapping[str, Any], folder: Path) -> None:
    wrong = [name for name in identity if manifest.get(name) != identity[name]]
    if not wrong:
        return
    name = wrong[0]
    raise InputError(
        f"{folder} is the store of a campaign {_DIFFERENT.get(name, f'with another {name}')} "
        f"({_short(manifest.get(name))}; this one is {_short(identity[name])}); give another folder, or run with what "
        "it was begun with: runs of two campaigns are never mixed"
    )


def _short(value: Any) -> str:
    text = str(value)
    return text[:12] + "..." if re.fullmatch(r"[0-9a-f]{64}", text) else text


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Keep others from writing to the folder; the system takes the lock away when the process ends, however."""
    path = folder / ".lock"
    with path.open("a") as handle:
        try:
            import fcntl
        except ImportError:  # not on Windows: two campaigns at once are then up to the user
            yield
            return
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(f"{folder}: another process is running this campaign; wait for it or end it") from None
        yield


def identity_of(function: str, scenario: str, seed: int, about: Any) -> dict[str, Any]:
    """What a campaign is of, for :func:`opened`."""
    return {
        "function": function,
        "scenario": scenario,
        "seed": seed,
        "schuler": package_version(),
        "about": about,
    }
