"""Streams of a log that holds many: topics of a bag, messages of an autopilot, instances of a sensor."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError, InputError

_SAME_S = 1e-6
_PAUSE = 5.0  # sample intervals; nothing is interpolated over a longer one


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
        Result of :func:`schuler.recording.io.hint_texts.parse_streams`.
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


def joined(
    t_a: FloatArray, f: FloatArray, t_g: FloatArray, w: FloatArray, path: Path, notes: list[str]
) -> dict[str, FloatArray]:
    """Columns of an IMU at the times of its gyro; specific forces are interpolated linearly to them.

    Parameters
    ----------
    t_a, t_g : ndarray, shape (n,), (m,)
        Increasing times of specific forces and of rates. [s]
    f, w : ndarray, shape (n, 3), (m, 3)
        [m/s^2], [rad/s]
    path : Path
        For messages.
    notes : list of str
        Takes a sentence where times differ.

    Raises
    ------
    FileFormatError
        If the two have no time in common.

    Notes
    -----
    Rates are left as they are, since their integral is attitude; a linear interpolation takes up to half of the noise
    variance of a specific force away and delays nothing.
    """
    names = ("ax", "ay", "az", "gx", "gy", "gz")
    if len(t_a) == len(t_g) and np.abs(t_a - t_g).max() < _SAME_S:
        return {"t": t_g, **dict(zip(names, np.column_stack((f, w)).T, strict=True))}
    inside = (t_g >= t_a[0]) & (t_g <= t_a[-1])
    if len(t_a) > 2:
        step = np.diff(t_a)
        within = np.clip(np.searchsorted(t_a, t_g, side="right") - 1, 0, len(step) - 1)
        pause = inside & (step[within] > _PAUSE * np.median(step))
        if pause.any():
            inside &= ~pause
            notes.append(f"{int(pause.sum())} rates fall into pauses of the accelerometer and were left out.")
    if inside.sum() < 2:
        raise FileFormatError(
            f"accelerometer ({t_a[0]:.3f}..{t_a[-1]:.3f} s) and gyro ({t_g[0]:.3f}..{t_g[-1]:.3f} s) have no time in "
            "common",
            path,
        )
    at = np.stack([np.interp(t_g[inside], t_a, f[:, k]) for k in range(3)], axis=1)
    notes.append("Accelerometer and gyro have stamps of their own; specific forces were interpolated to the gyro's.")
    return {"t": t_g[inside], **dict(zip(names, np.column_stack((at, w[inside])).T, strict=True))}
