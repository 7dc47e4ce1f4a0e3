"""Raw measurements of satellites in logs of GnssLogger: pseudoranges, range rates and carriers of a phone.

A phone logs when a signal left its satellite (``ReceivedSvTimeNanos``, in the system's own time, modulo what its state
has resolved) and its own clock: ``TimeNanos`` less ``FullBiasNanos`` and ``BiasNanos`` is GPS time.

Sources: Android API reference, ``GnssClock`` and ``GnssMeasurement``; European GNSS Agency (2017), Using GNSS raw
measurements on Android devices, white paper, chapter 2.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.exceptions import FileFormatError
from schuler.gnss.observations import Observations
from schuler.gnss.signals import BANDS, GLONASS_BANDS, SPEED_OF_LIGHT, SYSTEM_NAMES, SYSTEMS
from schuler.recording.formats.rinex_columns import BDT_TO_GPS_S, leap_seconds_at
from schuler.recording.io import lines
from schuler.timebase import WEEK_S

#: Fields without which there is no pseudorange.
REQUIRED = (
    "TimeNanos", "FullBiasNanos", "Svid", "State", "ReceivedSvTimeNanos", "Cn0DbHz", "PseudorangeRateMetersPerSecond",
    "AccumulatedDeltaRangeState", "AccumulatedDeltaRangeMeters", "ConstellationType",
)  # fmt: skip
_WHOLE = ("TimeNanos", "FullBiasNanos", "ReceivedSvTimeNanos")  # beyond the digits of a float
_OPTIONAL = (
    "BiasNanos", "TimeOffsetNanos", "HardwareClockDiscontinuityCount", "ReceivedSvTimeUncertaintyNanos",
    "CarrierFrequencyHz", "ChipsetElapsedRealtimeNanos", "ElapsedRealtimeMillis",
)  # fmt: skip
_NUMBERS = tuple(name for name in (*REQUIRED, *_OPTIONAL) if name not in _WHOLE)
_LARGEST = 4 * 10**18  # [ns]
_NS = 1_000_000_000
_WEEK_NS, _DAY_NS, _SECONDARY_NS = int(WEEK_S) * _NS, 86_400 * _NS, 100_000_000
_CODE_LOCK, _TOW_DECODED, _MSEC_AMBIGUOUS, _GLO_TOD_DECODED = 1, 8, 16, 128
_E1BC_CODE_LOCK, _E1C_SECONDARY, _TOW_KNOWN, _GLO_TOD_KNOWN = 1024, 2048, 16_384, 32_768
_ADR_VALID, _ADR_RESET, _ADR_SLIP, _ADR_HALF_RESOLVED, _ADR_HALF_REPORTED = 1, 2, 4, 8, 16
_HALF_CYCLE = 2  # of RINEX's loss of lock indicator
_WORST_NS = 500.0  # uncertainty of the time of transmission, as in Google's GPS measurement tools [ns]
_FARTHEST_NS = 150_000_000  # no satellite's signal takes as long; those at 36,000 km take 120 to 140 ms [ns]
_BIAS_JUMP_NS = 5_000_000  # of the clock's bias between epochs; no oscillator drifts as much [ns]
_DRIFT = 1e-4  # of a phone's clock at most
_STRANGE_NS = 10 * _NS  # between GPS time and time since boot, where the phone does not know the time yet [ns]
_DAMAGED = 0.01  # share of a kind's records that may be no numbers: a log ends within one where the app was stopped
#: Android's constellations, and what its satellites' numbers count from.
_CONSTELLATIONS = {1: ("G", 0), 2: ("S", 100), 3: ("R", 0), 4: ("J", 192), 5: ("C", 0), 6: ("E", 0), 7: ("I", 0)}
#: Attribute of a signal whose code the log does not name (before version 3), by system and band.
_ATTRIBUTES = {("C", "2"): "I", ("G", "5"): "Q", ("E", "5"): "Q", ("J", "5"): "Q", ("C", "5"): "P", ("I", "5"): "A"}

_Row = TypeVar("_Row")


@dataclass(frozen=True)
class RawMeasurements:
    """Observations of a log, and what ties the clock of its other sensors to GPS time.

    Attributes
    ----------
    observations : Observations
    boot_ns, gps_ns : ndarray of int, shape (k,)
        Time since boot and GPS time of the epochs that have both. [ns]
    """

    observations: Observations
    boot_ns: IntArray
    gps_ns: IntArray


def raw_measurements(path: Path, names: Sequence[str], records: Sequence[Sequence[str]]) -> RawMeasurements:
    """Observations of records ``Raw``.

    Parameters
    ----------
    path : Path
        For messages.
    names : sequence of str
        Fields as the comment at the top names them, with all of :data:`REQUIRED`.
    records : sequence of sequence of str

    Returns
    -------
    RawMeasurements

    Raises
    ------
    FileFormatError
        With the record, where a number is none; if no record has a clock.

    Notes
    -----
    The bias of the receiver clock is that of the first epoch, until the count of hardware discontinuities changes or
    the bias jumps by more than 5 ms: with each epoch's own bias, ranges would not be what their rates say. The clock's
    drift stays in the ranges. Android counts its carrier (accumulated delta range) as ranges: it grows with distance.
    Epochs with a reset or a slip have no carrier, so that arcs end there, as they do where half a cycle is settled.
    """
    notes: list[str] = []
    whole, table, records = _columns(path, names, records, notes)
    time_ns, full_ns, sent_ns = whole.T
    column = dict(zip(_NUMBERS, table.T, strict=True))
    clocked = full_ns != 0
    sat, letters = _satellites(column["ConstellationType"], column["Svid"])
    use = clocked & (sat >= 0)
    if not use.any():
        raise FileFormatError("no record Raw has both a clock (FullBiasNanos) and a satellite", path)
    if not use.all():
        notes.append(f"{int((~use).sum())} raw measurements without clock or slot were left out.")
    gps_ns: IntArray = np.zeros(len(time_ns), dtype=np.int64)
    rest_ns: FloatArray = np.zeros(len(time_ns))
    in_use = {name: values[use] for name, values in column.items()}
    gps_ns[use], rest_ns[use] = _reception(time_ns[use], full_ns[use], in_use, notes)
    boot = column["ChipsetElapsedRealtimeNanos"]
    if not np.isfinite(boot).any():
        boot = column["ElapsedRealtimeMillis"] * 1e6
    use &= ~_of_another_time(gps_ns, boot, use, notes)
    order = np.flatnonzero(use)
    order = order[np.lexsort((sat[order], gps_ns[order]))]
    gps_ns, sent_ns, sat = gps_ns[order], sent_ns[order], sat[order]
    rest_ns, letters, boot = rest_ns[order], letters[order], boot[order]
    column = {name: values[order] for name, values in column.items()}

    frequency = np.where(np.isfinite(column["CarrierFrequencyHz"]), column["CarrierFrequencyHz"], 0.0)
    bands, carrier_hz, channels = _bands(letters, frequency, sat)
    code = _codes(names, [records[int(k)] for k in order], letters, bands)
    state = np.nan_to_num(column["State"], nan=0.0).astype(np.int64)
    flight, resolved = _flight_ns(letters, state, gps_ns, sent_ns)
    uncertain = np.nan_to_num(column["ReceivedSvTimeUncertaintyNanos"], nan=0.0) > _WORST_NS
    good = resolved & ~uncertain & (bands != "")
    pseudorange = np.where(good, (flight + rest_ns) * 1e-9 * SPEED_OF_LIGHT, np.nan)
    if not good.all():
        notes.append(
            f"{int((~good).sum())} of {len(good)} raw measurements have no pseudorange: code not locked, time of "
            f"transmission ambiguous or less certain than {_WORST_NS:.0f} ns."
        )
    notes.extend(_strange_systems(letters, state, good))
    carrier, lock = _carrier(column, carrier_hz, notes)
    named = bands != ""
    signals, signal = np.unique(code[named], return_inverse=True)
    start = int(gps_ns[0] // _WEEK_NS * _WEEK_NS)
    # satellites of an epoch share its time, be their rests of nanoseconds what they may
    t = (gps_ns - start) / _NS
    observations = Observations(
        t[named], sat[named], signal, tuple(str(s) for s in signals), pseudorange[named],
        column["PseudorangeRateMetersPerSecond"][named], carrier[named], column["Cn0DbHz"][named],
        epoch_gps_s=float(start // _NS), glonass_channels=channels, notes=tuple(notes), lock=lock[named],
    )  # fmt: skip
    tied = np.isfinite(boot) & (boot > 0.0)
    return RawMeasurements(observations, boot[tied].astype(np.int64), gps_ns[tied])


def _columns(
    path: Path, names: Sequence[str], records: Sequence[Sequence[str]], notes: list[str]
) -> tuple[IntArray, FloatArray, list[Sequence[str]]]:
    """Whole nanoseconds (0 where there are none), other numbers (NaN) and the records. Shapes (n, 3), (n, m), (n,)."""
    place = {name: k for k, name in enumerate(names)}

    def parse(fields: Sequence[str]) -> tuple[list[int], list[float]]:
        integers = [int(_field(fields, place[name]) or 0) for name in _WHOLE]
        if max(map(abs, integers)) > _LARGEST:
            raise ValueError(f"impossible time {max(integers, key=abs)} ns")
        return integers, [float(_field(fields, place.get(name)) or "nan") for name in _NUMBERS]

    kept, rows = sound_records(path, "Raw", records, parse, notes)
    table = np.array([row[1] for row in rows], dtype=np.float64).reshape(len(rows), len(_NUMBERS))
    table[np.abs(table) > float(_LARGEST)] = np.nan
    whole = np.array([row[0] for row in rows], dtype=np.int64).reshape(len(rows), len(_WHOLE))
    return whole, table, [records[k] for k in kept]


def sound_records(
    path: Path, kind: str, records: Sequence[Sequence[str]], parse: Callable[[Sequence[str]], _Row], notes: list[str]
) -> tuple[list[int], list[_Row]]:
    """Places of the records of a kind that hold numbers, and what ``parse`` makes of them.

    Up to a hundredth of them may be damaged, and the last one cut off: these are left out, and noted.

    Raises
    ------
    FileFormatError
        With the first damaged record, where there are more.
    """
    kept: list[int] = []
    rows: list[_Row] = []
    first, last = "", 0
    for number, fields in enumerate(records, 1):
        try:
            rows.append(parse(fields))
            kept.append(number - 1)
        except (ValueError, IndexError) as error:
            shown = f"expected numbers, got {lines.shorten(','.join(fields), 60)}"
            reason = str(error) if str(error).startswith("impossible") else shown
            first, last = first or f"record {number} of {kind}: {reason}", number
    bad = len(records) - len(kept)
    if bad > _DAMAGED * len(records) and not (bad == 1 and kept and last == len(records)):
        raise FileFormatError(first, path)
    if bad:
        notes.append(f"{bad} of {len(records)} records {kind} are damaged and were left out, the first: {first}")
    return kept, rows


def _field(fields: Sequence[str], place: int | None) -> str:
    return fields[place] if place is not None and place < len(fields) else ""


def _satellites(constellation: FloatArray, svid: FloatArray) -> tuple[IntArray, np.ndarray]:
    """Numbers of satellites, -1 where it is none (GLONASS by its channel alone too), and their systems' letters."""
    sat, letters = np.full(len(svid), -1), np.full(len(svid), "", dtype="<U1")
    for kind, (letter, zero) in _CONSTELLATIONS.items():
        mine = constellation == kind
        number = np.nan_to_num(svid - zero, nan=0.0)
        letters[mine] = letter
        valid = mine & (number >= 1) & (number <= (27 if letter == "R" else 99))
        sat[valid] = 100 * SYSTEMS.index(letter) + number[valid].astype(np.int64)
    return sat, letters


