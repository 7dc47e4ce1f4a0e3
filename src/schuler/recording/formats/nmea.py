"""NMEA 0183 logs: GGA positions with accuracy from GST or dilution of precision, velocity from RMC or VTG.

NMEA says little about accuracy. Where GST is logged its 1-sigmas are taken; without it a position gets HDOP and VDOP
times a range error by kind of fix (:data:`RANGE_ERROR`), which is a rule of thumb and noted as such.
"""

from __future__ import annotations

import datetime as dt
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError, InputError, MissingExtraError
from schuler.recording.io import checks
from schuler.recording.io.assemble import metadata_of
from schuler.recording.io.clock import from_gps
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.lines import check_file
from schuler.recording.io.over_ground import NO_HEIGHT, NO_VELOCITY, NO_VERTICAL_RATE
from schuler.recording.io.raw import HUGE
from schuler.recording.recording import Recording
from schuler.recording.series import GnssSeries, stated_dilution
from schuler.timebase import UNIX_TO_GPS_S, TimeBase, gps_from_calendar, gps_from_unix

#: 1-sigma of a range by GGA's quality, which HDOP and VDOP multiply: single, differential, precise, fixed, float,
#: estimated. [m]
RANGE_ERROR = MappingProxyType({1: 5.0, 2: 2.0, 3: 3.0, 4: 0.02, 5: 0.4, 6: 20.0})
#: 1-sigma of a range rate, which HDOP (at least 1) multiplies. [m/s]
RATE_ERROR = 0.1
VERTICAL = 1.5  # VDOP over HDOP where there is no GSA; typical of an open sky
_QUALITY = {1: 5, 2: 4, 3: 5, 4: 1, 5: 2, 6: 7}  # to RTKLIB's numbers; 7 (typed in) and 8 (simulator) are no fixes

_SENTENCE = re.compile(rb"\$([A-Z]{2})(GGA|RMC|GST|VTG|GSA|ZDA)(,[^$*\r\n]*)\*([0-9A-Fa-f]{2})")
_LOOKS = re.compile(rb"\$[A-Z]{2}(?:GGA|RMC|GLL|GSA|GSV|VTG|ZDA|GST|TXT),[ -~]*\*[0-9A-Fa-f]{2}\r?\n")
_USED = {"height", "geoid_separation", "sigma", "allow", "offset", "name", "series"}
#: Fields that are used; a sentence cut short and summed up anew lacks some.
_FIELDS = MappingProxyType({
    "GGA": ("quality", "lat", "lon", "alt", "sep", "HDOP", "numSV"), "GST": ("stdLat", "stdLong", "stdAlt"),
    "GSA": ("VDOP",), "RMC": ("status", "spd", "cog", "date", "lat", "lon"), "VTG": ("sogk", "cogt"),
    "ZDA": ("year", "month", "day"),
})  # fmt: skip
_WRONG_SUM = "sentences with a wrong checksum were left out"
_DAY_S = 86_400.0


@dataclass(frozen=True)
class _Place:
    """Position of an RMC, which has neither height nor dilution of precision, as a GGA has it."""

    lat: float
    lon: float
    quality: int
    alt: float = 0.0
    sep: float = 0.0
    HDOP: float = 1.0
    numSV: int = 0


@dataclass
class Epoch:
    """Sentences of one time of day.

    Attributes
    ----------
    second : float, optional
        UTC time of day; ``None`` until a sentence says it. [s]
    sentences : dict
        The first sentence of each kind, decoded.
    """

    second: float | None = None
    sentences: dict[str, Any] = field(default_factory=dict)

    @property
    def has_position(self) -> bool:
        """Whether there is a GGA."""
        return "GGA" in self.sentences

    @property
    def has_fix(self) -> bool:
        """Whether there is a GGA whose position was measured."""
        gga = self.sentences.get("GGA")
        return gga is not None and gga.quality in _QUALITY and _is_place(gga)


def looks_like_nmea(head: bytes) -> bool:
    """Whether the first bytes of a file hold sentences of NMEA 0183, whatever its suffix."""
    return _LOOKS.search(head) is not None


