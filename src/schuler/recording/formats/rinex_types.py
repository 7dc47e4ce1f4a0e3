"""Observation types of RINEX headers, and the signals they belong to.

A type of RINEX 3 and 4 is a kind (C code, L phase, D Doppler, S strength), a band and an attribute: ``C1C``. RINEX 2
has a kind and a band only, and which signal was tracked is partly left to the reader. What is assumed:

=========  ==================================  =================================
RINEX 2    Systems                             Signal
=========  ==================================  =================================
C1         GPS, GLONASS, QZSS, SBAS            1C
C1, L1..   Galileo                             1X
C1, C2..   BeiDou (B1)                         2I
P1         GPS 1W, GLONASS 1P
C2         GPS, QZSS 2X (L2C), GLONASS 2C
P2         GPS 2W, GLONASS 2P
C5-C8      all                                 5X, 6X, 7X, 8X; BeiDou 7I, 6I
CA-CD      version 2.12                        1C, 1X, 2X, GLONASS 2C
=========  ==================================  =================================

Phase, Doppler and strength of band 1 go with C1 where the file has C1, else with P1; those of band 2 with P2 where the
file has it, else with C2. They may come from the other tracking loop of the band: the wavelength is the same.
"""

from __future__ import annotations

from dataclasses import dataclass

from schuler.gnss.signals import SYSTEMS
from schuler.recording.formats.rinex_header import RinexFile

KINDS = "CLDS"
_OLD_ATTRIBUTES = {
    ("E", "1"): "1X", ("C", "1"): "2I", ("C", "2"): "2I", ("C", "7"): "7I", ("C", "6"): "6I",
    ("G", "1"): "1C", ("R", "1"): "1C", ("J", "1"): "1C", ("S", "1"): "1C",
    ("G", "2"): "2X", ("R", "2"): "2C", ("J", "2"): "2X",
}  # fmt: skip
_OLD_PRECISE = {("G", "1"): "1W", ("G", "2"): "2W", ("R", "1"): "1P", ("R", "2"): "2P"}
_OLD_CIVIL = {"A": "1C", "B": "1X", "C": "2X", "D": "2C"}


@dataclass(frozen=True, slots=True)
class SystemTypes:
    """What the satellites of one system are observed by.

    Attributes
    ----------
    codes : tuple of str
        Types in the order of the file.
    columns : dict of str to dict of str to int
        For each signal, the places of its kinds (``C``, ``L``, ``D``, ``S``).
    """

    codes: tuple[str, ...]
    columns: dict[str, dict[str, int]]


def types_of(file: RinexFile) -> dict[str, SystemTypes]:
    """Observation types by the letter of the system.

    Raises
    ------
    FileFormatError
        If the header does not list them, or does so in a way that cannot be read.
    """
    if file.version < 3.0:
        codes = _old_types(file)
        return {system: _in_signals(codes, [_old_signal(c, system, codes) for c in codes]) for system in SYSTEMS}
    found = {}
    for system, codes in _new_types(file).items():
        if system not in SYSTEMS:
            continue
        named = [_new_signal(c, system, file.version) for c in codes]
        if named != [(c[0], c[1:]) for c in codes] and system == "C":
            file.notes.append("BeiDou's B1 is called 1I in version 3.02 and was taken as 2I, as in all others.")
        found[system] = _in_signals(codes, named)
    return found


def _in_signals(codes: list[str], named: list[tuple[str, str]]) -> SystemTypes:
    columns: dict[str, dict[str, int]] = {}
    for place, (kind, signal) in enumerate(named):
        if kind in KINDS and signal:
            columns.setdefault(signal, {}).setdefault(kind, place)
    return SystemTypes(tuple(codes), columns)


def _new_types(file: RinexFile) -> dict[str, list[str]]:
    label = "SYS / # / OBS TYPES"
    found: dict[str, list[str]] = {}
    counts: dict[str, int] = {}
    system = ""
    for text in file.header.get(label, []):
        if text[0] != " ":
            system = text[0].upper()
            if system in found or not text[3:6].strip().isdecimal():
                raise file.fault(f"{label}: expected one list with a count for each system, got {text.strip()!r}")
            counts[system], found[system] = int(text[3:6]), []
        if not system:
            raise file.fault(f"{label}: expected the letter of a system, got {text.strip()!r}")
        found[system] += text[6:60].split()
    for system, codes in found.items():
        if len(codes) != counts[system] or any(len(c) != 3 for c in codes):
            raise file.fault(
                f"{label}: expected {counts[system]} types such as C1C of system {system}, got {' '.join(codes)}"
            )
    if not found:
        raise file.fault(f"the header has no {label!r}: is it a file of observations?")
    return found


def _new_signal(code: str, system: str, version: float) -> tuple[str, str]:
    if system == "C" and round(version, 2) == 3.02 and code[1] == "1" and code[2] in "IQX":
        return code[0], "2" + code[2]
    return code[0], code[1:]


def _old_types(file: RinexFile) -> list[str]:
    label = "# / TYPES OF OBSERV"
    texts = file.header.get(label, [])
    if not texts or not texts[0][:6].strip().isdecimal():
        raise file.fault(f"the header has no {label!r} with their number: is it a file of observations?")
    count = int(texts[0][:6])
    codes = [code for text in texts for code in text[6:60].split()]
    if len(codes) != count or any(len(c) != 2 for c in codes):
        raise file.fault(f"{label}: expected {count} types such as C1, got {' '.join(codes)}")
    return [c.upper() for c in codes]


def _old_signal(code: str, system: str, codes: list[str]) -> tuple[str, str]:
    """Kind and signal of a RINEX 2 type, ``""`` for a signal the system does not have."""
    kind, band = code[0], code[1]
    if band in _OLD_CIVIL:
        signal = _OLD_CIVIL[band]
        return (kind, signal) if (system, signal[0]) in _OLD_ATTRIBUTES or system == "E" else (kind, "")
    if kind == "P":
        return "C", _OLD_PRECISE.get((system, band), "")
    civil = _OLD_ATTRIBUTES.get((system, band), f"{band}X" if band in "5678" else "")
    precise = _OLD_PRECISE.get((system, band))
    if kind == "C" or precise is None:
        return kind, civil
    prefers_precise = band == "2" or f"C{band}" not in codes
    return kind, precise if prefers_precise and f"P{band}" in codes else civil
