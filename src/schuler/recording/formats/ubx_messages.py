"""Messages of u-blox receivers: raw measurements (RXM-RAWX), solutions (NAV-PVT), subframes (RXM-SFRBX), signal names.

Identifiers: u-blox F9 HPG 1.32 interface description UBX-22008968, section 1.5 ("GNSS, satellite, and signal
identifiers").
"""

from __future__ import annotations

import datetime as dt
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from schuler import units
from schuler.arrays import FloatArray, IntArray
from schuler.gnss.ephemerides import Ephemerides, no_glonass, no_kepler
from schuler.gnss.messages_beidou import ephemerides_of_d1
from schuler.gnss.messages_galileo import ephemerides_of_inav
from schuler.gnss.messages_glonass import ephemerides_of_strings
from schuler.gnss.messages_gps import ephemerides_of_lnav
from schuler.gnss.observations import Observations
from schuler.gnss.signals import SYSTEM_NAMES, SYSTEMS, wavelengths
from schuler.recording.series import GnssSeries, stated_dilution
from schuler.timebase import WEEK_S, gps_from_calendar

_NAMES = (
    "prMes", "cpMes", "doMes", "gnssId", "svId", "sigId", "freqId", "cno", "prStd", "doStd", "prValid", "cpValid",
    "halfCyc", "locktime",
)  # fmt: skip
_GLONASS = 6
_LONGEST_LOCK_MS = 64_500.0  # UBX-22008968, 3.17.5
#: gnssId to the system's letter; 4 (IMES) is no satellite.
SYSTEM_OF_GNSS_ID = MappingProxyType({0: "G", 1: "S", 2: "E", 3: "C", 5: "J", 6: "R", 7: "I"})
#: (gnssId, sigId) to the RINEX 3 band and attribute. Logs of version 0 (M8) have sigId 0 everywhere.
SIGNAL_OF_SIG_ID = MappingProxyType(
    {
        (0, 0): "1C", (0, 3): "2L", (0, 4): "2S", (0, 6): "5I", (0, 7): "5Q",
        (1, 0): "1C",
        (2, 0): "1C", (2, 1): "1B", (2, 3): "5I", (2, 4): "5Q", (2, 5): "7I", (2, 6): "7Q", (2, 8): "6B",
        (2, 9): "6C", (2, 10): "6A",
        # D1 and D2 are the same signal with another message
        (3, 0): "2I", (3, 1): "2I", (3, 2): "7I", (3, 3): "7I", (3, 4): "6I", (3, 10): "6I", (3, 5): "1P",
        (3, 6): "1D", (3, 7): "5P", (3, 8): "5D",
        (5, 0): "1C", (5, 1): "1Z", (5, 4): "2S", (5, 5): "2L", (5, 8): "5I", (5, 9): "5Q", (5, 12): "1E",
        (6, 0): "1C", (6, 2): "2C",
        (7, 0): "5A",
    }
)  # fmt: skip
_SBAS_OFFSET = 100  # PRN 133 is S33
_MM = 1e-3
_TWO_D, _DEAD_RECKONING = 2, (1, 4)
_ASSUMED_HEIGHT = 100.0  # 1-sigma of the height of a two-dimensional fix, which is held, not measured [m]
_GEOSTATIONARY = (*range(1, 6), *range(59, 64))  # BeiDou satellites that send D2


@dataclass(frozen=True)
class RawEpochs:
    """Measurements of a log and what came with them.

    Attributes
    ----------
    observations : Observations
    sigma_range, sigma_rate : ndarray, shape (n,)
        The receiver's own 1-sigma of each row's pseudorange and range rate. [m], [m/s]
    leap_seconds : int, optional
        GPS - UTC as the receiver knew it at the end of the log; ``None`` if it never did. [s]
    """

    observations: Observations
    sigma_range: FloatArray
    sigma_rate: FloatArray
    leap_seconds: int | None