def read_nmea(path: Path | str, hints: ReadHints | None = None) -> Recording:
    """GNSS series of an NMEA log.

    Parameters
    ----------
    path : Path or str
        Text, perhaps with binary messages between the sentences.
    hints : ReadHints, optional
        ``height="msl"`` with ``geoid_separation`` in place of the receiver's own separation (or where it gives none);
        ``sigma`` where there is no GST; ``offset``, ``name``.

    Returns
    -------
    Recording
        On GPS time, counted from the start of the first epoch's week.

    Raises
    ------
    FileFormatError
        If there is no GGA with a fix, no date (RMC or ZDA), or no geoid separation.
    InputError
        If a hint is given that the log answers itself, or the date is beyond the table of leap seconds.
    MissingExtraError
        If pynmeagps is not installed.

    Notes
    -----
    Sentences with a wrong checksum are counted and left out. GGA has a time of day only; the nearest RMC or ZDA in the
    log gives the date, so a log may run past midnight. HDOP is shared evenly by north and east. NMEA's velocity is
    horizontal: the vertical one is zero with a 1-sigma of 10 m/s.
    """
    path, hints = Path(path), hints or ReadHints()
    hints.check_used(path, _USED, "an NMEA log")
    check_file(path)
    notes: list[str] = []
    epochs = _epochs(path.read_bytes(), notes)
    if not any(e.has_position for e in epochs):
        _place_by_rmc(epochs)
    fixes = [e for e in epochs if e.has_position]
    if not fixes:
        lost = next((note.partition(" ")[0] for note in notes if _WRONG_SUM in note), None)
        why = (
            "enable GGA"
            if lost is None
            else (
                f"{lost} have a wrong one, since bytes were lost on the way to the file: log with a larger buffer, at "
                "a lower rate or a higher baud rate, or fewer sentences"
            )
        )
        raise FileFormatError(f"expected NMEA sentences GGA or RMC, found none with a right checksum: {why}", path)
    kept = [e for e in fixes if e.has_fix]
    if len(kept) < len(fixes):
        notes.append(f"{len(fixes) - len(kept)} epochs without a fix were left out.")
    if not kept:
        raise FileFormatError(f"none of the {len(fixes)} GGA sentences has a fix (quality 0, or typed in)", path)
    gnss, base = series_of(path, epochs, kept, hints, notes)
    notes += checks.timing_notes(gnss.t)
    return Recording(gnss=gnss, metadata=metadata_of(path, hints, base, notes))


def _place_by_rmc(epochs: list[Epoch]) -> None:
    """Take positions of RMC where a log has no GGA."""
    for epoch in epochs:
        rmc = epoch.sentences.get("RMC")
        if rmc is not None and rmc.status == "A" and _is_place(rmc):
            quality = 2 if getattr(rmc, "posMode", "") == "D" else 1
            epoch.sentences["GGA"] = _Place(float(rmc.lat), float(rmc.lon), quality)


def series_of(
    path: Path, epochs: list[Epoch], kept: list[Epoch], hints: ReadHints, notes: list[str]
) -> tuple[GnssSeries, TimeBase]:
    """GNSS series of the epochs with a fix.

    Parameters
    ----------
    path : Path
        For messages.
    epochs : list of Epoch
        In order; the nearest with a date gives each its day.
    kept : list of Epoch
        Those of them with a fix.
    hints : ReadHints
        See :func:`read_nmea`.
    notes : list of str
        Takes sentences on what was assumed.

    Raises
    ------
    FileFormatError
        If there is no date, no geoid separation, or no accuracy.
    """
    gps_s = _gps_times(path, epochs, kept)
    later = gps_s > np.concatenate(([-np.inf], np.maximum.accumulate(gps_s)[:-1]))
    if not later.all():
        notes.append(f"{int(np.sum(~later))} epochs not later than the one before were left out.")
    kept = [e for e, ok in zip(kept, later, strict=True) if ok]
    t, base = from_gps(np.floor(gps_s[later]), gps_s[later] % 1.0)
    if hints.offset:
        notes.append(f"{hints.offset:g} s was added to every time stamp.")
        t = t + hints.offset
    llh = _positions(path, kept, hints, notes)
    cov_r_n = _position_covariance(path, kept, hints, notes)
    v_n, cov_v_n = _velocities(kept, hints, notes)
    gga = [e.sentences["GGA"] for e in kept]
    series = GnssSeries(
        t, llh, cov_r_n, v_n, cov_v_n, np.array([_QUALITY[m.quality] for m in gga]),
        None if isinstance(gga[0], _Place) else np.array([int(_number(m.numSV)) for m in gga]),
        dop=None if isinstance(gga[0], _Place) else stated_dilution(*np.array([_stated(e) for e in kept]).T),
    )  # fmt: skip
    return series, base


def _sentences(data: bytes, left_out: Counter[str]) -> Iterator[tuple[str, Any]]:
    """Kind and decoded fields of the sentences used, in order."""
    try:
        from pynmeagps import VALNONE, NMEAReader
        from pynmeagps.exceptions import NMEAMessageError, NMEAParseError, NMEATypeError
    except ImportError as error:
        raise MissingExtraError("pynmeagps", "gnss", "reading NMEA logs") from error
    for match in _SENTENCE.finditer(data):
        checksum = 0
        for byte in match.group()[1:-3]:
            checksum ^= byte
        if checksum != int(match.group(4), 16):
            left_out[_WRONG_SUM] += 1
            continue
        try:
            message = NMEAReader.parse(match.group() + b"\r\n", validate=VALNONE)
        except (NMEAMessageError, NMEAParseError, NMEATypeError, ValueError):
            message = None
        kind = match.group(2).decode()
        if message is None or not all(hasattr(message, name) for name in _FIELDS.get(kind, ())):
            left_out["sentences could not be read in spite of a right checksum and were left out"] += 1
            continue
        yield kind, message


