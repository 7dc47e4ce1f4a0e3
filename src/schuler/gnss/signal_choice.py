"""One measurement a satellite and epoch, out of the several signals a receiver tracks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.gnss.observations import Observations
from schuler.gnss.ranges import Ranges
from schuler.gnss.signals import BANDS, GLONASS_BANDS, SPEED_OF_LIGHT, SYSTEM_NAMES, SYSTEMS, frequency_hz

#: Signals by system in order of preference, as RINEX 3 has them.
SIGNALS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "G": ("1C", "1L", "1X", "1S", "1P", "1W", "2W", "2P", "2L", "2X", "2S", "2C", "5Q", "5X", "5I"),
        "R": ("1C", "1P", "2C", "2P"),
        "E": ("1C", "1X", "1B", "1Z", "1A", "5Q", "5X", "5I", "7Q", "7X", "7I", "8Q", "8X", "8I"),
        "C": ("2I", "2X", "2Q", "1P", "1X", "1D", "6I", "6X", "6Q", "7I", "7X", "7D", "7P", "5P", "5X", "5D"),
        "J": ("1C", "1L", "1X", "1S", "1Z", "2L", "2X", "2S", "5Q", "5X", "5I"),
        "I": ("5A", "5X", "5B", "5C", "9A", "9X", "9B", "9C"),
        "S": ("1C", "5I", "5X", "5Q"),
    }
)
#: Pairs of bands whose ionosphere-free combination is formed, the first listed where equally often measured.
PAIRS: Mapping[str, tuple[tuple[str, str], ...]] = MappingProxyType(
    {
        "G": (("1", "2"), ("1", "5")),
        "R": (("1", "2"),),
        "E": (("1", "5"), ("1", "7"), ("1", "8")),
        "C": (("2", "6"), ("2", "7"), ("1", "6"), ("1", "5")),
        "J": (("1", "2"), ("1", "5")),
        "I": (("9", "5"),),
    }
)


@dataclass(frozen=True)
class ChosenSignals:
    """One row for each satellite and epoch, in order of time.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Times of the observations. [s]
    sat : ndarray of int, shape (n,)
    pseudorange : ndarray, shape (n, 2)
        Pseudorange on the first band and, for a combination, the second one; NaN where not measured. [m]
    bands : ndarray of int, shape (n, 2)
        RINEX bands; the second is 0 where one signal is used.
    frequency_hz : ndarray, shape (n, 2)
        NaN where the band is 0; a GLONASS satellite of unknown channel counts as channel 0. [Hz]
    range_rate, cn0 : ndarray, shape (n,)
        Values of the most preferred signal that has one, on any band: Doppler shifts need no common delay.
        [m/s], [dB-Hz]
    carrier : ndarray, shape (n,)
        Carrier phase of the signal whose pseudorange is on the first band; NaN where not measured. [cycles]
    signal, lock : ndarray of int, shape (n,)
        Which signal that is, and its loss of lock indicator, as in the observations; -1, 0 where there is none.
    second : ndarray of int, shape (n,)
        Which signal the pseudorange on the second band is; -1 where there is none.
    notes : tuple of str
    """

    t: FloatArray
    sat: IntArray
    pseudorange: FloatArray
    bands: IntArray
    frequency_hz: FloatArray
    range_rate: FloatArray
    cn0: FloatArray
    carrier: FloatArray
    signal: IntArray
    lock: IntArray
    second: IntArray
    notes: tuple[str, ...]


def choose_signals(
    observations: Observations,
    *,
    signals: Mapping[str, tuple[str, ...]] | None = None,
    pairs: bool = False,
    systems: str = SYSTEMS,
    glonass_channels: Mapping[int, int] | None = None,
) -> ChosenSignals:
    """Bring observations down to one row for each satellite and epoch.

    Parameters
    ----------
    observations : Observations
    signals : mapping of str to tuple of str, optional
        Signals by system in order of preference, instead of those in :data:`SIGNALS`.
    pairs : bool
        Take a pair of bands of each system for ionosphere-free combinations.
    systems : str
        Letters of systems whose pseudoranges are wanted; satellites of others get none.
    glonass_channels : mapping of int to int, optional
        FDMA channels by satellite, besides those in the observations.

    Raises
    ------
    InputError
        For an unknown system or a signal in a band that the system does not have.

    Notes
    -----
    A system is used in **one band** (or pair) throughout: a receiver delays its bands by different times, metres apart,
    and its clock takes up one. It is the first band in the list that has at least half as many pseudoranges as the
    richest one; within it the signals are taken in order, row by row.
    """
    o = observations
    preferred = {**SIGNALS, **_checked(signals or {})}
    key = np.stack((np.unique(o.t, return_inverse=True)[1].astype(np.int64), o.sat), axis=1)
    pair, row = np.unique(key, axis=0, return_inverse=True)
    row = np.asarray(row).reshape(-1)
    n = len(pair)
    first_seen = np.full(n, len(o), dtype=np.int64)
    np.minimum.at(first_seen, row, np.arange(len(o)))
    t, sat = o.t[first_seen], pair[:, 1]
    pseudorange, frequency = np.full((n, 2), np.nan), np.full((n, 2), np.nan)
    bands = np.zeros((n, 2), dtype=np.int64)
    range_rate, cn0, carrier = (np.full(n, np.nan) for _ in range(3))
    (signal, second), lock = np.full((2, n), -1), np.zeros(n, dtype=np.int64)
    channels = {**(glonass_channels or {}), **o.glonass_channels}
    notes: list[str] = []
    for s in np.unique(sat // 100):
        letter = SYSTEMS[s]
        mine = np.flatnonzero(o.sat // 100 == s)
        tracked = {o.signals[i] for i in np.unique(o.signal[mine])}
        order = [x for x in preferred[letter] if x in tracked]
        # backwards, so that the most preferred is written last
        for name in order[::-1]:
            m = mine[o.signal[mine] == o.signals.index(name)]
            m = m[np.isfinite(o.range_rate[m])]
            range_rate[row[m]], cn0[row[m]] = o.range_rate[m], o.cn0[m]
        if letter not in systems:
            continue
        chosen = _pair(o, mine, row, letter, order) if pairs else _band(o, mine, order)
        if not chosen:
            what = "pair of bands" if pairs else "signal"
            notes.append(f"{SYSTEM_NAMES[letter]}: no pseudorange of any preferred {what} is in the observations")
        for place, band in enumerate(chosen):
            names = [x for x in order if x[0] == band]
            for name in names[::-1]:
                m = mine[(o.signal[mine] == o.signals.index(name)) & np.isfinite(o.pseudorange[mine])]
                pseudorange[row[m], place] = o.pseudorange[m]
                if place == 0:
                    cn0[row[m]] = o.cn0[m]
                    carrier[row[m]], signal[row[m]], lock[row[m]] = o.carrier[m], o.signal[m], o.lock[m]
                else:
                    second[row[m]] = o.signal[m]
            k = sat // 100 == s
            bands[k, place] = int(band)
            for one in np.unique(sat[k]):
                frequency[sat == one, place] = frequency_hz(int(one), band, channels.get(int(one), 0))
        if chosen:
            notes.append(f"{SYSTEM_NAMES[letter]}: signals {' and '.join(_names(order, chosen))}")
    return ChosenSignals(
        t, sat, pseudorange, bands, frequency, range_rate, cn0, carrier, signal, lock, second, tuple(notes)
    )


def bands_apart(
    observations: Observations, chosen: ChosenSignals, carrier: FloatArray, glonass_channels: Mapping[int, int]
) -> FloatArray:
    """Carriers less those of another band, the one that each satellite has most of. Shape (n,). [m]

    Parameters
    ----------
    observations : Observations
    chosen : ChosenSignals
        Of these observations.
    carrier : ndarray, shape (n,)
        Of the chosen signals. [m]
    glonass_channels : mapping of int to int
        FDMA channels by satellite.

    Returns
    -------
    ndarray, shape (n,)
        NaN where there is no other, or its receiver states that lock was lost or half a cycle is in doubt.
    """
    o, out = observations, np.full(len(chosen.t), np.nan)
    if not len(out) or not len(o):
        return out
    epochs = np.unique(o.t)
    key, own = (np.searchsorted(epochs, x.t) * 100_000 + x.sat for x in (o, chosen))
    order = np.argsort(own, kind="stable")
    row = order[np.minimum(np.searchsorted(own[order], key), len(own) - 1)]
    band = np.array([int(name[0]) for name in o.signals])[o.signal]
    good = (own[row] == key) & np.isfinite(o.carrier) & (o.lock == 0) & (band != chosen.bands[row, 0])
    good &= np.isfinite(carrier[row])  # of systems asked for, whose bands are those they have
    sats, place = np.unique(o.sat, return_inverse=True)
    count = np.bincount(place * len(o.signals) + o.signal, good, len(sats) * len(o.signals))
    good &= o.signal == count.reshape(len(sats), -1).argmax(axis=1)[place]
    frequency = {
        (int(s), int(b)): frequency_hz(int(s), str(b), glonass_channels.get(int(s), 0))
        for s, b in np.unique(np.stack((o.sat[good], band[good]), axis=1), axis=0)
    }
    k = np.flatnonzero(good)
    f = np.array([frequency[pair] for pair in zip(o.sat[k].tolist(), band[k].tolist(), strict=True)])
    out[row[k]] = carrier[row[k]] - SPEED_OF_LIGHT * o.carrier[k] / f
    return out


def second_band(ranges: Ranges, receivers: tuple[Observations, ...], systems: str) -> dict[str, tuple[str, ...]]:
    """Signals by system on a band beside that of the ranges, on which all receivers have carriers.

    Parameters
    ----------
    ranges : Ranges
        Their wavelengths say which band they are of.
    receivers : tuple of Observations
    systems : str
        Letters; GLONASS, whose satellites differ in frequency, has none.
    """
    chosen: dict[str, tuple[str, ...]] = {}
    for letter in (x for x in systems if x != "R" and x in SIGNALS):
        mine = np.isfinite(ranges.wavelength) & (ranges.sat // 100 == SYSTEMS.index(letter))
        if not mine.any():
            continue
        own = SPEED_OF_LIGHT / float(np.median(ranges.wavelength[mine]))
        counts: dict[str, int] = {}
        for band in dict.fromkeys(name[0] for name in SIGNALS[letter]):
            if abs(BANDS[(letter, band)] - own) > 1.0:
                counts[band] = min(_carriers(o, letter, band) for o in receivers)
        best = max(counts, key=lambda band: counts[band], default="")
        if counts.get(best, 0):
            chosen[letter] = tuple(name for name in SIGNALS[letter] if name[0] == best)
    return chosen


def _carriers(o: Observations, letter: str, band: str) -> int:
    places = [k for k, name in enumerate(o.signals) if name[0] == band]
    mine = (o.sat // 100 == SYSTEMS.index(letter)) & np.isin(o.signal, places)
    return int(np.count_nonzero(mine & np.isfinite(o.carrier) & np.isfinite(o.pseudorange)))


def _names(order: list[str], bands: tuple[str, ...]) -> list[str]:
    return ["/".join(x for x in order if x[0] == band) for band in bands]


def _band(o: Observations, mine: IntArray, order: list[str]) -> tuple[str, ...]:
    counts: dict[str, int] = {}
    for name in order:
        measured = (o.signal[mine] == o.signals.index(name)) & np.isfinite(o.pseudorange[mine])
        counts[name[0]] = max(counts.get(name[0], 0), int(np.count_nonzero(measured)))
    richest = max(counts.values(), default=0)
    return next(((band,) for band, count in counts.items() if count > 0 and 2 * count >= richest), ())


def _pair(o: Observations, mine: IntArray, row: IntArray, letter: str, order: list[str]) -> tuple[str, ...]:
    rows = {}
    for band in {name[0] for name in order}:
        places = [o.signals.index(name) for name in order if name[0] == band]
        rows[band] = np.unique(row[mine[np.isin(o.signal[mine], places) & np.isfinite(o.pseudorange[mine])]])
    best: tuple[str, ...] = ()
    most = 0
    for a, b in PAIRS.get(letter, ()):
        if a in rows and b in rows:
            both = len(np.intersect1d(rows[a], rows[b], assume_unique=True))
            if both > most:
                best, most = (a, b), both
    return best


def _checked(signals: Mapping[str, tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
    for letter, names in signals.items():
        if letter not in SIGNALS:
            raise InputError(f"signals: expected systems by their letters {''.join(SIGNALS)}, got {letter!r}")
        if not names or not isinstance(names, tuple | list):
            raise InputError(f'signals of {letter}: expected a list such as ("1C", "1X"), got {names!r}')
        for name in names:
            exists = (letter, name[:1]) in BANDS or (letter == "R" and name[:1] in GLONASS_BANDS)
            if len(name) != 2 or not exists:
                raise InputError(
                    f"signals of {letter}: expected a band of {SYSTEM_NAMES[letter]} and an attribute such as 1C, "
                    f"got {name!r}"
                )
    return {letter: tuple(names) for letter, names in signals.items()}