def raw_epochs(messages: Iterable[dict[str, Any]]) -> RawEpochs | None:
    """Observations of decoded RXM-RAWX messages, ``None`` if there is no usable one.

    Parameters
    ----------
    messages : iterable of dict
        Fields of each message by pyubx2's names, in order of the log.

    Returns
    -------
    RawEpochs or None
        Times are the receiver's own (``rcvTow``), from the start of the first epoch's week. The pseudorange is NaN
        without ``prValid``, the carrier without ``cpValid``; Doppler is positive for an approaching satellite.

    Notes
    -----
    A carrier whose half cycle is not resolved is kept, as RINEX keeps it with a flag, and counted.
    """
    times: list[FloatArray] = []
    first_week = 0
    columns: dict[str, list[list[float]]] = {name: [] for name in _NAMES}
    empty = backwards = resets = 0
    last, leap = -np.inf, None
    for m in messages:
        n, gps_s = m["numMeas"], m["week"] * WEEK_S + m["rcvTow"]
        if m["leapSec"]:
            leap = int(m["leapS"])
        resets += m["clkReset"]
        # before it knows the time a receiver says week 0; beyond a week is damage
        if n == 0 or m["week"] == 0 or not 0.0 <= m["rcvTow"] <= WEEK_S:
            empty += 1
            continue
        if gps_s <= last:
            backwards += 1
            continue
        last = gps_s
        first_week = m["week"] if not times else first_week
        # time of week keeps digits that seconds since 1980 would lose
        times.append(np.full(n, (m["week"] - first_week) * WEEK_S + m["rcvTow"]))
        for name in _NAMES:
            columns[name].append([m[f"{name}_{i:02d}"] for i in range(1, n + 1)])
    if not times:
        return None
    t, start = np.concatenate(times), first_week * WEEK_S
    table = {name: np.array([v for one in values for v in one]) for name, values in columns.items()}
    notes: list[str] = []
    sat, signal, signals = _identities(table, notes)
    keep = sat >= 0
    channels = _channels(table, sat)
    cycle = np.full(len(sat), np.nan)
    for k, name in enumerate(signals):
        here = keep & (signal == k)
        cycle[here] = wavelengths(sat[here], name, channels)
    pseudorange = np.where(table["prValid"] == 1, table["prMes"], np.nan)
    carrier = np.where(table["cpValid"] == 1, table["cpMes"], np.nan)
    lock = _loss_of_lock(t, sat, signal, table["locktime"]) + 2 * (table["halfCyc"] == 0)
    observations = Observations(
        t[keep], sat[keep], signal[keep], signals, pseudorange[keep], (-table["doMes"] * cycle)[keep],
        carrier[keep], table["cno"][keep], start, channels, lock=lock[keep],
    )  # fmt: skip
    half = int(np.sum(np.isfinite(carrier[keep]) & (table["halfCyc"][keep] == 0)))
    for count, text in (
        (empty, "epochs without measurements or before the receiver knew the time were left out"),
        (backwards, "epochs not later than the one before were left out"),
        (resets, "times the receiver's clock was reset: pseudoranges jump, by the same amount on all satellites"),
        (int(np.sum(~np.isfinite(pseudorange[keep]))), "measurements come without a valid pseudorange"),
        (half, "carrier phases may be half a cycle off"),
    ):
        if count:
            notes.append(f"{count} {text}.")
    observations = Observations(**{**observations.__dict__, "notes": tuple(notes)})
    # UBX-22008968, 3.17.5: 0.01 m and 0.002 Hz times powers of two
    sigma_range = 0.01 * 2.0 ** table["prStd"]
    sigma_rate = 0.002 * 2.0 ** table["doStd"] * cycle
    return RawEpochs(observations, sigma_range[keep], sigma_rate[keep], leap)


