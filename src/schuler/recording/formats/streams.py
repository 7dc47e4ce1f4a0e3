"""Streams of a log that holds many: topics of a bag, messages of an autopilot, instances of a sensor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError


@dataclass(frozen=True, slots=True)
class Stream:
    """One stream of a log.

    Attributes
    ----------
    name : str
        As the hint ``streams`` names it.
    kind : str
        Type of its messages.
    count : int
        Number of messages.
    start, stop : float, optional
        First and last time on the log's own clock, as it stands there. [s]
    part : str
        Part of a recording it can be ("imu", "gnss", "reference", ...); empty if none.
    """

    name: str
    kind: str
    count: int
    start: float | None = None
    stop: float | None = None
    part: str = ""

    @property
    def rate_hz(self) -> float | None:
        """Mean rate over the span; ``None`` for fewer than two messages."""
        if self.start is None or self.stop is None or self.count < 2 or self.stop <= self.start:
            return None
        return (self.count - 1) / (self.stop - self.start)


def stream_of(name: str, kind: str, t: FloatArray, part: str = "") -> Stream:
    """Stream of the times of its messages. Shape (n,). [s]"""
    good = t[np.isfinite(t)]
    start, stop = (float(good.min()), float(good.max())) if len(good) else (None, None)
    return Stream(name, kind, len(t), start, stop, part)


def choose(streams: list[Stream], part: str, chosen: dict[str, str | None], *, alone: bool = True) -> Stream | None:
    """The stream to take for a part: the one the hint names, or the only one there is.

    Parameters
    ----------
    streams : list of Stream
        All of the log.
    part : str
    chosen : dict
        Of :func:`schuler.recording.io.hint_texts.parse_streams`.
    alone : bool
        Whether an only candidate is taken without being named.

    Returns
    -------
    Stream or None
        ``None`` if there is no candidate, or the part is to be left out.

    Raises
    ------
    InputError
        If there are several candidates and the hint names none, or it names one that is not there.
    """
    candidates = [s for s in streams if s.part == part and s.count > 0]
    names = ", ".join(f"{s.name} ({s.kind}, {s.count})" for s in candidates) or "none"
    if part in chosen:
        name = chosen[part]
        if name is None:
            return None
        for stream in candidates:
            if stream.name == name:
                return stream
        others = [s for s in streams if s.name == name]
        why = f"holds {others[0].count} messages of {others[0].kind}" if others else "is not in the log"
        raise InputError(f"streams: {name!r} {why}; candidates for {part}: {names}")
    if not candidates or not alone:
        return None
    if len(candidates) > 1:
        raise InputError(
            f"several streams can be the {part}: {names}; say which with streams='{part}={candidates[0].name}', "
            f"or leave it out with streams='{part}=none'"
        )
    return candidates[0]


def table(streams: list[Stream]) -> str:
    """Streams as lines of text: name, type, number, rate, span, and the part each can be."""
    rows = [("stream", "type", "number", "rate", "from", "to", "can be")]
    for s in streams:
        rate = "" if s.rate_hz is None else f"{s.rate_hz:.4g} Hz"
        span = ["" if t is None else f"{t:.3f} s" for t in (s.start, s.stop)]
        rows.append((s.name, s.kind, str(s.count), rate, *span, s.part))  # type: ignore[arg-type]
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    right = (2, 3, 4, 5)
    return "\n".join(
        "  ".join(
            f"{field:>{w}}" if k in right else f"{field:<{w}}"
            for k, (field, w) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    )
