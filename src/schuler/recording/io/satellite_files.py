"""Files of satellite receivers among other logs: which ones they are, and what each gives as a recording."""

from __future__ import annotations

import bz2
import re
import zlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from schuler.exceptions import SchulerError
from schuler.gnss.ephemerides import Ephemerides, no_glonass, no_kepler
from schuler.recording.formats import instinct_csv, nmea, psins, rtcm, ubx
from schuler.recording.io.assemble import metadata_of
from schuler.recording.io.hints import ReadHints
from schuler.recording.recording import Recording
from schuler.timebase import WEEK_S, TimeBase

_RINEX, _COMPACT = b"RINEX VERSION / TYPE", b"CRINEX VERS"
_ANTEX, _IONEX = b"ANTEX VERSION", b"IONEX VERSION"
_NAVIGATION = b"NGHELJ"  # letters of kinds in column 21, see rinex_header.KINDS
_COMPRESS = b"\x1f\x9d"
_USED = {"name", "series"}
_RECEIVER = b"GNSS1::PosLla"
_BIASES, _DIFFERENCES = b"%=BIA ", b" DCB SOLUTION"
_SP3 = re.compile(rb"#[a-d][PV]\d{4} ")
#: Arrays of a PSINS file of ranges.
PSINS_ARRAYS = frozenset({"imu", "obss", "ephs", "t0"})


def rinex_kind(path: Path, head: bytes) -> str | None:
    """``observations`` or ``ephemerides`` for a RINEX file, packed or not; None for anything else.

    Parameters
    ----------
    path : Path
        Its suffix tells the kind of a file packed with compress (.Z), which only the reader unpacks.
    head : bytes
        First bytes, see :func:`schuler.recording.io.lines.check_file`.
    """
    first = _opening(path, head).removeprefix(b"\xef\xbb\xbf")[:100].partition(b"\n")[0]
    if first[60:].startswith(_COMPACT):
        return "observations"
    if first[60:].startswith(_RINEX):
        return "ephemerides" if first[20:21].upper() in _NAVIGATION else "observations"
    if head.startswith(_COMPRESS):
        return "observations" if path.stem.lower()[-1:] in ("o", "d") else "ephemerides"
    return None


def kinds_of(path: Path, head: bytes) -> tuple[str, ...]:
    """Series that a receiver's file holds by its looks; empty if it is none. No file is read whole for this."""
    if _precise_kind(path, head) is not None:
        return ("ephemerides",)
    if (kind := rinex_kind(path, head)) is not None:
        return (kind,)
    if _is_ubx(path, head):
        messages = {span[0] for span in ubx.find_frames(head).spans}
        held = [name for name, code in (("gnss", ubx.PVT), ("observations", ubx.RAWX)) if code in messages]
        return tuple(held) or ("observations",)
    if rtcm.is_rtcm(path):
        return ("observations",)
    if _is_nmea(path, head):
        return ("gnss",)
    if psins.looks_like_psins_imu(head):
        return ("imu",)
    if instinct_csv.looks_like_instinct_csv(head):
        return ("gnss",) if _RECEIVER in head else ("imu",)
    return ("imu", "observations") if is_psins_ranges(path, head) else ()


def read_satellite_file(
    path: Path, head: bytes, hints: ReadHints, glonass_channels: Mapping[int, int] | None = None
) -> Recording | None:
    """Recording of a receiver's file, or None if it is none.

    Parameters
    ----------
    path : Path
    head : bytes
        First bytes of the file.
    hints : ReadHints
        RINEX and PSINS ranges: ``name`` only, since they say everything else themselves. With ``columns`` (or, in a
        MATLAB file, ``variable``) a table is left to the reader of such tables.
    glonass_channels : mapping of int to int, optional
        For RINEX observations whose header has none.

    Raises
    ------
    FileFormatError, InputError
        As the readers do, or for hints the file answers itself.
    """
    if (precise := _precise_kind(path, head)) is not None:
        return _precise(path, hints, precise)
    kind = rinex_kind(path, head)
    if kind == "ephemerides":
        return _navigation(path, hints)
    if kind == "observations":
        return _observations(path, hints, glonass_channels)
    if _is_ubx(path, head):  # before NMEA, whose sentences may stand between its frames
        return ubx.read_ubx_recording(path, hints)
    if rtcm.is_rtcm(path):
        return rtcm.read_rtcm_recording(path, hints)
    if _is_nmea(path, head):
        return nmea.read_nmea(path, hints)
    if hints.columns is not None:  # the tables below can also be read column by column
        return None
    if psins.looks_like_psins_imu(head):
        return psins.read_psins_imu(path, hints)
    if instinct_csv.looks_like_instinct_csv(head):
        if _RECEIVER in head:
            return instinct_csv.read_instinct_gnss(path, hints).recording
        return instinct_csv.read_instinct_imu(path, hints)
    if hints.variable is None and is_psins_ranges(path, head):
        from schuler.recording.formats.psins import read_psins_ranges

        hints.check_used(path, _USED, "a PSINS file of ranges")
        recording = read_psins_ranges(path).recording
        return replace(recording, metadata=replace(recording.metadata, name=hints.name or path.stem))
    return None