def _reception(
    time_ns: IntArray, full_ns: IntArray, column: Mapping[str, FloatArray], notes: list[str]
) -> tuple[IntArray, FloatArray]:
    """GPS time of reception by the receiver's clock, whole nanoseconds and the rest. Shapes (n,). [ns]"""
    count = np.nan_to_num(column["HardwareClockDiscontinuityCount"], nan=0.0)
    moved = np.abs(np.diff(full_ns)) > _BIAS_JUMP_NS + _DRIFT * np.abs(np.diff(time_ns))
    fresh = np.concatenate(([True], (np.diff(count) != 0.0) | moved))
    first = np.flatnonzero(fresh)[np.cumsum(fresh) - 1]
    if fresh.sum() > 1:
        notes.append(
            f"The phone's clock was discontinuous {int(fresh.sum()) - 1} times: ranges and carriers begin anew there."
        )
    bias = np.nan_to_num(column["BiasNanos"], nan=0.0)[first]
    rest = np.nan_to_num(column["TimeOffsetNanos"], nan=0.0) - bias
    return time_ns - full_ns[first], rest


def _of_another_time(gps_ns: IntArray, boot_ns: FloatArray, use: BoolArray, notes: list[str]) -> BoolArray:
    """Measurements from before the phone knew GPS time, off by more than ten seconds by its time since boot. (n,)"""
    tied = use & np.isfinite(boot_ns) & (boot_ns > 0.0)
    off = gps_ns - np.where(tied, boot_ns, 0.0)
    strange: BoolArray = tied & (np.abs(off - np.median(off[tied] if tied.any() else off)) > _STRANGE_NS)
    if strange.any():
        notes.append(
            f"{int(strange.sum())} raw measurements were left out: the phone's GPS time was off by "
            f"{np.abs(off - np.median(off[tied]))[strange].max() / _NS:.0f} s against its time since boot."
        )
    return strange