def _epochs(data: bytes, notes: list[str]) -> list[Epoch]:
    """Sentences by epoch; VTG and GSA, which have no time, belong to the sentence before them."""
    epochs, left_out = [Epoch()], Counter[str]()
    add_sentences(epochs, data, left_out)
    notes += [f"{count} {text}." for text, count in left_out.items()]
    return [e for e in epochs if e.second is not None]


def add_sentences(epochs: list[Epoch], data: bytes, left_out: Counter[str]) -> None:
    """Put the sentences of some bytes into the last epoch of a list, or into new ones behind it.

    Parameters
    ----------
    epochs : list of Epoch
        One at least.
    data : bytes
        Whole lines; what is no sentence is passed over.
    left_out : Counter
        Counts what was left out, by a phrase that says why.
    """
    for kind, message in _sentences(data, left_out):
        time = getattr(message, "time", None)
        if isinstance(time, dt.time):
            second = time.hour * units.HR + time.minute * units.MIN + time.second + time.microsecond * 1e-6
            if epochs[-1].second is None:
                epochs[-1].second = second
            elif second != epochs[-1].second:
                epochs.append(Epoch(second))
        epochs[-1].sentences.setdefault(kind, message)


def _gps_times(path: Path, epochs: list[Epoch], kept: list[Epoch]) -> FloatArray:
    """GPS time of epochs since 1980, the day from the nearest epoch with a date. [s]"""
    dated: list[tuple[int, float]] = []
    for k, e in enumerate(epochs):
        if (day := date_of(e.sentences)) is not None and e.second is not None:
            dated.append((k, gps_from_calendar(dt.datetime.combine(day, dt.time())) + e.second))
    if not dated:
        raise FileFormatError("GGA has no date: log RMC or ZDA too, on the same receiver", path)
    places = np.array([k for k, _ in dated])
    place_of = {id(e): k for k, e in enumerate(epochs)}
    utc = np.empty(len(kept))
    for row, e in enumerate(kept):
        near = dated[int(np.argmin(np.abs(places - place_of[id(e)])))][1]
        second = float(e.second or 0.0)
        utc[row] = second + _DAY_S * round((near - second) / _DAY_S)
    try:
        return gps_from_unix(utc + UNIX_TO_GPS_S)
    except InputError as error:
        raise FileFormatError(str(error), path) from error


def date_of(sentences: dict[str, Any]) -> dt.date | None:
    """Day that the sentences of an epoch state, in RMC or ZDA."""
    if "RMC" in sentences and isinstance(sentences["RMC"].date, dt.date):
        return sentences["RMC"].date
    if "ZDA" in sentences:
        zda = sentences["ZDA"]
        try:
            return dt.date(int(zda.year), int(zda.month), int(zda.day))
        except (TypeError, ValueError):
            return None
    return None


def _positions(path: Path, kept: list[Epoch], hints: ReadHints, notes: list[str]) -> FloatArray:
    llh = np.empty((len(kept), 3))
    for row, e in enumerate(kept):
        gga = e.sentences["GGA"]
        separation = hints.geoid_separation if hints.geoid_separation is not None else gga.sep
        if not (_is_number(separation) and _is_number(gga.alt)):
            raise FileFormatError(
                "GGA gives heights above mean sea level without a geoid separation: say height='msl' and "
                "geoid_separation=... [m]",
                path,
            )
        llh[row] = gga.lat * units.DEG, gga.lon * units.DEG, gga.alt + separation
    if isinstance(kept[0].sentences["GGA"], _Place):
        notes.append(
            f"There is no GGA: positions are those of RMC, without heights, which are zero with a 1-sigma of "
            f"{NO_HEIGHT:g} m; heights of the solution mean nothing."
        )
        return llh
    whose = "stated" if hints.geoid_separation is not None else "receiver's"
    notes.append(f"Heights above mean sea level were made ellipsoidal with the {whose} geoid separation.")
    return llh


