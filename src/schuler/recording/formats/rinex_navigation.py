"""RINEX navigation files, versions 2, 3 and 4: broadcast orbits, clocks and ionosphere.

georinex (MIT) reads versions 2 and 3 too, as a table by satellite and time in which two messages of one time and
satellite (Galileo's F/NAV and I/NAV) need different names, and which has no BeiDou or GLONASS time; version 4 it does
not read. What stands in fixed columns needs no library.

Sources: RINEX 2.11 (Gurtner and Estey, 2007), 3.05 and 4.01 (IGS and RTCM-SC104), appendices on navigation files.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from schuler.exceptions import FileFormatError
from schuler.gnss.ephemerides import Ephemerides, no_glonass, no_kepler
from schuler.recording.formats.rinex_header import KINDS, RinexFile, broadcast_leap_seconds, numbers_in, read_lines
from schuler.recording.formats.rinex_orbits import glonass_records, kepler_records
from schuler.recording.formats.rinex_records import records_of

#: Header names of ionospheric coefficients: ours, and how many there are.
_COEFFICIENTS = {"GPSA": ("alpha", 4), "GPSB": ("beta", 4), "GAL": ("galileo", 3)}


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

        Of version 4, messages LNAV, INAV, FNAV, D1, D2 and FDMA are read; CNAV and its like, SBAS, NavIC, time offsets
        and Earth orientation are counted in the notes.

    Raises
    ------
    FileFormatError
        With file and line, for what is no navigation file or has malformed messages.
    InputError
        If a packed file needs a library that is not installed, or a GLONASS date is beyond the leap-second table.
    """
    file = read_lines(path)
    if "navigation" not in KINDS[file.kind]:
        advice = "; read it with read_rinex_observation" if file.kind == "O" else ""
        raise FileFormatError(f"expected a RINEX navigation file, got one of {KINDS[file.kind]}{advice}", path)
    records = records_of(file)
    orbits = Ephemerides(no_kepler(), glonass_records(file, records.of("R")))
    for system in "GECJ":
        orbits = orbits.merged_with(Ephemerides(kepler_records(file, records.of(system), system), no_glonass()))
    ionosphere = _ionosphere(file, records.ionosphere)
    alpha, beta, galileo = (ionosphere.get(name) for name in ("alpha", "beta", "galileo"))
    return Ephemerides(
        orbits.kepler,
        orbits.glonass,
        (alpha[0], alpha[1], alpha[2], alpha[3]) if alpha else None,
        (beta[0], beta[1], beta[2], beta[3]) if beta else None,
        (galileo[0], galileo[1], galileo[2]) if galileo else None,
        broadcast_leap_seconds(file),
        tuple(file.notes),
    )


def _ionosphere(file: RinexFile, messages: list[tuple[str, int]]) -> dict[str, tuple[float, ...]]:
    """Coefficients by name; the first of each that are there and are not all zero."""
    said: list[tuple[str, tuple[float, ...] | None]] = []
    for label, name in (("ION ALPHA", "alpha"), ("ION BETA", "beta")):
        said += [(name, numbers_in(text, 12, 4, first=2)) for text in file.header.get(label, [])]
    others: list[str] = []
    for text in file.header.get("IONOSPHERIC CORR", []):
        name, count = _COEFFICIENTS.get(text[:4].strip(), ("", 0))
        if name:
            said.append((name, numbers_in(text, 12, count, first=5)))
        else:
            others.append(text[:4].strip())
    for message, line in messages:
        if message in ("G LNAV", "E IFNV"):
            said += _of_message(file, message, line)
        else:
            others.append(message)
    found: dict[str, tuple[float, ...]] = {}
    empty: set[str] = set()
    for name, values in said:
        if values is not None and any(values):
            found.setdefault(name, values)
        else:
            empty.add(name)
    if missing := sorted(empty - set(found)):
        file.notes.append(f"Ionosphere coefficients that are all zero or cannot be read: {', '.join(missing)}.")
    if others:
        file.notes.append(f"Ionosphere coefficients that are not used: {', '.join(sorted(set(others)))}.")
    return found


def _of_message(file: RinexFile, message: str, line: int) -> list[tuple[str, tuple[float, ...] | None]]:
    """Coefficients of an ionospheric message of version 4: three on the line of the date, then four on each."""
    needed = 3 if message == "G LNAV" else 1
    if line + needed > len(file):
        return []
    first = numbers_in(file.text(line).ljust(80), 19, 3, first=23)
    if message == "E IFNV":
        return [("galileo", first)]
    second = numbers_in(file.text(line + 1).ljust(80), 19, 4, first=4)
    third = numbers_in(file.text(line + 2).ljust(80), 19, 1, first=4)
    if first is None or second is None or third is None:
        return [("alpha", None), ("beta", None)]
    return [("alpha", (*first, second[0])), ("beta", (*second[1:], *third))]


def glonass_channels(ephemerides: Ephemerides) -> dict[int, int]:
    """FDMA channel by satellite, the last one broadcast.

    Parameters
    ----------
    ephemerides : Ephemerides

    Returns
    -------
    dict of int to int
        What :func:`~schuler.recording.formats.rinex_observation.read_rinex_observation` takes.
    """
    records = ephemerides.glonass
    order = np.argsort(records.toe, kind="stable")
    return dict(zip(records.sat[order].tolist(), records.channel[order].tolist(), strict=True))
