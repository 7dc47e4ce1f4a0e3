"""RINEX observation files, versions 2, 3 and 4, as arrays (navigation files beside them: ``rinex_navigation``).

The known library, georinex (MIT), was tried first: it reads the 536 epochs of a 2.5 MB file of version 3 in 12.4 s, 43
epochs a second, since it grows a table by every epoch; gnss_lib_py needs 13.9 s. At 4 Hz that is ten times faster than
the receiver, and an hour of 10 Hz data takes a quarter of an hour. So there is a path of our own: one loop over epochs,
and NumPy on fixed columns of bytes for all that stands in them. `benchmarks/test_rinex.py` runs both.

Sources: RINEX 2.11 (Gurtner and Estey, 2007), 2.12, 3.00 to 3.05 and 4.00 to 4.02 (IGS and RTCM-SC104).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.exceptions import FileFormatError, InputError
from schuler.gnss.observations import Observations
from schuler.gnss.signals import SYSTEM_NAMES, SYSTEMS, satellite, satellite_name, wavelengths
from schuler.recording.formats.rinex_columns import BDT_TO_GPS_S, leap_seconds_at, observed
from schuler.recording.formats.rinex_epochs import Epochs, epochs_of
from schuler.recording.formats.rinex_header import (
    CODES,
    KINDS,
    RinexFile,
    SystemTypes,
    broadcast_leap_seconds,
    header_numbers,
    read_lines,
    types_of,
)
from schuler.recording.io.clock import from_gps
from schuler.timebase import TimeBase

_BLOCK = 1024  # records at a time, so that the bytes at work stay in the processor's cache
_FIELD = 16
_NAME = 3
_LOCK = 14  # place of the digit in a field
_A_LINE = 5
#: Seconds to add to a time scale for GPS time; None for UTC, which needs leap seconds.
_SCALES: dict[str, float | None] = {
    "GPS": 0.0, "GAL": 0.0, "QZS": 0.0, "IRN": 0.0, "BDT": BDT_TO_GPS_S, "BDS": BDT_TO_GPS_S, "GLO": None, "UTC": None,
}  # fmt: skip
_OWN_SCALE = {"R": "GLO", "E": "GAL", "C": "BDT", "J": "QZS", "I": "IRN"}


def read_rinex_observation(path: Path | str, *, glonass_channels: Mapping[int, int] | None = None) -> Observations:
    """Raw measurements of a RINEX observation file.

    Parameters
    ----------
    path : Path or str
        Version 2.xx, 3.xx or 4.xx; plain, or packed with gzip, bzip2, zip, compress (.Z) or Hatanaka's scheme (.crx,
        .YYd), for the last two of which the library hatanaka must be installed.
    glonass_channels : mapping of int to int, optional
        FDMA channels by satellite where the header has none (``GLONASS SLOT / FRQ #``), for instance those of
        :func:`~schuler.recording.formats.rinex_navigation.glonass_channels`. Without them there are no range rates of
        GLONASS.

    Returns
    -------
    Observations
        On GPS time, counted from the start of the week of the first epoch. Times are those of the receiver's clock as
        the file has them: a receiver clock offset in the file is neither added nor taken away, since whoever wrote the
        file has either corrected times and ranges together or neither (noted). Observations of zero are missing ones.
        Range rate is minus Doppler times wavelength. Of loss of lock the digits of carriers are kept, without the bit
        of anti-spoofing; digits of signal strength are passed over. Repairs and assumptions are in ``notes``.

    Raises
    ------
    FileFormatError
        With file and line, for what is no observation file or does not go on as it says.
    InputError
        If a packed file needs a library that is not installed.

    Notes
    -----
    How types of version 2 become signals is in :mod:`schuler.recording.formats.rinex_header`. A file cut off within an
    epoch
    is read up to the epoch before; an epoch with fewer lines than it says, in the middle, is read as it is. Epochs out
    of order are put in order, and of a satellite named twice in an epoch the first line counts. All this is noted.
    """
    file = read_lines(path)
    if file.kind != "O":
        advice = "; read it with read_rinex_navigation" if "navigation" in KINDS[file.kind] else ""
        raise FileFormatError(f"expected a RINEX file of observations, got one of {KINDS[file.kind]}{advice}", path)
    types = types_of(file)
    if not types:
        raise FileFormatError("the header names no types of observations: is it complete?", file.path)
    epochs = epochs_of(file, len(next(iter(types.values())).codes))
    if not len(epochs.line):
        raise FileFormatError("there is no complete epoch after the header", file.path)
    epochs, t, base = _in_order(file, epochs)
    signals, rows = _rows(file, epochs, types)
    channels = {**_header_channels(file), **(glonass_channels or {})}
    record = rows["record"].astype(np.int64)
    sat, signal = epochs.sat[record], rows["signal"].astype(np.int64)
    range_rate = -rows["D"] * _wavelengths(file, sat, signal, signals, channels, np.isfinite(rows["D"]))
    _note_clock(file, epochs)
    position = header_numbers(file, "APPROX POSITION XYZ", 14, 3)
    mounted = header_numbers(file, "ANTENNA: DELTA H/E/N", 14, 3)
    return Observations(
        t[epochs.epoch[record]],
        sat,
        signal,
        signals,
        rows["C"],
        range_rate,
        rows["L"],
        rows["S"],
        base.epoch_gps_s,
        channels,
        (position[0], position[1], position[2]) if position and any(position) else None,
        tuple(file.notes),
        rows["lock"].astype(np.int64),
        antenna=" ".join((file.first_text("ANT # / TYPE") or "")[20:40].split()),
        eccentricity_n=(mounted[2], mounted[1], -mounted[0]) if mounted and np.isfinite(mounted).all() else None,
    )


def _in_order(file: RinexFile, epochs: Epochs) -> tuple[Epochs, FloatArray, TimeBase]:
    """Epochs on GPS time in order of time, each satellite once in an epoch, and their times. [s]"""
    whole = _gps_whole(file, epochs)
    if (backwards := int(np.sum(np.diff(whole + epochs.part) < 0.0))) > 0:
        file.notes.append(f"Time goes back at {backwards} epochs; they were put in order of time.")
    by_time = np.lexsort((epochs.part, whole))
    t, base = from_gps(whole[by_time].astype(np.float64), epochs.part[by_time])
    rank = np.empty(len(by_time), dtype=np.int64)
    rank[by_time] = np.arange(len(by_time))
    instant = np.concatenate(([0], np.cumsum(np.diff(t) > 0.0)))
    record = np.argsort(rank[epochs.epoch], kind="stable")
    # the first of equal keys: np.unique takes the first place of each
    _, first = np.unique(1000 * instant[rank[epochs.epoch[record]]] + epochs.sat[record], return_index=True)
    if (twice := len(record) - len(first)) > 0:
        file.notes.append(f"{twice} lines name a satellite again at the time of another line; the first line counts.")
        record = record[np.sort(first)]
    if (repeated := len(t) - 1 - int(instant[-1])) > 0:
        file.notes.append(f"{repeated} epochs have the time of the one before and were joined with it.")
    ordered = Epochs(
        whole[by_time], epochs.part[by_time], epochs.clock[by_time], epochs.line[by_time],
        rank[epochs.epoch[record]], epochs.record[record], epochs.sat[record],
    )  # fmt: skip
    return ordered, t, base


def _gps_whole(file: RinexFile, epochs: Epochs) -> IntArray:
    """Whole seconds of the epochs on GPS time. Shape (k,). [s]"""
    text = (file.first_text("TIME OF FIRST OBS") or "").ljust(60)[48:51].strip().upper()
    if not text:
        text = _OWN_SCALE.get(file.system, "GPS")
        if file.version >= 3.0:
            file.notes.append(f"The header does not say which time the epochs have; {text} time was taken.")
    if text not in _SCALES:
        raise file.fault(f"TIME OF FIRST OBS: expected a time scale of {', '.join(_SCALES)}, got {text!r}")
    shift = _SCALES[text]
    if shift is None:
        leaps = leap_seconds_at(epochs.whole, broadcast_leap_seconds(file))
        file.notes.append(f"Epochs are UTC and were turned to GPS time: {leaps[0]:.0f} s were added to the first.")
        return epochs.whole + leaps.astype(np.int64)
    if shift:
        file.notes.append(f"Epochs are BeiDou time; {shift:.0f} s were added for GPS time.")
    return epochs.whole + int(shift)


def _rows(
    file: RinexFile, epochs: Epochs, types: dict[str, SystemTypes]
) -> tuple[tuple[str, ...], dict[str, FloatArray]]:
    """Signals of the file, and one row for each signal of each record, in the order of records."""
    signals: dict[str, int] = {}
    parts: list[FloatArray] = []
    unknown: list[str] = []
    for system in np.unique(epochs.sat // 100).tolist():
        letter = SYSTEMS[system]
        of_system = np.flatnonzero(epochs.sat // 100 == system)
        if letter not in types:
            unknown.append(f"{len(of_system)} of {SYSTEM_NAMES[letter]}")
            continue
        of_type, factors = types[letter], _scale_factors(file, letter, types[letter])
        places = np.array([[kinds.get(kind, -1) for kind in CODES] for kinds in of_type.columns.values()], dtype=int)
        numbers = np.array([signals.setdefault(signal, len(signals)) for signal in of_type.columns], dtype=int)
        for k in range(0, len(of_system) if len(numbers) else 0, _BLOCK):
            records = of_system[k : k + _BLOCK]
            values, lock = _values(file, epochs.record[records], of_type.codes)
            values = np.column_stack((values / factors, np.full(len(values), np.nan)))[:, places]  # (n, signals, kinds)
            lock = np.column_stack((lock, np.zeros_like(lock[:, :1])))[:, places[:, CODES.index("L")]]
            at, which = np.nonzero(np.isfinite(values).any(axis=2))
            parts.append(np.column_stack((records[at], numbers[which], values[at, which], lock[at, which])))
    if unknown:
        file.notes.append(f"The header has no types of these lines, which were passed over: {', '.join(unknown)}.")
    table = np.concatenate(parts) if parts else np.zeros((0, 3 + len(CODES)))
    table = table[np.argsort(table[:, 0], kind="stable")]
    used, table[:, 1] = np.unique(table[:, 1], return_inverse=True)  # not those of the header that nobody sent
    names = list(signals)
    return tuple(names[int(k)] for k in used), dict(zip(("record", "signal", *CODES, "lock"), table.T, strict=True))


def _values(file: RinexFile, at: IntArray, codes: tuple[str, ...]) -> tuple[FloatArray, IntArray]:
    """Observations of records of one system, NaN where there are none, and loss of lock. Shapes (n, len(codes))."""
    m = len(codes)
    if file.version >= 3.0:
        chars = file.columns(at, _NAME, _FIELD * m).reshape(-1, m, _FIELD)
    else:
        height = -(-m // _A_LINE)
        lines = (at[:, None] + np.arange(height)).ravel()
        chars = file.columns(lines, 0, _FIELD * _A_LINE).reshape(-1, height * _A_LINE, _FIELD)
    values, wrong = observed(chars)
    values, wrong = values[:, :m], wrong[:, :m]
    if wrong.any():
        row, column = (int(k) for k in np.argwhere(wrong)[0])
        line, first = int(at[row]), _NAME + _FIELD * column
        if file.version < 3.0:
            line, first = line + column // _A_LINE, _FIELD * (column % _A_LINE)
        raise file.fault(
            f"{codes[column]}: expected a number with three decimals in columns {first + 1} to {first + 14}, "
            f"got {file.text(line)[first : first + 14]!r}; is the line shifted?",
            line,
        )
    digit = chars[:, :m, _LOCK].astype(np.int64) - ord("0")
    return values, np.where((digit > 0) & (digit < 8), digit & 3, 0)


def _scale_factors(file: RinexFile, system: str, of_type: SystemTypes) -> FloatArray:
    """Scale factors that divide each type of a system. Shape (len(codes),)."""
    factors = np.ones(len(of_type.codes))
    if file.version < 3.0:
        if "OBS SCALE FACTOR" in file.header:
            raise file.fault("OBS SCALE FACTOR of version 2 is not read: write the file as version 3")
        return factors
    current, factor = "", 1.0
    for text in file.header.get("SYS / SCALE FACTOR", []):
        if text[0] != " ":
            current, number, count = text[0], text[2:6].strip(), text[8:10].strip() or "0"
            if number not in ("1", "10", "100", "1000") or not count.isdecimal():
                raise file.fault(f"SYS / SCALE FACTOR: expected 1, 10, 100 or 1000, got {text.strip()!r}")
            factor = float(number)
            if current == system and int(count) == 0:
                factors[:] = factor
        if current == system:
            for code in text[10:60].split():
                factors[[c == code for c in of_type.codes]] = factor
    if np.any(factors != 1.0):
        file.notes.append(f"Observations of {SYSTEM_NAMES[system]} were divided by the header's scale factors.")
    return factors


def _header_channels(file: RinexFile) -> dict[int, int]:
    channels = {}
    for text in file.header.get("GLONASS SLOT / FRQ #", []):
        for first in range(4, 60, 7):
            name, channel = text[first : first + 3], text[first + 3 : first + 6].strip()
            if name[:1] == "R" and name[1:].strip().isdecimal() and re.fullmatch(r"[-+]?\d+", channel):
                channels[satellite(name)] = int(channel)
    return channels


def _wavelengths(
    file: RinexFile, sat: IntArray, signal: IntArray, signals: tuple[str, ...], channels: dict[int, int],
    required: BoolArray,
) -> FloatArray:  # fmt: skip
    """Wavelength of each row, NaN where it is not known; wanted ones that are not known are noted. Shape (n,). [m]"""
    table = np.full((100 * len(SYSTEMS), max(1, len(signals))), np.nan)
    seen = np.zeros(table.shape, dtype=np.bool_)
    seen[sat[required], signal[required]] = True
    no_channel: set[str] = set()
    no_band: set[str] = set()
    for s, k in np.argwhere(seen).tolist():
        try:
            table[s, k] = wavelengths([s], signals[k], channels)[0]
        except InputError:
            no_band.add(f"{SYSTEM_NAMES[SYSTEMS[s // 100]]} {signals[k]}")
            continue
        if np.isnan(table[s, k]):
            no_channel.add(satellite_name(s))
    if no_channel:
        file.notes.append(
            f"No range rates of {', '.join(sorted(no_channel))}: the header has no channels of GLONASS; give "
            "glonass_channels."
        )
    if no_band:
        file.notes.append(f"No range rates of signals whose frequency is not known: {', '.join(sorted(no_band))}.")
    return np.asarray(table[sat, signal])


def _note_clock(file: RinexFile, epochs: Epochs) -> None:
    if np.nanmax(np.abs(epochs.clock), initial=0.0) > 0.0:
        applied = (file.first_text("RCV CLOCK OFFS APPL") or "").strip() == "1"
        how = "were applied by the writer of the file" if applied else "are in the file and were not applied"
        file.notes.append(f"Receiver clock offsets of up to {np.nanmax(np.abs(epochs.clock)):.3g} s {how}.")