def _loss_of_lock(t: FloatArray, sat: IntArray, signal: IntArray, locktime_ms: FloatArray) -> IntArray:
    """1 where a carrier has been locked for less time than has passed since its row before. Shape (n,)"""
    order = np.lexsort((t, signal, sat))
    same = (np.diff(sat[order]) == 0) & (np.diff(signal[order]) == 0)
    passed_ms = 1e3 * np.diff(t[order])
    locked = locktime_ms[order]
    # the count stops at 64.5 s, and is rounded to milliseconds
    lost = same & (locked[1:] < np.minimum(passed_ms, _LONGEST_LOCK_MS) - 1.0)
    lock = np.zeros(len(t), dtype=np.int64)
    lock[order[1:][lost]] = 1
    return lock


def _identities(table: dict[str, Any], notes: list[str]) -> tuple[Any, Any, tuple[str, ...]]:
    """Satellite, place of the signal, and the signals; -1 for what has no name, which is noted."""
    triples = np.stack((table["gnssId"], table["svId"], table["sigId"]), axis=1).astype(np.int64)
    kinds, which, counts = np.unique(triples, axis=0, return_inverse=True, return_counts=True)
    names: list[str] = []
    sats, places = np.full(len(kinds), -1), np.full(len(kinds), 0)
    unnamed: Counter[str] = Counter()
    for k, (gnss, sv, sig) in enumerate(kinds.tolist()):
        sat, name = satellite_of(gnss, sv), SIGNAL_OF_SIG_ID.get((gnss, sig))
        if sat is None or name is None:
            system = SYSTEM_NAMES[SYSTEM_OF_GNSS_ID[gnss]] if gnss in SYSTEM_OF_GNSS_ID else f"gnssId {gnss}"
            unnamed[f"{system} {'signal' if name is None else 'satellite'} {sig if name is None else sv}"] += counts[k]
            continue
        if name not in names:
            names.append(name)
        sats[k], places[k] = sat, names.index(name)
    order = sorted(names)
    rank = np.array([order.index(name) for name in names] or [0])
    which = which.ravel()
    if unnamed:
        listed = ", ".join(f"{name} ({count})" for name, count in sorted(unnamed.items()))
        notes.append(f"Measurements of satellites or signals without a name here were left out: {listed}.")
    return sats[which], rank[places][which], tuple(order)


def _channels(table: dict[str, Any], sat: Any) -> dict[int, int]:
    """FDMA channels of the GLONASS satellites: ``freqId`` is the channel plus seven."""
    rows = np.flatnonzero((table["gnssId"] == _GLONASS) & (sat >= 0))
    return {int(sat[k]): int(table["freqId"][k]) - 7 for k in rows}


def satellite_of(gnss_id: int, sv_id: int) -> int | None:
    """Number of a satellite (:func:`schuler.gnss.signals.satellite`), ``None`` for one without a number of its own.

    GLONASS satellites not identified yet have svId 255.
    """
    letter = SYSTEM_OF_GNSS_ID.get(gnss_id)
    number = sv_id - _SBAS_OFFSET if letter == "S" else sv_id
    if letter is None or not 0 < number < 100:
        return None
    return 100 * SYSTEMS.index(letter) + number


def solution_times(messages: Sequence[dict[str, Any]]) -> FloatArray:
    """GPS time of each NAV-PVT message since 1980, NaN while the receiver does not know it. Shape (n, 2). [s]

    Whole seconds and the rest, which together have more digits than one number.

    The date and time are UTC; time of week tells the leap seconds between, so no table is needed. UTC carries the
    nanoseconds of the epoch, time of week is rounded to milliseconds.
    """
    times = np.full((len(messages), 2), np.nan)
    for k, m in enumerate(messages):
        if not (m["validDate"] and m["validTime"]):
            continue
        try:
            day = gps_from_calendar(dt.datetime(m["year"], m["month"], m["day"]))
        except ValueError:  # a date that is none
            continue
        utc, rest = day + m["hour"] * units.HR + m["min"] * units.MIN + m["second"], 1e-9 * m["nano"]
        leaps = round((m["iTOW"] * 1e-3 - utc - rest) % WEEK_S)
        if leaps <= 60:  # else date and time of week contradict each other
            times[k] = utc + leaps, rest
    return times


