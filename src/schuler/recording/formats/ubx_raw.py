"""Raw measurements of u-blox receivers: UBX-RXM-RAWX to observations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.gnss.observations import Observations
from schuler.gnss.signals import SYSTEM_NAMES, wavelengths
from schuler.recording.formats.ubx_signals import SIGNAL_OF_SIG_ID, SYSTEM_OF_GNSS_ID, satellite_of
from schuler.timebase import WEEK_S

_NAMES = (
    "prMes", "cpMes", "doMes", "gnssId", "svId", "sigId", "freqId", "cno", "prStd", "doStd", "prValid", "cpValid",
    "halfCyc",
)  # fmt: skip
_GLONASS = 6


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
        # before it knows the time a receiver says week 0
        if n == 0 or m["week"] == 0 or not np.isfinite(gps_s):
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
        here = signal == k
        cycle[here] = wavelengths(sat[here], name, channels)
    pseudorange = np.where(table["prValid"] == 1, table["prMes"], np.nan)
    carrier = np.where(table["cpValid"] == 1, table["cpMes"], np.nan)
    observations = Observations(
        t[keep], sat[keep], signal[keep], signals, pseudorange[keep], (-table["doMes"] * cycle)[keep],
        carrier[keep], table["cno"][keep], start, channels,
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