def is_psins_ranges(path: Path, head: bytes) -> bool:
    """Whether a file is PSINS's ``.mat`` of increments, ranges and ephemerides, from the names in it."""
    if not head.startswith(b"MATLAB 5.0"):
        return False
    from schuler.recording.formats import matlab

    return matlab.variables(path).keys() >= PSINS_ARRAYS


def _opening(path: Path, head: bytes) -> bytes:
    """First bytes of what is packed in a file, or the file's own."""
    try:
        if head.startswith(b"\x1f\x8b"):
            return zlib.decompressobj(wbits=31).decompress(head, 4096)
        if head.startswith(b"BZh"):
            # a block of up to 900 kB has to be complete before anything comes out
            return bz2.BZ2Decompressor().decompress(path.read_bytes(), 4096)
        if head.startswith(b"PK\x03\x04") and path.suffix.lower() != ".npz":
            from schuler.recording.formats.rinex_unpack import unpack

            return unpack(path, [])
    except (OSError, EOFError, zlib.error, SchulerError):
        pass
    return head


def _is_ubx(path: Path, head: bytes) -> bool:
    return path.suffix.lower() == ".ubx" or ubx.looks_like_ubx(head)


def _is_nmea(path: Path, head: bytes) -> bool:
    return path.suffix.lower() == ".nmea" or nmea.looks_like_nmea(head)


def _navigation(path: Path, hints: ReadHints) -> Recording:
    from schuler.recording.formats.rinex_navigation import read_rinex_navigation

    hints.check_used(path, _USED, "a RINEX file")
    broadcast = read_rinex_navigation(path)
    times = [*broadcast.kepler.toe[:1], *broadcast.glonass.toe[:1]]
    time = TimeBase("gps", float(times[0] // WEEK_S * WEEK_S) if times else 0.0)
    return Recording(ephemerides=broadcast, metadata=metadata_of(path, hints, time, broadcast.notes))


def _precise_kind(path: Path, head: bytes) -> str | None:
    """``orbits`` (SP3), ``clocks`` (RINEX), ``antennas``, ``maps`` (IONEX), ``biases``, ``differences``; or packed."""
    from schuler.recording.formats.rinex_clock import looks_like_rinex_clock

    first = _opening(path, head).partition(b"\n")[0]
    if first[60:].startswith(_ANTEX):
        return "antennas"
    if first[60:].startswith(_IONEX):
        return "maps"
    if first.startswith(_BIASES):
        return "biases"
    if _DIFFERENCES in first:
        return "differences"
    return "orbits" if _SP3.match(first) else "clocks" if looks_like_rinex_clock(first) else None


def _precise(path: Path, hints: ReadHints, kind: str) -> Recording:
    from schuler.recording.formats.antex import read_antex
    from schuler.recording.formats.ionex import read_ionex
    from schuler.recording.formats.rinex_clock import read_rinex_clock
    from schuler.recording.formats.sinex_bias import read_code_differences, read_sinex_bias
    from schuler.recording.formats.sp3 import read_sp3

    hints.check_used(path, _USED, "a file of precise orbits, clocks, antennas or of the ionosphere")
    if kind == "antennas":
        antennas = Ephemerides(no_kepler(), no_glonass(), antennas=read_antex(path))
        return Recording(ephemerides=antennas, metadata=metadata_of(path, hints, TimeBase("gps", 0.0), ()))
    if kind == "maps":
        maps = read_ionex(path)
        time = TimeBase("gps", float(maps.t[0] // WEEK_S * WEEK_S))
        ephemerides = Ephemerides(no_kepler(), no_glonass(), notes=maps.notes, ionosphere_maps=maps)
        return Recording(ephemerides=ephemerides, metadata=metadata_of(path, hints, time, maps.notes))
    if kind in ("biases", "differences"):
        biases = read_sinex_bias(path) if kind == "biases" else read_code_differences(path)
        ephemerides = Ephemerides(no_kepler(), no_glonass(), code_biases=biases)
        return Recording(ephemerides=ephemerides, metadata=metadata_of(path, hints, TimeBase("gps", 0.0), ()))
    orbits = read_sp3(path) if kind == "orbits" else None
    clocks = read_rinex_clock(path) if kind == "clocks" else None
    (product,) = (x for x in (orbits, clocks) if x is not None)
    time = TimeBase("gps", float(product.t[0] // WEEK_S * WEEK_S))
    ephemerides = Ephemerides(
        no_kepler(), no_glonass(), notes=product.notes, precise_orbits=orbits, precise_clocks=clocks
    )
    return Recording(ephemerides=ephemerides, metadata=metadata_of(path, hints, time, product.notes))


def _observations(path: Path, hints: ReadHints, glonass_channels: Mapping[int, int] | None) -> Recording:
    from schuler.recording.formats.rinex_observation import read_rinex_observation

    hints.check_used(path, _USED, "a RINEX file")
    o = read_rinex_observation(path, glonass_channels=glonass_channels)
    metadata = metadata_of(path, hints, TimeBase("gps", o.epoch_gps_s), o.notes)
    return Recording(observations=o, metadata=metadata)


def channels_of(recording: Recording | None) -> dict[int, int]:
    """GLONASS channels in the ephemerides of a recording; none without."""
    if recording is None or recording.ephemerides is None:
        return {}
    from schuler.recording.formats.rinex_navigation import glonass_channels

    return glonass_channels(recording.ephemerides)
