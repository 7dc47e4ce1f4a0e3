"""What commands share: types of options, JSON on stdout, prose and progress on stderr."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TextIO

from cyclopts import Parameter

from schuler.exceptions import InputError, missing_extra
from schuler.files import check_writable, json_text

if TYPE_CHECKING:
    from schuler.verdict import Verdict

Flag = Annotated[bool, Parameter(negative=())]
#: Text that may begin with a hyphen, as a list of columns does of which the first is passed over.
Dashed = Annotated[str | None, Parameter(allow_leading_hyphen=True)]
Texts = Annotated[tuple[str, ...], Parameter(negative=())]


def _folder(_: Any, path: Path | None) -> None:
    """Refuse, before hours of work, a folder that cannot be made because a file has its name."""
    for file in () if path is None else (path, *path.parents):
        if file.exists() and not file.is_dir():  # devices too
            expected = "Expected a folder, which is made where it is missing"
            raise ValueError(f"{expected}; {file} is a file: give another name.")
    if path is not None:
        try:
            check_writable(path)
        except OSError as error:
            reason = f"{path} cannot be written: {error.strerror}"
            raise ValueError(f"Expected a place to write to; {reason}: give another name.") from None


def writable(folder: Path) -> Path:
    """A folder for results that no option names, refused before the work if it cannot be written."""
    try:
        _folder(None, folder)
    except ValueError as error:
        raise InputError(str(error)) from None
    return folder


def _file(_: Any, path: Path | None) -> None:
    if path is None:
        return
    if path.is_dir():
        raise ValueError(f"Expected the name of a file; {path} is a folder: give a file in it, such as {path / 'out'}.")
    _folder(_, path.parent)


#: Where files are written ...
Folder = Annotated[Path | None, Parameter(validator=_folder)]
#: ... and one file.
File = Annotated[Path | None, Parameter(validator=_file)]


_COLOURS = {"ok": "32", "doubtful": "33", "failed": "1;31", "warning": "33", "error": "1;31"}
_QUIET: ContextVar[bool] = ContextVar("quiet", default=False)


@contextmanager
def silenced(quiet: bool) -> Iterator[None]:
    """Leave prose and progress out while it lasts; errors and results come all the same."""
    token = _QUIET.set(quiet)
    try:
        yield
    finally:
        _QUIET.reset(token)


def is_quiet() -> bool:
    """Whether prose and progress are left out."""
    return _QUIET.get()


def say(text: str, kind: str = "") -> None:
    """Prose, to stderr; an "error" or a "warning" in its colour on a terminal."""
    if not is_quiet():
        print(coloured(text, kind, sys.stderr), file=sys.stderr)


def complain(text: str) -> None:
    """What ends a command, to stderr, its first word in red on a terminal."""
    with suppress(OSError):  # on a full disk the exit code is left to say it
        print(f"{coloured('schuler:', 'error', sys.stderr)} {text}", file=sys.stderr)


def coloured(text: str, kind: str, stream: TextIO) -> str:
    """Text in the colour of a kind on a terminal that wants colours (NO_COLOR)."""
    plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
    if kind not in _COLOURS or plain or not stream.isatty():
        return text
    return f"\x1b[{_COLOURS[kind]}m{text}\x1b[0m"


def drawable(wanted: bool) -> bool:
    """Whether figures are written as files; without matplotlib they are not, which is said before the work."""
    error = missing_extra("matplotlib", "plot", "drawing them") if wanted else None
    if error is not None:
        say(f"no figures as files: {error}")
    return wanted and error is None


def tabled() -> bool:
    """Whether tables of solutions are written; without pyarrow they are not, which is said before the work."""
    error = missing_extra("pyarrow", "data", "writing Parquet")
    if error is not None:
        say(f"no table of the solution: {error}")
    return error is None


def print_verdict(verdict: Verdict) -> None:
    """A verdict on stdout, its first line in green, yellow or red on a terminal."""
    first, *rest = verdict.summary().splitlines()
    print("\n".join([coloured(first, verdict.status, sys.stdout), *rest]))


def print_json(data: dict[str, Any]) -> None:
    """One JSON object on stdout; numbers that do not exist become null."""
    print(json_text(data))


def named(figures: Iterable[Path]) -> dict[str, Path]:
    """Files of figures by the names that JSON has for them."""
    return {f"figure_{path.stem}_{path.suffix[1:]}": path for path in figures}


@contextmanager
def progress(what: str, *, total: int | None = None, unit: str = "") -> Iterator[Callable[[float], None] | None]:
    """A progress bar on stderr if that is a terminal; yields a function of the fraction done, or None.

    With a total number of things the bar also says how many are done and how many a second. The time left follows the
    speed since the first call, which may come with a part that was done before. Where the variable SCHULER_PROGRESS
    names a file, the fraction is written there instead, for a program that started this one.
    """
    if (place := os.environ.get("SCHULER_PROGRESS")) is not None:
        yield partial(_note_fraction, Path(place))
        return
    if _QUIET.get() or not sys.stderr.isatty():
        yield None
        return
    import time

    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn() if total is None else TextColumn("{task.fields[rate]}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=1.0, rate="")
        begin: list[float] = []

        def report(fraction: float) -> None:
            if not begin:
                begin[:] = [fraction, time.monotonic()]
            rate = (
                ""
                if total is None
                else rate_text(fraction - begin[0], fraction, time.monotonic() - begin[1], total, unit)
            )
            bar.update(task, completed=fraction, rate=rate)

        yield report


def _note_fraction(place: Path, fraction: float) -> None:
    """Write the fraction done into a file, which is never seen half-written."""
    temporary = place.with_name(f"{place.name}.new")
    temporary.write_text(f"{fraction:.4f}", encoding="ascii")
    os.replace(temporary, place)


def rate_text(gained: float, fraction: float, seconds: float, total: int, unit: str) -> str:
    """How many are done, how many a second, and how long the rest takes at that speed.

    Parameters
    ----------
    gained : float
        Fraction done in ...
    fraction : float
        Fraction done in all.
    seconds : float
        ... so many seconds.
    total : int
    unit : str
    """
    done = f"{round(fraction * total)} of {total} {unit}"
    if gained <= 0.0 or seconds <= 0.0:
        return done
    left = round((1.0 - fraction) / gained * seconds)
    clock = f"{left // 3600}:{left // 60 % 60:02d}:{left % 60:02d}"
    return f"{done}, {gained * total / seconds:.3g} {unit}/s, {clock} left"
