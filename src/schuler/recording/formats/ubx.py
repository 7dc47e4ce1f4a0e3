"""Logs of u-blox receivers (``.ubx``): raw measurements, broadcast ephemerides and the receiver's own solutions.

Three messages matter: RXM-RAWX, RXM-SFRBX and NAV-PVT. pyubx2 decodes them at about fifty times real time for a log of
4 Hz and 72 measurements an epoch (docs/gnss-receivers.md), which is fast enough to have no decoder of our own.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError, InputError
from schuler.gnss.ephemerides import Ephemerides, no_glonass, no_kepler
from schuler.gnss.observations import Observations
from schuler.recording.formats import ubx_frames, ubx_navigation, ubx_raw, ubx_solution
from schuler.recording.io.assemble import metadata_of
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.lines import check_file
from schuler.recording.recording import Recording
from schuler.recording.series import GnssSeries
from schuler.timebase import WEEK_S, TimeBase

RAWX, SFRBX, PVT = 0x0215, 0x0213, 0x0107
_SENSORS = (0x1002, 0x1003)  # ESF-MEAS, ESF-RAW
_USED = {"name", "series"}


@dataclass(frozen=True)
class UbxLog:
    """What a u-blox log holds, all on one time axis.

    Attributes
    ----------
    observations : Observations, optional
        ``None`` if the log has no RXM-RAWX.
    ephemerides : Ephemerides
        Empty if the log has no RXM-SFRBX.
    gnss : GnssSeries, optional
        Of NAV-PVT; ``None`` if the log has none with a fix.
    time : TimeBase
        GPS time from the start of the first epoch's week.
    sigma_range, sigma_rate : ndarray, shape (n,)
        The receiver's own 1-sigma of each row of ``observations``. [m], [m/s]
    leap_seconds : int, optional
        GPS - UTC as the receiver (or the satellites) said. [s]
    notes : tuple of str
        On everything that was left out or assumed.
    """

    observations: Observations | None
    ephemerides: Ephemerides
    gnss: GnssSeries | None
    time: TimeBase
    sigma_range: FloatArray
    sigma_rate: FloatArray
    leap_seconds: int | None
    notes: tuple[str, ...]


def looks_like_ubx(head: bytes) -> bool:
    """Whether the first bytes of a file hold a frame of u-blox, whatever its suffix; NMEA may come before."""
    return bool(ubx_frames.find_frames(head).spans)


def read_ubx(path: Path | str) -> UbxLog:
    """Read a u-blox log.

    Parameters
    ----------
    path : Path or str
        As logged: UBX frames, perhaps with NMEA sentences between them.

    Returns
    -------
    UbxLog

    Raises
    ------
    FileFormatError
        If the file holds none of RXM-RAWX, RXM-SFRBX and NAV-PVT, or no time.
    MissingExtraError
        If pyubx2 is not installed.

    Notes
    -----
    RXM-SFRBX has no time of its own; a message is given that of the last RXM-RAWX or NAV-PVT before it, which only has
    to be right to some days.
    """
    path = Path(path)
    check_file(path)
    frames = ubx_frames.find_frames(path.read_bytes())
    decode, notes = ubx_frames.decoder(), frames.notes()
    by_kind: dict[int, list[tuple[int, dict[str, Any]]]] = {RAWX: [], SFRBX: [], PVT: []}
    unreadable = 0
    for order, (kind, first, stop) in enumerate(frames.spans):
        if kind not in by_kind:
            continue
        try:
            if not _is_whole(kind, frames.data[first + 6 : stop - 2]):
                raise ValueError("shorter than its contents")
            by_kind[kind].append((order, decode(frames.data[first:stop])))
        # a payload of another length than its counter says; pyubx2 does not list its errors
        except Exception:
            unreadable += 1
    if sensors := sum(kind in _SENSORS for kind, _, _ in frames.spans):
        notes.append(
            f"{sensors} frames ESF-MEAS and ESF-RAW were not read: u-blox does not say the unit of their time tags, "
            "so the samples of its IMU cannot be timed; log another IMU."
        )
    if unreadable:
        notes.append(f"{unreadable} frames were not of the length their contents call for and were left out.")
    if not any(by_kind.values()):
        raise FileFormatError(
            f"expected u-blox messages RXM-RAWX, RXM-SFRBX or NAV-PVT, found {len(frames.spans)} frames of other kinds "
            f"and {frames.sentences} NMEA sentences: enable these messages, or read it as NMEA",
            path,
        )
    raw = ubx_raw.raw_epochs(m for _, m in by_kind[RAWX])
    start = None if raw is None else raw.observations.epoch_gps_s
    gnss, pvt_start, more = ubx_solution.solutions((m for _, m in by_kind[PVT]), start)
    start = pvt_start if start is None else start
    notes += list(raw.observations.notes if raw is not None else ()) + more
    ephemerides = _ephemerides(by_kind)
    notes += ephemerides.notes
    if not np.isfinite(start):
        raise FileFormatError(
            "no message of the log says the time (RXM-RAWX or NAV-PVT with a fix): the log is of a receiver that had "
            "none yet, or these messages were not enabled",
            path,
        )
    leap = raw.leap_seconds if raw is not None and raw.leap_seconds is not None else ephemerides.leap_seconds
    empty = np.empty(0)
    return UbxLog(
        None if raw is None else raw.observations,
        ephemerides,
        gnss,
        TimeBase("gps", float(start)),
        empty if raw is None else raw.sigma_range,
        empty if raw is None else raw.sigma_rate,
        leap,
        tuple(notes),
    )


def _is_whole(kind: int, payload: bytes) -> bool:
    """Whether a payload is as long as its counter says (UBX-22008968, 3.15.14, 3.17.5, 3.17.9); polls have none."""
    if kind == RAWX:
        return len(payload) >= 16 + 32 * (payload[11] if len(payload) > 11 else 0)
    if kind == SFRBX:
        return len(payload) >= 8 + 4 * (payload[4] if len(payload) > 4 else 0)
    return len(payload) >= 84  # 92 since protocol 15


def read_ubx_recording(path: Path, hints: ReadHints) -> Recording:
    """A u-blox log as a recording: the receiver's own solutions, its raw measurements, and what was broadcast.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``name`` only: the log says everything else itself. An ``offset`` would give the measurements a wrong time of
        reception; shift the log of the IMU instead.

    Raises
    ------
    FileFormatError
        As :func:`read_ubx`, or if the log holds subframes only.
    InputError
        If hints are given that the log answers itself.
    """
    if surplus := sorted(set(hints.given()) - _USED):
        raise InputError(f"{path} is a u-blox log and says this itself; leave out {', '.join(surplus)}")
    log = read_ubx(path)
    if log.gnss is None and log.observations is None:
        raise FileFormatError("the log holds neither NAV-PVT with a fix nor RXM-RAWX with measurements", path)
    broadcast = log.ephemerides if len(log.ephemerides.kepler) + len(log.ephemerides.glonass) else None
    return Recording(
        gnss=log.gnss,
        observations=log.observations,
        ephemerides=broadcast,
        metadata=metadata_of(path, hints, log.time, log.notes),
    )


def _ephemerides(by_kind: dict[int, list[tuple[int, dict[str, Any]]]]) -> Ephemerides:
    """Ephemerides of the subframes, each with the time of the solution or measurement before it."""
    known: list[tuple[int, float]] = [
        (order, m["week"] * WEEK_S + m["rcvTow"]) for order, m in by_kind[RAWX] if m["week"] > 0
    ]
    times = ubx_solution.solution_times([m for _, m in by_kind[PVT]]).sum(axis=1)
    known += [(order, t) for (order, _), t in zip(by_kind[PVT], times.tolist(), strict=True) if np.isfinite(t)]
    known.sort()
    if not known or not by_kind[SFRBX]:
        note = (f"{len(by_kind[SFRBX])} navigation messages come without any time.",) if by_kind[SFRBX] else ()
        return Ephemerides(no_kepler(), no_glonass(), notes=note)
    orders = np.array([order for order, _ in known])
    places = np.searchsorted(orders, [order for order, _ in by_kind[SFRBX]]) - 1
    near = [known[max(int(k), 0)][1] for k in places]
    return ubx_navigation.broadcast(zip((m for _, m in by_kind[SFRBX]), near, strict=True))