def _strange_systems(letters: np.ndarray, state: IntArray, good: BoolArray) -> list[str]:
    """Systems none of whose measurements has a pseudorange, although most say that their time is decoded."""
    locked = (state & (_CODE_LOCK | _E1BC_CODE_LOCK)) > 0
    decoded = locked & ((state & (_TOW_DECODED | _TOW_KNOWN | _GLO_TOD_DECODED | _GLO_TOD_KNOWN)) > 0)
    return [
        f"Not one measurement of {SYSTEM_NAMES[str(letter)]} has a pseudorange, although {int(decoded[mine].sum())} of "
        f"{int(mine.sum())} say that their time is decoded: the phone counts that system's time otherwise."
        for letter in np.unique(letters)
        if not good[mine := letters == letter].any() and decoded[mine].mean() > 0.5
    ]


def _bands(letters: np.ndarray, frequency: FloatArray, sat: IntArray) -> tuple[np.ndarray, FloatArray, dict[int, int]]:
    """RINEX band, "" where the frequency is none of the system's, nominal frequency [Hz], and GLONASS channels.

    Without a frequency (logs of version 1) the band is that of L1; BeiDou's is B1I.
    """
    bands, hertz = np.full(len(sat), "", dtype="<U1"), np.full(len(sat), np.nan)
    channels: dict[int, int] = {}
    for letter in np.unique(letters):
        mine = letters == letter
        if letter == "R":
            for band, (zero, step) in GLONASS_BANDS.items():
                channel = np.round((frequency - zero) / step)
                near = mine & (np.abs(channel) <= 13)
                bands[near], hertz[near] = band, zero + step * channel[near]
                channels |= {int(s): int(c) for s, c in zip(sat[near], channel[near], strict=True)}
            bands[mine & (frequency == 0.0)] = "1"
            continue
        options = [(band, f) for (system, band), f in BANDS.items() if system == letter]
        nominal = np.array([f for _, f in options])
        usual = 1561.098e6 if letter == "C" else nominal[0] if letter == "I" else 1575.42e6
        asked = np.where(frequency[mine] > 0.0, frequency[mine], usual)
        nearest = np.argmin(np.abs(asked[:, None] - nominal), axis=1)
        close = np.abs(asked - nominal[nearest]) < 1e6
        bands[mine] = np.where(close, np.array([band for band, _ in options])[nearest], "")
        hertz[mine] = np.where(close, nominal[nearest], np.nan)
    return bands, hertz, channels