def _position_covariance(path: Path, kept: list[Epoch], hints: ReadHints, notes: list[str]) -> FloatArray:
    sigma = np.empty((len(kept), 3))
    guessed = 0
    for row, e in enumerate(kept):
        gst = e.sentences.get("GST")
        stated = () if gst is None else (_number(gst.stdLat), _number(gst.stdLong), _number(gst.stdAlt))
        if stated and min(stated) > 0.0:
            sigma[row] = stated
            continue
        guessed += 1
        flat = isinstance(e.sentences["GGA"], _Place)
        if hints.sigmas is not None:
            sigma[row] = hints.sigmas[:3]
            continue
        horizontal, vertical = _dilutions(e)
        if not horizontal > 0.0:
            raise FileFormatError(
                "an epoch has neither GST nor HDOP, so nothing says how accurate it is: say sigma='N,E,D' [m]", path
            )
        error = RANGE_ERROR[e.sentences["GGA"].quality]
        sigma[row] = (*2 * (error * horizontal / np.sqrt(2.0),), NO_HEIGHT if flat else error * vertical)
    if guessed:
        times = "" if isinstance(kept[0].sentences["GGA"], _Place) else "HDOP and VDOP times "
        how = (
            f"was set to {hints.sigmas[:3]} m"
            if hints.sigmas is not None
            else f"is a rule of thumb: {times}a range error by kind of fix (hint sigma replaces it)"
        )
        notes.append(f"{guessed} epochs have no GST; their 1-sigma {how}.")
    cov = np.zeros((len(kept), 3, 3))
    cov[:, [0, 1, 2], [0, 1, 2]] = sigma**2
    return cov


def _dilutions(e: Epoch) -> tuple[float, float]:
    """HDOP and VDOP of an epoch, the latter guessed from the former where there is no GSA; 0 if unknown."""
    horizontal, vertical = _stated(e)
    return horizontal, vertical if vertical > 0.0 else VERTICAL * horizontal


def _stated(e: Epoch) -> tuple[float, float]:
    """HDOP and VDOP of an epoch as GGA and GSA state them; 0 if unknown."""
    return _number(e.sentences["GGA"].HDOP), _number(e.sentences["GSA"].VDOP) if "GSA" in e.sentences else 0.0


def _velocities(kept: list[Epoch], hints: ReadHints, notes: list[str]) -> tuple[FloatArray | None, FloatArray | None]:
    v_n, sigma = np.zeros((len(kept), 3)), np.full((len(kept), 3), NO_VELOCITY)
    stated = hints.sigmas[3:] if hints.sigmas is not None and len(hints.sigmas) == 6 else None
    missing = 0
    for row, e in enumerate(kept):
        over_ground = _course(e.sentences)
        if over_ground is None:
            missing += 1
            continue
        speed, course = over_ground
        horizontal = RATE_ERROR * max(1.0, _dilutions(e)[0])
        sigma[row] = stated if stated is not None else (horizontal, horizontal, NO_VERTICAL_RATE)
        if course is not None:
            v_n[row, :2] = speed * np.cos(course), speed * np.sin(course)
        else:  # too slow for a course: the speed may be in any direction
            sigma[row, :2] = np.hypot(sigma[row, :2], speed)
    if missing == len(kept):
        return None, None
    if stated is None:
        notes.append(
            "Velocities are horizontal and come without accuracy: 1-sigma is 0.1 m/s times HDOP, and 10 m/s vertically "
            "(hint sigma with six numbers replaces it)."
        )
    else:
        notes.append(f"Velocities got the stated 1-sigma {stated} m/s; their vertical component is zero.")
    if missing:
        notes.append(f"{missing} epochs have no velocity; it was set to zero with a 1-sigma of {NO_VELOCITY:g} m/s.")
    cov = np.zeros((len(kept), 3, 3))
    cov[:, [0, 1, 2], [0, 1, 2]] = sigma**2
    return v_n, cov


def _course(sentences: dict[str, Any]) -> tuple[float, float | None] | None:
    """Speed over ground [m/s] and course [rad] of RMC or VTG; a receiver at rest leaves the course out."""

    def course(value: Any) -> float | None:
        return float(value) * units.DEG if _is_number(value) else None

    rmc, vtg = sentences.get("RMC"), sentences.get("VTG")
    if rmc is not None and rmc.status == "A" and _is_number(rmc.spd):
        return float(rmc.spd) * units.KNOT, course(rmc.cog)
    if vtg is not None and _is_number(vtg.sogk):
        return float(vtg.sogk) * units.KMH, course(vtg.cogt)
    return None


def _number(value: Any) -> float:
    """A field as a number, zero where it is empty."""
    return float(value) if _is_number(value) else 0.0


def _is_number(value: Any) -> bool:
    """Whether a field is a finite number: empty and damaged ones are text."""
    return isinstance(value, int | float) and -HUGE <= value <= HUGE


def _is_place(gga: Any) -> bool:
    return _is_number(gga.lat) and _is_number(gga.lon)
