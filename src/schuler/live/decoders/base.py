"""What decoders of streams have in common."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from schuler.exceptions import InputError
from schuler.live.messages import Fix, Heading, ImuBlock, Message, parted
from schuler.recording.io import columns, parts
from schuler.recording.io.assemble import turned
from schuler.recording.io.hint_texts import axes_matrix, parse_streams
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.over_ground import NO_VELOCITY
from schuler.recording.io.parts import Table
from schuler.recording.io.raw import Raw
from schuler.recording.series import GnssSeries, Kind
from schuler.timebase import TimeBase


class Decoder(Protocol):
    """A parser that is fed piece by piece."""

    @property
    def left_out(self) -> Counter[str]:
        """Pieces of no use, counted by a phrase that says which and why."""
        ...

    @property
    def kind(self) -> Kind | None:
        """Whether samples of an IMU are rates or increments; ``None`` if the stream is not known to hold one."""
        ...

    def feed(self, data: bytes, arrival: float) -> list[Message]:
        """Messages that some more bytes complete.

        Parameters
        ----------
        data : bytes
        arrival : float
            When they came, GPS time since 1980 by the clock of this machine. [s]
        """
        ...

    def pause(self) -> list[Message]:
        """Messages that are complete because nothing more has come for a while."""
        ...

    def finish(self) -> list[Message]:
        """Messages that the end of the stream completes."""
        ...


def fixes(series: GnssSeries, shift: float = 0.0) -> Iterator[Fix]:
    """Fixes of a series, one by one; a velocity that is missing at a single epoch is none.

    Parameters
    ----------
    series : GnssSeries
    shift : float
        Added to the times. [s]
    """
    for k, t in enumerate((series.t + shift).tolist()):
        v_n, cov_v_n = None, None
        if series.v_n is not None and series.cov_v_n is not None and series.cov_v_n[k, 0, 0] < NO_VELOCITY**2:
            v_n, cov_v_n = series.v_n[k], series.cov_v_n[k]
        yield Fix(
            t, series.llh[k], series.cov_r_n[k], v_n, cov_v_n,
            None if series.quality is None else int(series.quality[k]),
            None if series.n_satellites is None else int(series.n_satellites[k]),
        )  # fmt: skip


def wanted(hints: ReadHints, part: str) -> bool:
    """Whether a part of a recording is to be taken from a stream that may hold it."""
    chosen = parse_streams(hints.streams)
    return hints.series in (None, part) and (part not in chosen or chosen[part] is not None)


def fix_of(table: Table, hints: ReadHints, left_out: Counter[str]) -> list[Fix]:
    """The fix of a table with one row, as a log of it would be read; none, and counted, if it is refused.

    Parameters
    ----------
    table : Table
    hints : ReadHints
        As for a log.
    left_out : Counter
        Takes the reason.
    """
    try:
        series, _ = parts.series_of(Path("GNSS"), "gnss", table, hints, TimeBase("local"))
    except InputError as error:
        left_out[f"epochs: {error}"] += 1
        return []
    return list(fixes(series))


def heading_of(table: Table, hints: ReadHints, left_out: Counter[str]) -> list[Heading]:
    """The heading of a table with one row, with the arguments of :func:`fix_of`."""
    try:
        series, _ = parts.series_of(Path("heading"), "heading", table, hints, TimeBase("local"))
    except InputError as error:
        left_out[f"headings: {error}"] += 1
        return []
    return [Heading(float(series.t[0]), float(series.value[0]), float(series.sigma[0]))]


def in_order(measurements: Sequence[Fix | Heading], block: ImuBlock | None) -> list[Message]:
    """Messages of a piece of a stream by time: each measurement before the sample of its time, as in a replayed log.

    A long piece holds seconds; fixes that are so far ahead of the samples would make another start.
    """
    made: list[Message] = []
    for measurement in sorted(measurements, key=lambda m: m.t):
        if block is not None and (count := int(np.searchsorted(block.t, measurement.t))):
            before, block = parted(block, count)
            made.append(before)
        made.append(measurement)
    return made if block is None or not len(block.t) else [*made, block]


def samples(table: Table, hints: ReadHints) -> ImuBlock:
    """Samples of an IMU, forward, right, down, as those of a log; they are not checked here.

    Parameters
    ----------
    table : Table
        In SI, with the axes it states.
    hints : ReadHints
        ``axes`` over those, ``offset``.
    """
    raw, C_bs = Raw(Path("IMU"), table.values), axes_matrix(parts.axes_of(table, hints))
    gyro, accel = (turned(raw, names, C_bs) for names in (columns.GYRO, columns.ACCEL))
    return ImuBlock(table.values["t"] + hints.offset, gyro, accel, table.values.get("temp"))
