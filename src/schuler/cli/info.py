"""``schuler info``: what is in a log, streams first where it has many."""

from __future__ import annotations

from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import Any

from schuler.cli.convert import described
from schuler.cli.output import Flag, print_json
from schuler.cli.reading import LogHints
from schuler.diagnosis.result import as_options
from schuler.exceptions import InputError, SchulerError
from schuler.files import check_log
from schuler.recording.io.streams import Stream, table

_HINTS = LogHints()
#: Modules of formats that are found by their suffix or looks (``recording.io.dispatch``), and the extras they need.
_PLAIN = (
    ("text", None),
    ("parquet", "data"),
    ("rtklib", None),
    ("rinex_observation", None),
    ("ubx", None),
    ("nmea", None),
    ("matlab", None),
    ("numpy_files", None),
)


def info(log: Path | None = None, /, *, formats: Flag = False, json: Flag = False, hints: LogHints = _HINTS) -> None:
    """Say what is in a log: series, rates, gaps, accuracy, and every assumption made on reading it.

    Of a log with many streams (bags, autopilots) all are listed, with what each can be. If it cannot be read yet,
    because one has to be chosen or something has to be said, the reason stands below the list.

    Parameters
    ----------
    log
        File or folder.
    formats
        List the formats that can be read instead.
    json
        Print one JSON object instead of text.
    """
    if formats:
        print(known_formats())
        return
    if log is None:
        raise InputError("info: expected a file or folder, or --formats")
    listed = streams_in(log, hints.format)
    if listed is None:
        try:
            recording = hints.read(log)
        except SchulerError:
            from schuler.diagnosis.log import not_a_log

            if (what := not_a_log(log)) is None:
                raise
            raise InputError(f"{log}: this is no log but {what}") from None
        if json:
            print_json(described(recording))
        else:
            print(as_options(recording.summary()))
        return
    content: dict[str, Any] = {}
    try:
        recording = hints.read(log)
    except SchulerError as error:
        if not listed:
            raise
        refused: str | None = str(error)
        outcome = f"not read as a recording yet: {error}"
    else:
        content, refused, outcome = described(recording), None, as_options(recording.summary())
    if json:
        rows = [{**asdict(s), "rate_hz": s.rate_hz} for s in listed]
        print_json({**content, "streams": rows, "not_read": refused})
        return
    print(table(listed))
    print(f"\n{outcome}")


def streams_in(log: Path, name: str | None = None) -> list[Stream] | None:
    """Streams of a log whose format has many; None of other logs.

    Raises
    ------
    SchulerError
        If the log is damaged or its library is missing.
    """
    from schuler.recording.formats import registry
    from schuler.recording.io import lines

    check_log(log)
    if name is not None:
        module = registry.module(name)
    else:
        reader = registry.find_folder(log) if log.is_dir() else registry.find(lines.check_file(log), log)
        if reader is None:
            return None
        module = reader
    contents = getattr(module, "contents", None)
    if contents is None:
        return None
    streams: list[Stream] = contents(log)
    return streams


def known_formats() -> str:
    """Formats that can be read, one a line: name, what it is, the extra it needs, if it is written."""
    from schuler.recording.formats import registry

    written = {name: " ".join(suffixes) or "--to" for name, suffixes, _ in registry.WRITERS}
    written |= {"text": ".csv", "parquet": ".parquet", "rtklib": ".pos"}
    lines = []
    for name, extra in (*registry.FORMATS, *_PLAIN):
        module = import_module(f"schuler.recording.formats.{name}")
        what = (module.__doc__ or "").strip().splitlines()[0].rstrip(".")
        more = [f"written ({written[name]})"] if name in written else []
        more += [f"extra {extra}"] if extra else []
        lines.append(f"{name:<18}{what}{'; ' if more else ''}{', '.join(more)}")
    return "\n".join(lines)
