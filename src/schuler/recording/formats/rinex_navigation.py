"""RINEX navigation files, versions 2, 3 and 4: broadcast orbits, clocks and ionosphere.

georinex (MIT) reads versions 2 and 3 too, as a table by satellite and time in which two messages of one time and
satellite (Galileo's F/NAV and I/NAV) need different names, and which has no BeiDou or GLONASS time; version 4 it does
not read. What stands in fixed columns needs no library.

Sources: RINEX 2.11 (Gurtner and Estey, 2007), 3.05 and 4.01 (IGS and RTCM-SC104), appendices on navigation files.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import FileFormatError
from schuler.gnss.ephemerides import (
    B2B_SOURCE,
    NEWER_SOURCE,
    Ephemerides,
    GlonassRecords,
    KeplerRecords,
    no_glonass,
    no_kepler,
)
from schuler.gnss.signals import SYSTEM_NAMES
from schuler.recording.formats.rinex_columns import BDT_TO_GPS_S, leap_seconds_at
from schuler.recording.formats.rinex_header import KINDS, RinexFile, broadcast_leap_seconds, numbers_in, read_lines
from schuler.recording.formats.rinex_records import Records, dates, fields, records_of
from schuler.timebase import WEEK_S

#: Header names of ionospheric coefficients: ours, and how many there are.
_COEFFICIENTS = {
    "GPSA": ("alpha", 4), "GPSB": ("beta", 4), "GAL": ("galileo", 3), "BDSA": ("BeiDou alpha", 4),
    "BDSB": ("BeiDou beta", 4),
}  # fmt: skip
_ION_MESSAGES = ("G LNAV", "E IFNV", "C D1D2")
_KM = 1e3
_DAY_S = 86_400.0
_NOT_KNOWN = 0.9999e9  # what a time of transmission is said to be when it is not known
#: Where the numbers of a message stand, counted from the three of its first line (RINEX 3.05, tables A6 to A14).
_PLACES = {
    "af0": 0, "af1": 1, "af2": 2, "crs": 4, "delta_n": 5, "m0": 6, "cuc": 7, "e": 8, "cus": 9, "sqrt_a": 10,
    "cic": 12, "omega0": 13, "cis": 14, "i0": 15, "crc": 16, "omega": 17, "omega_dot": 18, "idot": 19,
}  # fmt: skip
_ISSUE, _TOE, _SOURCE, _ACCURACY, _HEALTH, _DELAY, _SENT = 3, 11, 20, 23, 24, 25, 27
# of messages of modernised signals, those of BeiDou with a B
_A_DOT, _N_DOT, _URA_NED, _URA_ED, _ISC_L5, _SENT_NEWER = 3, 20, 21, 23, 30, (31, 35)
_DELAYS_B, _HEALTH_B, _ISSUE_B = 29, 32, 38
_HEALTH_B2B, _DELAY_B2B = 28, 30
_CHANNELS = (-7, 13)
T = TypeVar("T", KeplerRecords, GlonassRecords)


def read_rinex_navigation(path: Path | str) -> Ephemerides:
    """Broadcast orbits and clocks of a RINEX navigation file.

    Parameters
    ----------
    path : Path or str
        Version 2.xx (GPS ``.YYn``, GLONASS ``.YYg``, Galileo ``.YYl``), 3.xx or 4.xx, mixed or not; packed as for
        :func:`~schuler.recording.formats.rinex_observation.read_rinex_observation`.

    Returns
    -------
    Ephemerides
        By system, in the order of the file, all on GPS time: 14 s are added to BeiDou's, leap seconds to GLONASS's.
        The weeks of toe and of the time of transmission are those next to toc, whatever week number the file has. A
        blank or unknown (0.9999E9) time of transmission is NaN, so is a blank group delay and an accuracy that is not
        positive (Galileo's -1 is "no prediction"); a blank health is taken as usable and noted; a blank issue is -1.
        Accuracy is in metres as RINEX has it: a writer that put an index there cannot be found out. Messages with a
        blank element are left out, as are repeated ones: same satellite, times, issue, source and health, of which the
        first counts. All zero coefficients of an ionosphere are none. Notes say all of this.

        Of version 4, messages LNAV, CNAV, CNV2 (GPS, QZSS), INAV, FNAV, D1, D2, CNV1 to CNV3 (BeiDou) and FDMA are
        read; SBAS, NavIC, time offsets and Earth orientation are counted in the notes.

    Raises
    ------
    FileFormatError
        With file and line, for what is no navigation file or has malformed messages.
    InputError
        If a packed file needs a library that is not installed.
    """
    file = read_lines(path)
    if "navigation" not in KINDS[file.kind]:
        advice = "; read it with read_rinex_observation" if file.kind == "O" else ""
        raise FileFormatError(f"expected a RINEX navigation file, got one of {KINDS[file.kind]}{advice}", path)
    records = records_of(file)
    orbits = Ephemerides(no_kepler(), glonass_records(file, records.of("R")))
    for system in "GECJ":
        orbits = orbits.merged_with(Ephemerides(kepler_records(file, records.of(system), system), no_glonass()))
        for name in ("CNAV", "CNV1", "CNV2", "CNV3"):
            newer = newer_records(file, records.of(system, name), system, name)
            orbits = orbits.merged_with(Ephemerides(newer, no_glonass()))
    ionosphere = _ionosphere(file, records.ionosphere)
    alpha, beta, galileo, c_alpha, c_beta = (ionosphere.get(name) for name, _ in _COEFFICIENTS.values())
    return Ephemerides(
        orbits.kepler,
        orbits.glonass,
        (alpha[0], alpha[1], alpha[2], alpha[3]) if alpha else None,
        (beta[0], beta[1], beta[2], beta[3]) if beta else None,
        (galileo[0], galileo[1], galileo[2]) if galileo else None,
        broadcast_leap_seconds(file),
        tuple(file.notes),
        beidou_alpha=(c_alpha[0], c_alpha[1], c_alpha[2], c_alpha[3]) if c_alpha else None,
        beidou_beta=(c_beta[0], c_beta[1], c_beta[2], c_beta[3]) if c_beta else None,
    )


def _ionosphere(file: RinexFile, messages: list[tuple[str, int]]) -> dict[str, tuple[float, ...]]:
    """Coefficients by name; the first of each that are there and are not all zero."""
    stated: list[tuple[str, tuple[float, ...] | None]] = []
    for label, name in (("ION ALPHA", "alpha"), ("ION BETA", "beta")):
        stated += [(name, numbers_in(text, 12, 4, first=2)) for text in file.header.get(label, [])]
    others: list[str] = []
    for text in file.header.get("IONOSPHERIC CORR", []):
        name, count = _COEFFICIENTS.get(text[:4].strip(), ("", 0))
        if name:
            stated.append((name, numbers_in(text, 12, count, first=5)))
        else:
            others.append(text[:4].strip())
    for message, line in messages:
        if message in _ION_MESSAGES:
            stated += _of_message(file, message, line)
        else:
            others.append(message)
    coefficients: dict[str, tuple[float, ...]] = {}
    empty: set[str] = set()
    for name, values in stated:
        if values is not None and any(values):
            coefficients.setdefault(name, values)
        else:
            empty.add(name)
    if missing := sorted(empty - set(coefficients)):
        file.notes.append(f"Ionosphere coefficients that are all zero or cannot be read: {', '.join(missing)}.")
    if others:
        file.notes.append(f"Ionosphere coefficients that are not used: {', '.join(sorted(set(others)))}.")
    return coefficients


def _of_message(file: RinexFile, message: str, line: int) -> list[tuple[str, tuple[float, ...] | None]]:
    """Coefficients of an ionospheric message of version 4: three on the line of the date, then four on each."""
    needed = 1 if message == "E IFNV" else 3
    owner = "BeiDou " if message == "C D1D2" else ""
    if line + needed > len(file):
        return []
    first = numbers_in(file.text(line).ljust(80), 19, 3, first=23)
    if message == "E IFNV":
        return [("galileo", first)]
    second = numbers_in(file.text(line + 1).ljust(80), 19, 4, first=4)
    third = numbers_in(file.text(line + 2).ljust(80), 19, 1, first=4)
    if first is None or second is None or third is None:
        return [(f"{owner}alpha", None), (f"{owner}beta", None)]
    return [(f"{owner}alpha", (*first, second[0])), (f"{owner}beta", (*second[1:], *third))]


def glonass_channels(ephemerides: Ephemerides) -> dict[int, int]:
    """FDMA channel by satellite, the last one broadcast.

    Returns
    -------
    dict of int to int
        Argument of :func:`~schuler.recording.formats.rinex_observation.read_rinex_observation`.
    """
    records = ephemerides.glonass
    order = np.argsort(records.toe, kind="stable")
    return dict(zip(records.sat[order].tolist(), records.channel[order].tolist(), strict=True))


def kepler_records(file: RinexFile, records: Records, system: str) -> KeplerRecords:
    """Keplerian orbits of one system (G, E, C or J). Messages with a blank among their elements are left out, noted."""
    if not len(records.line):
        return no_kepler()
    values, toc = fields(file, records, 8), dates(file, records).astype(np.float64)
    toe = _near(values[:, _TOE], toc, WEEK_S)
    # where nothing is stated: usable, of an issue that no message has, and no accuracy
    health, issue, source = (np.nan_to_num(values[:, k], nan=d) for k, d in ((_HEALTH, 0), (_ISSUE, -1), (_SOURCE, 0)))
    delay = values[:, _DELAY : _DELAY + 2].copy()
    if system in "GJ":
        delay[:, 1] = np.nan  # here stands the issue of the clock
    orbits = KeplerRecords(
        **_common_fields(records, system, toe, toc, values, _SENT),
        group_delay=delay,
        health=_whole(health),
        accuracy=np.where(values[:, _ACCURACY] > 0.0, values[:, _ACCURACY], np.nan),
        issue=_whole(issue),
        source=_whole(source) if system == "E" else np.zeros(len(toc), dtype=np.int64),
    )
    complete = np.asarray(np.isfinite(values[:, [*_PLACES.values(), _TOE]]).all(axis=1))
    orbits = _elliptic(file, orbits, complete, system)
    if (unstated := int(np.isnan(values[complete, _HEALTH]).sum())) > 0:
        file.notes.append(f"{unstated} messages of {SYSTEM_NAMES[system]} state no health and were taken as usable.")
    key = np.column_stack((orbits.sat, orbits.toe, orbits.toc, orbits.issue, orbits.source, orbits.health))
    return _once(file, orbits, key, system)


def newer_records(file: RinexFile, records: Records, system: str, name: str) -> KeplerRecords:
    """Orbits of the modernised signals: GPS's and QZSS's CNAV, CNV2 (CNAV-2), BeiDou's CNV1 to CNV3 (B-CNAV1 to 3).

    Notes
    -----
    GPS and QZSS state no reference time of the orbit, which is that of the clock. Their accuracy is that of both parts
    of the orbit (URA, nominal values) together; BeiDou's indices are passed over, and CNV3 states no issue. Health
    bits of any of a satellite's signals make it unusable.

    References
    ----------
    RINEX 4.01, appendix on CNAV and B-CNAV; IS-GPS-200, 30.3.3.1.1.4 and 30.3.3.2.4 (nominal URA).
    """
    if not len(records.line):
        return no_kepler()
    beidou, b2b, tall = system == "C", name == "CNV3", name not in ("CNAV", "CNV3")
    values, toc = fields(file, records, 10 if tall else 9), dates(file, records).astype(np.float64)
    toe = _near(values[:, _TOE], toc, WEEK_S) if beidou else toc
    health, issue = values[:, _HEALTH_B if beidou else _HEALTH], np.full(len(toc), -1.0)
    if b2b:
        health = values[:, _HEALTH_B2B]
        delay, accuracy = values[:, [_DELAY_B2B] * 2].copy(), np.full(len(toc), np.nan)
        delay[:, 0] = np.nan
    elif beidou:
        issue = values[:, _ISSUE_B]
        delay, accuracy = values[:, _DELAYS_B : _DELAYS_B + 2].copy(), np.full(len(toc), np.nan)
    else:
        tgd = values[:, _DELAY]
        delay = np.column_stack((tgd, tgd - values[:, _ISC_L5]))
        accuracy = np.hypot(_nominal_ura(values[:, _URA_ED]), _nominal_ura(values[:, _URA_NED]))
    orbits = KeplerRecords(
        **_common_fields(records, system, toe, toc, values, _SENT_NEWER[tall]),
        group_delay=delay,
        health=_whole(health),
        accuracy=accuracy,
        issue=_whole(issue, -1),
        source=np.full(len(toc), B2B_SOURCE if b2b else NEWER_SOURCE),
        a_dot=values[:, _A_DOT],
        delta_n_dot=values[:, _N_DOT],
    )
    complete = np.asarray(
        np.isfinite(np.column_stack((values[:, [*_PLACES.values(), _A_DOT, _N_DOT]], toe))).all(axis=1)
    )
    orbits = _elliptic(file, orbits, complete, system)
    key = np.column_stack((orbits.sat, orbits.toe, orbits.toc, orbits.sent, orbits.issue, orbits.health))
    return _once(file, orbits, key, system)


def _common_fields(
    records: Records, system: str, toe: FloatArray, toc: FloatArray, values: FloatArray, sent: int
) -> dict[str, Any]:
    """Satellites, times by GPS and elements, which all messages of Keplerian orbits have; ``sent`` is a column."""
    offset = BDT_TO_GPS_S if system == "C" else 0.0
    transmitted = _near(_known(values[:, sent]), toc, WEEK_S)
    times = {"toe": toe + offset, "toc": toc + offset, "sent": transmitted + offset}
    return {"sat": records.sat, **times, **{name: values[:, k] for name, k in _PLACES.items()}}


def _elliptic(file: RinexFile, orbits: KeplerRecords, complete: np.ndarray, system: str) -> KeplerRecords:
    """Those of the complete orbits that are ellipses."""
    return _complete(file, orbits, complete & (orbits.sqrt_a > 0.0) & (orbits.e >= 0.0) & (orbits.e < 1.0), system)


def _nominal_ura(index: FloatArray) -> FloatArray:
    """1-sigma of an index of URA of CNAV, NaN where there is no prediction (15, -16). Shape (n,). [m]"""
    with np.errstate(over="ignore"):
        metres = np.where(index <= 6.0, 2.0 ** (1.0 + index / 2.0), 2.0 ** (index - 2.0))
    return np.where((index > -16.0) & (index < 15.0), metres, np.nan)


def glonass_records(file: RinexFile, records: Records) -> GlonassRecords:
    """GLONASS states, on GPS time: the file's times are UTC."""
    if not len(records.line):
        return no_glonass()
    values, utc = fields(file, records, 4), dates(file, records)
    leaps = leap_seconds_at(utc, broadcast_leap_seconds(file))
    toe = utc.astype(np.float64)
    with np.errstate(over="ignore"):  # of damaged messages, which are left out with those that no satellite has
        state = values[:, 3:].reshape(-1, 3, 4) * _KM
    channel = values[:, 10]
    channel = np.where(channel > 128, channel - 256, channel)  # some writers take the byte as one without a sign
    period = _DAY_S if file.version < 3.0 and not np.any(_known(values[:, 2]) >= _DAY_S) else WEEK_S
    orbits = GlonassRecords(
        sat=records.sat,
        toe=toe + leaps,
        sent=_near(_known(values[:, 2]), toe, period) + leaps,
        r_e=state[:, :, 0],
        v_e=state[:, :, 1],
        a_e=state[:, :, 2],
        clock=values[:, 0],
        rate=values[:, 1],
        channel=_whole(channel, 99),
        health=_whole(values[:, 6]),
    )
    complete = np.isfinite(values[:, [0, 1, 3, 4, 5, 7, 8, 9, 11, 12, 13]]).all(axis=1)
    complete &= (orbits.channel >= _CHANNELS[0]) & (orbits.channel <= _CHANNELS[1])
    orbits = _complete(file, orbits, complete, "R")
    return _once(file, orbits, np.column_stack((orbits.sat, orbits.toe, orbits.health)), "R")


def _whole(values: FloatArray, missing: int = 0) -> IntArray:
    """Numbers that are whole; of damaged ones the largest with 32 bits. Shape (n,)."""
    return np.clip(np.round(np.nan_to_num(values, nan=missing)), -(2.0**31), 2.0**31 - 1.0).astype(np.int64)


def _known(sent: FloatArray) -> FloatArray:
    return np.where(np.abs(sent) < _NOT_KNOWN, sent, np.nan)


def _near(of_period: FloatArray, t: FloatArray, period: float) -> FloatArray:
    """Times known but for whole weeks or days, those next to ``t``: at the turn of a week the week's number is often
    the wrong one of two. Shapes (n,). [s]"""  # noqa: D209
    apart = of_period - np.mod(t, period)
    return t + apart - period * np.round(apart / period)


def _complete(file: RinexFile, orbits: T, complete: np.ndarray, system: str) -> T:
    if not complete.all():
        file.notes.append(
            f"{np.sum(~complete)} messages of {SYSTEM_NAMES[system]} lack elements or have impossible ones and were "
            "left out."
        )
    return _rows(orbits, np.flatnonzero(complete))


def _once(file: RinexFile, orbits: T, key: np.ndarray, system: str) -> T:
    """The first of messages that say the same."""
    if not len(orbits):
        return orbits
    _, first = np.unique(key, axis=0, return_index=True)
    if (twice := len(orbits) - len(first)) > 0:
        file.notes.append(f"{twice} messages of {SYSTEM_NAMES[system]} are there again and were left out.")
    return _rows(orbits, np.sort(first))


def _rows(orbits: T, k: np.ndarray) -> T:
    from dataclasses import fields as names

    return type(orbits)(**{f.name: getattr(orbits, f.name)[k] for f in names(orbits)})
