"""Navigation messages of u-blox receivers: UBX-RXM-SFRBX to broadcast ephemerides."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any

import numpy as np

from schuler.gnss.ephemerides import Ephemerides, no_glonass, no_kepler
from schuler.gnss.messages_beidou import ephemerides_of_d1
from schuler.gnss.messages_galileo import ephemerides_of_inav
from schuler.gnss.messages_glonass import ephemerides_of_strings
from schuler.gnss.messages_gps import ephemerides_of_lnav
from schuler.gnss.signals import SYSTEM_NAMES
from schuler.recording.formats.ubx_signals import SIGNAL_OF_SIG_ID, SYSTEM_OF_GNSS_ID, satellite_of

_GEOSTATIONARY = (*range(1, 6), *range(59, 64))  # BeiDou satellites that send D2


def broadcast(messages: Iterable[tuple[dict[str, Any], float]]) -> Ephemerides:
    """Ephemerides of decoded RXM-SFRBX messages.

    Parameters
    ----------
    messages : iterable of (dict, float)
        Fields of each message by pyubx2's names, and GPS time of reception to within some days. [s]

    Returns
    -------
    Ephemerides
        Of GPS and QZSS LNAV, Galileo I/NAV, BeiDou D1 and GLONASS; messages of other kinds are counted in the notes.
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
    found = Ephemerides(no_kepler(), no_glonass())
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
        found = found.merged_with(part)
    if others:
        listed = ", ".join(f"{name} ({count})" for name, count in sorted(others.items()))
        note = f"Navigation messages of kinds that are not decoded: {listed}."
        found = found.merged_with(Ephemerides(no_kepler(), no_glonass(), notes=(note,)))
    return found


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