def solutions(
    messages: Iterable[dict[str, Any]],
    start: float | None = None,
    dop: Mapping[int, tuple[float, float]] | None = None,
) -> tuple[GnssSeries | None, float, list[str]]:
    """GNSS series of decoded NAV-PVT messages.

    Parameters
    ----------
    messages : iterable of dict
        Fields of each message by pyubx2's names, in order of the log.
    start : float, optional
        GPS time of zero seconds, default the start of the first epoch's week. [s]
    dop : mapping of int to (float, float), optional
        HDOP and VDOP of NAV-DOP by the time of week of their epoch. [ms]

    Returns
    -------
    series : GnssSeries or None
        ``None`` if there is no epoch with a fix.
    start : float
        GPS time of zero seconds. [s]
    notes : list of str

    Notes
    -----
    Left out are epochs without a valid fix (``gnssFixOK``, ``invalidLlh``, fix types 0 and 5), without a date or
    without accuracies. Of a two-dimensional fix the height is given 100 m. ``hAcc`` is taken as the 1-sigma of north
    and of east, ``sAcc`` as that of each component of velocity: u-blox does not say whether they are radial, and if
    they are the components are better by up to 1.4 and 1.7.
    """
    rows = list(messages)
    parts = solution_times(rows)
    times = parts.sum(axis=1)
    notes: list[str] = []
    fix = np.array([bool(m["gnssFixOk"]) and not m["invalidLlh"] and m["fixType"] in (1, 2, 3, 4) for m in rows], bool)
    accuracy = np.array([[m["hAcc"], m["vAcc"], m["sAcc"]] for m in rows], dtype=np.float64).reshape(-1, 3) * _MM
    # not known is all ones
    stated = np.all((accuracy > 0.0) & (accuracy < (2**32 - 1) * _MM), axis=1)
    dated = np.isfinite(times)
    # a running maximum leaves out what was repeated or went back
    highest = np.maximum.accumulate(np.where(fix & stated & dated, times, -np.inf)) if rows else times
    later = times > np.concatenate(([-np.inf], highest[:-1]))
    for wrong, text in (
        (~fix, "epochs without a fix were left out"),
        (fix & ~dated, "epochs before the receiver knew the date were left out"),
        (fix & dated & ~stated, "epochs without an accuracy were left out"),
        (fix & dated & stated & ~later, "epochs not later than the one before were left out"),
    ):
        if wrong.any():
            notes.append(f"NAV-PVT: {int(wrong.sum())} {text}.")
    keep = np.flatnonzero(fix & stated & dated & later)
    if len(keep) == 0:
        return None, float("nan") if start is None else start, notes
    start = float(times[keep[0]] // WEEK_S * WEEK_S) if start is None else start
    kept = [rows[k] for k in keep]
    llh = np.array([(m["lat"] * units.DEG, m["lon"] * units.DEG, m["height"] * _MM) for m in kept])
    v_n = np.array([(m["velN"], m["velE"], m["velD"]) for m in kept], dtype=np.float64) * _MM
    sigma, flat = accuracy[keep], np.array([m["fixType"] == _TWO_D for m in kept])
    if flat.any():
        notes.append(
            f"NAV-PVT: {int(flat.sum())} fixes are two-dimensional; their height got {_ASSUMED_HEIGHT:g} m 1-sigma."
        )
    vertical = np.where(flat, np.maximum(sigma[:, 1], _ASSUMED_HEIGHT), sigma[:, 1])
    cov_r, cov_v = np.zeros((len(kept), 3, 3)), np.zeros((len(kept), 3, 3))
    cov_r[:, [0, 1, 2], [0, 1, 2]] = np.stack((sigma[:, 0], sigma[:, 0], vertical), axis=1) ** 2
    cov_v[:, [0, 1, 2], [0, 1, 2]] = sigma[:, 2:] ** 2
    series = GnssSeries(
        (parts[keep, 0] - start) + parts[keep, 1], llh, cov_r, v_n, cov_v, np.array([_quality(m) for m in kept]),
        np.array([m["numSV"] for m in kept]),
        dop=stated_dilution(*np.array([(dop or {}).get(m["iTOW"], (0.0, 0.0)) for m in kept]).T),
    )  # fmt: skip
    return series, start, notes


def _quality(m: dict[str, Any]) -> int:
    """RTKLIB's number: fixed, float, differential, single, or dead reckoning."""
    if m["carrSoln"] in (1, 2):
        return 3 - int(m["carrSoln"])
    if m["fixType"] in _DEAD_RECKONING:
        return 7
    return 4 if m["diffSoln"] else 5


def broadcast(messages: Iterable[tuple[dict[str, Any], float]]) -> Ephemerides:
    """Ephemerides of decoded RXM-SFRBX messages.

    Parameters
    ----------
    messages : iterable of (dict, float)
        Fields of each message by pyubx2's names, and GPS time of reception to within some days. [s]

    Returns
    -------
    Ephemerides
        From GPS and QZSS LNAV, Galileo I/NAV, BeiDou D1 and GLONASS; messages of other kinds are counted in the notes.
    """
    groups: dict[str, list[tuple[int, list[int], float, int]]] = {}
    others: Counter[str] = Counter()
    for m, time in messages:
        gnss, sv = _identifier(m, "gnssId", 0), _identifier(m, "svId", 1)
        sig, words = _identifier(m, "sigId", 2), [m[f"dwrd_{i:02d}"] for i in range(1, m["numWords"] + 1)]
        sat, kind = satellite_of(gnss, sv), _kind(gnss, sv, sig, words)
        if sat is None or kind is None:
            system = SYSTEM_NAMES[SYSTEM_OF_GNSS_ID[gnss]] if gnss in SYSTEM_OF_GNSS_ID else f"gnssId {gnss}"
            others[f"{system} {SIGNAL_OF_SIG_ID.get((gnss, sig), sig)}"] += 1
            continue
        groups.setdefault(kind, []).append((sat, words, time, m["freqId"]))
    ephemerides = Ephemerides(no_kepler(), no_glonass())
    for kind, rows in groups.items():
        sats, near = np.array([r[0] for r in rows]), np.array([r[2] for r in rows])
        table = np.array([r[1] for r in rows], dtype=np.int64)
        if kind == "LNAV":
            part = ephemerides_of_lnav(sats, table, near)
        elif kind == "D1":
            part = ephemerides_of_d1(sats, table, near)
        elif kind == "strings":
            part = ephemerides_of_strings(sats, table, near, np.array([r[3] - 7 for r in rows]))
        else:
            part = ephemerides_of_inav(sats, table, near, kind)
        ephemerides = ephemerides.merged_with(part)
    if others:
        listed = ", ".join(f"{name} ({count})" for name, count in sorted(others.items()))
        note = f"Navigation messages of kinds that are not decoded: {listed}."
        ephemerides = ephemerides.merged_with(Ephemerides(no_kepler(), no_glonass(), notes=(note,)))
    return ephemerides


def _identifier(m: dict[str, Any], name: str, place: int) -> int:
    # pyubx2 replaces these numbers by names; the payload still has them
    payload: bytes = m["_payload"]
    return payload[place] if place != 2 or payload[6] > 1 else 0  # before version 2 there is no sigId


def _kind(gnss: int, sv: int, sig: int, words: list[int]) -> str | None:
    signal, n = SIGNAL_OF_SIG_ID.get((gnss, sig)), len(words)
    if gnss in (0, 5) and signal == "1C" and n == 10:
        return "LNAV"
    if gnss == 2 and signal in ("1C", "1B", "7I") and n == 8:
        return "7I" if signal == "7I" else "1B"
    if gnss == 3 and signal in ("2I", "6I", "7I") and n == 10 and sv not in _GEOSTATIONARY and sig not in (1, 3, 10):
        return "D1"
    if gnss == 6 and n == 4:
        return "strings"
    return None