def _codes(
    names: Sequence[str], records: Sequence[Sequence[str]], letters: np.ndarray, bands: np.ndarray
) -> np.ndarray:
    """RINEX signals, such as 1C: band, and the code the log names or the usual one. Shape (n,)."""
    place = names.index("CodeType") if "CodeType" in names else None
    stated = [_field(fields, place).strip() for fields in records]
    return np.array(
        [
            f"{band}{text if len(text) == 1 and text.isalpha() else _ATTRIBUTES.get((str(letter), str(band)), 'C')}"
            for band, letter, text in zip(bands, letters, stated, strict=True)
        ],
        dtype="<U2",
    )


def _flight_ns(letters: np.ndarray, state: IntArray, gps_ns: IntArray, sent_ns: IntArray) -> tuple[IntArray, BoolArray]:
    """Time of flight without rests of nanoseconds, and where it is resolved. Shapes (n,). [ns]"""
    locked = (state & (_CODE_LOCK | _E1BC_CODE_LOCK)) > 0
    in_week = (state & (_TOW_DECODED | _TOW_KNOWN)) > 0
    in_day = (state & (_GLO_TOD_DECODED | _GLO_TOD_KNOWN)) > 0
    secondary = (letters == "E") & ((state & _E1C_SECONDARY) > 0) & ~in_week
    glonass, beidou = letters == "R", letters == "C"
    here = np.where(beidou, gps_ns - int(BDT_TO_GPS_S) * _NS, gps_ns)
    leap = leap_seconds_at(gps_ns[glonass] // _NS, None).astype(np.int64)
    here[glonass] += (3 * 3600 - leap) * _NS
    period = np.where(glonass, _DAY_NS, np.where(secondary, _SECONDARY_NS, _WEEK_NS))
    flight = np.mod(here - sent_ns, period)
    unambiguous = np.where(glonass, in_day, in_week | secondary) & ((state & _MSEC_AMBIGUOUS) == 0)
    return flight, np.asarray(locked & unambiguous & (flight < _FARTHEST_NS))


def _carrier(column: Mapping[str, FloatArray], carrier_hz: FloatArray, notes: list[str]) -> tuple[FloatArray, IntArray]:
    """Carrier phase [cycles], NaN where it is not valid or an arc begins, and half cycles in doubt. Shapes (n,)."""
    state = np.nan_to_num(column["AccumulatedDeltaRangeState"], nan=0.0).astype(np.int64)
    valid = (state & _ADR_VALID) > 0
    broken = valid & ((state & (_ADR_RESET | _ADR_SLIP)) > 0)
    half = valid & ((state & _ADR_HALF_REPORTED) > 0) & ((state & _ADR_HALF_RESOLVED) == 0)
    if broken.any():
        notes.append(f"{int(broken.sum())} carriers with a reset or a cycle slip were left out: arcs end there.")
    if half.any():
        notes.append(
            f"{int((half & ~broken).sum())} carriers may be off by half a cycle: arcs end where that is settled."
        )
    metres = np.where(valid & ~broken, column["AccumulatedDeltaRangeMeters"], np.nan)
    return np.asarray(metres * carrier_hz / SPEED_OF_LIGHT), np.where(half & ~broken, _HALF_CYCLE, 0)
