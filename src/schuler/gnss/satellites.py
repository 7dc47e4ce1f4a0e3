"""States of satellites: choice of the message, orbit, clock, time of transmission, group delays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.gnss.antennas import satellite_offsets
from schuler.gnss.ephemerides import B2B_SOURCE, NEWER_SOURCE, Ephemerides, KeplerRecords
from schuler.gnss.orbits import glonass_states, kepler_states
from schuler.gnss.precise import PreciseOrbits, precise_clocks, precise_positions, relativistic_clock
from schuler.gnss.signals import BANDS, SPEED_OF_LIGHT, SYSTEMS
from schuler.plotting.notebook import Abridged
from schuler.units import HR, MIN

#: How far from its reference time a message may be used. [s]
MAX_AGE_S: Mapping[str, float] = MappingProxyType(
    {"G": 2.0 * HR, "J": 2.0 * HR, "I": 2.0 * HR, "E": 4.0 * HR, "C": 1.0 * HR, "R": 30.0 * MIN}
)
_SENT_BEFORE_TOE_S = MappingProxyType({"G": 2.0 * HR, "J": 1.0 * HR, "I": 1.0 * HR})  # where the file does not say
_SLACK_S = 1.0  # a time of transmission lies 0.1 s before the round hour of its reception
_LAST_OF_B2I = 16  # number of the last satellite of BeiDou's second generation
_E, _R, _C = (SYSTEMS.index(letter) for letter in "ERC")
#: 1-sigma of a delay that is not broadcast (differential code biases of satellites scatter by some ns). [m]
UNKNOWN_DELAY = 1.0


@dataclass(frozen=True, repr=False)
class SatelliteStates(Abridged):
    """One row for each satellite and time asked for.

    Attributes
    ----------
    r_e, v_e : ndarray, shape (n, 3)
        Earth-fixed position and velocity of the satellite's antenna. NaN where not ``found``. [m], [m/s]
    clock : ndarray, shape (n,)
        Satellite clock minus system time: polynomial and relativity, no group delay. NaN where not ``found``. [s]
    clock_rate : ndarray, shape (n,)
        Its derivative. [1]
    group_delay : ndarray, shape (n, 2)
        Group delay of the message, see :class:`schuler.gnss.ephemerides.KeplerRecords`; NaN for GLONASS. [s]
    f_nav : ndarray of bool, shape (n,)
        Galileo: the clock is that of E5a/E1 (F/NAV), else of E5b/E1 (I/NAV).
    newer : ndarray of bool, shape (n,)
        The message is one of the modernised signals: CNAV, CNAV-2, B-CNAV1, B-CNAV2.
    b2b : ndarray of bool, shape (n,)
        The message is BeiDou's of B2b, B-CNAV3.
    accuracy : ndarray, shape (n,)
        As broadcast; NaN where unknown. [m]
    healthy : ndarray of bool, shape (n,)
    has_message : ndarray of bool, shape (n,)
        A message within its validity was there; with precise orbits, a position and a clock.
    age : ndarray, shape (n,)
        Time asked for minus the reference time of the orbit. [s]
    record : ndarray of int, shape (n,)
        Row of the message in its ``KeplerRecords`` or ``GlonassRecords``; -1 where not ``found``.
    """

    r_e: FloatArray
    v_e: FloatArray
    clock: FloatArray
    clock_rate: FloatArray
    group_delay: FloatArray
    f_nav: BoolArray
    newer: BoolArray
    b2b: BoolArray
    accuracy: FloatArray
    healthy: BoolArray
    has_message: BoolArray
    age: FloatArray
    record: IntArray


def is_f_nav(records: KeplerRecords) -> BoolArray:
    """Whether a Galileo message's clock is that of E5a/E1. Shape (n,).

    Bits 8 and 9 of the data source decide, then the message bits; without any, I/NAV is assumed. A file that sets all
    message bits and the clock bit of E5a/E1 (simulators do) counts as F/NAV.
    """
    source = records.source
    clock_a, clock_b = (source & 0x100) > 0, (source & 0x200) > 0
    only_f = ((source & 0b010) > 0) & ((source & 0b101) == 0)
    return np.asarray((records.sat // 100 == _E) & np.where(clock_a != clock_b, clock_a, only_f))


def is_newer(records: KeplerRecords) -> BoolArray:
    """Whether a message is one of the modernised signals (CNAV, CNAV-2, B-CNAV1, B-CNAV2). Shape (n,)."""
    return np.asarray((records.source & NEWER_SOURCE) > 0)


def is_b2b(records: KeplerRecords) -> BoolArray:
    """Whether a message is BeiDou's of B2b, B-CNAV3. Shape (n,)."""
    return np.asarray((records.source & B2B_SOURCE) > 0)


def choose_messages(
    ephemerides: Ephemerides,
    sat: ArrayLike,
    t: ArrayLike,
    *,
    epoch_gps_s: float = 0.0,
    f_nav: ArrayLike = False,
    b2b: ArrayLike = False,
    causal: bool = False,
    max_age_s: Mapping[str, float] | None = None,
) -> IntArray:
    """Message to use for each satellite and time: the one with the nearest reference time.

    Parameters
    ----------
    ephemerides : Ephemerides
    sat : array_like of int, shape (n,)
    t : array_like, shape (n,)
        Times. [s]
    epoch_gps_s : float
        GPS time of ``t = 0``. [s]
    f_nav : array_like of bool, shape () or (n,)
        For Galileo: prefer F/NAV (E5a/E1 clock) to I/NAV (E5b/E1). For GPS, QZSS and BeiDou: prefer messages of the
        modernised signals. Where the preferred kind is not there, the other is taken.
    b2b : array_like of bool, shape () or (n,)
        For BeiDou: prefer B-CNAV3, which has B2b's group delay and none but that. Nowhere else it is used.
    causal : bool
        Do not use messages before they were sent. If a file does not say when, the beginning of the usual interval is
        assumed: GPS 2 h, QZSS and NavIC 1 h before the reference time, the others at the reference time.
    max_age_s : mapping of str to float, optional
        Limits on the distance from the reference time by system, instead of :data:`MAX_AGE_S`. [s]

    Returns
    -------
    ndarray of int, shape (n,)
        Row in ``ephemerides.kepler``, or ``ephemerides.glonass`` for GLONASS; -1 if there is none.

    Notes
    -----
    Health does not enter: if the nearest message says "unhealthy", an older healthy one must not be used in its stead.
    Of messages with one reference time the one sent last counts.
    """
    sat = np.asarray(sat, dtype=np.int64)
    t = np.asarray(t, dtype=np.float64)
    if sat.ndim != 1 or t.shape != sat.shape:
        raise InputError(f"expected satellites and times of one shape (n,), got {sat.shape} and {t.shape}")
    limits = {**MAX_AGE_S, **(max_age_s or {})}
    prefer_f_nav = np.broadcast_to(np.asarray(f_nav, dtype=bool), sat.shape)
    preferred = np.where(np.broadcast_to(np.asarray(b2b, dtype=bool), sat.shape), 2, prefer_f_nav.astype(np.int64))
    kind_of_record = np.where(
        is_b2b(ephemerides.kepler), 2, (is_f_nav(ephemerides.kepler) | is_newer(ephemerides.kepler)).astype(np.int64)
    )
    chosen = np.full(sat.shape, -1, dtype=np.int64)
    for one in np.unique(sat):
        letter = SYSTEMS[one // 100]
        records = ephemerides.glonass if letter == "R" else ephemerides.kepler
        rows = np.flatnonzero(records.sat == one)
        at = np.flatnonzero(sat == one)
        sent = records.sent[rows]
        sent = np.where(np.isnan(sent), records.toe[rows] - _SENT_BEFORE_TOE_S.get(letter, 0.0), sent)
        kinds = [(rows >= 0, at)]
        if letter in "GEJC":
            kind, wanted = kind_of_record[rows], preferred[at]
            # the preferred kind, or else the others
            orders = ((0, (0, 1)), (1, (1, 0)), (2, (2, 0, 1)))
            kinds = [(kind == k, at[wanted == first]) for first, order in orders for k in order]
        for mine, places in kinds:
            places = places[chosen[places] < 0]
            if len(places) and mine.any():
                nearest = _nearest(
                    records.toe[rows[mine]] - epoch_gps_s, sent[mine] - epoch_gps_s, t[places], limits[letter], causal
                )
                chosen[places] = np.where(nearest >= 0, rows[mine][nearest], -1)
    return chosen


def satellite_states(
    ephemerides: Ephemerides,
    sat: ArrayLike,
    t: ArrayLike,
    *,
    epoch_gps_s: float = 0.0,
    f_nav: ArrayLike = False,
    b2b: ArrayLike = False,
    causal: bool = False,
    max_age_s: Mapping[str, float] | None = None,
) -> SatelliteStates:
    """Positions, velocities and clocks of satellites at times of transmission.

    Parameters
    ----------
    ephemerides, sat, t, epoch_gps_s, f_nav, b2b, causal, max_age_s
        See :func:`choose_messages`.

    Notes
    -----
    Clock: ``af0 + af1 d + af2 d^2`` with ``d = t - toc``, plus the relativistic term of
    :func:`schuler.gnss.orbits.kepler_states`; GLONASS broadcasts its clock with relativity included.

    References
    ----------
    IS-GPS-200, 20.3.3.3.3.1; Galileo OS SIS ICD, 5.1.4; BeiDou B1I ICD, 5.2.4.10; GLONASS ICD, 3.3.3.
    """
    sat = np.asarray(sat, dtype=np.int64)
    t = np.asarray(t, dtype=np.float64)
    record = choose_messages(
        ephemerides, sat, t, epoch_gps_s=epoch_gps_s, f_nav=f_nav, b2b=b2b, causal=causal, max_age_s=max_age_s
    )
    return states_of_messages(ephemerides, sat, t, record, epoch_gps_s=epoch_gps_s)


def states_of_messages(
    ephemerides: Ephemerides, sat: IntArray, t: FloatArray, record: IntArray, *, epoch_gps_s: float = 0.0
) -> SatelliteStates:
    """The same with the message of each row given, as :func:`choose_messages` returns it."""
    n = len(sat)
    has_message, glonass = record >= 0, sat // 100 == _R
    r_e, v_e = np.full((n, 3), np.nan), np.full((n, 3), np.nan)
    clock, clock_rate, age, accuracy = (np.full(n, np.nan) for _ in range(4))
    group_delay = np.full((n, 2), np.nan)
    healthy, f, newer, b2b = (np.zeros(n, dtype=bool) for _ in range(4))

    m = np.flatnonzero(has_message & ~glonass)
    k, row = ephemerides.kepler, record[m]
    orbit = kepler_states(k, row, t[m], epoch_gps_s=epoch_gps_s)
    r_e[m], v_e[m] = orbit.r_e, orbit.v_e
    polynomial, rate = _kepler_clock(k, row, t[m], epoch_gps_s)
    clock[m], clock_rate[m] = polynomial + orbit.clock, rate + orbit.clock_rate
    group_delay[m], accuracy[m], healthy[m] = k.group_delay[row], k.accuracy[row], k.health[row] == 0
    age[m], f[m], newer[m] = t[m] - (k.toe[row] - epoch_gps_s), is_f_nav(k)[row], is_newer(k)[row]
    b2b[m] = is_b2b(k)[row]

    m = np.flatnonzero(has_message & glonass)
    g, row = ephemerides.glonass, record[m]
    r_e[m], v_e[m] = glonass_states(g, row, t[m], epoch_gps_s=epoch_gps_s)
    age[m] = t[m] - (g.toe[row] - epoch_gps_s)
    clock[m], clock_rate[m], healthy[m] = g.clock[row] + g.rate[row] * age[m], g.rate[row], g.health[row] == 0
    states = SatelliteStates(
        r_e, v_e, clock, clock_rate, group_delay, f, newer, b2b, accuracy, healthy, has_message, age, record
    )
    if ephemerides.precise_orbits is None:
        return states
    return _with_precise(states, ephemerides, ephemerides.precise_orbits, sat, t, epoch_gps_s)


def _with_precise(
    states: SatelliteStates,
    ephemerides: Ephemerides,
    orbits: PreciseOrbits,
    sat: IntArray,
    t: FloatArray,
    epoch_gps_s: float,
) -> SatelliteStates:
    """Precise orbits and clocks in place of broadcast ones, with the messages' health and group delays.

    Precise clocks are those of L1/L2, E1/E5a and B1I/B3I without ionosphere. The first two are what GPS and Galileo's
    F/NAV broadcast; BeiDou's is brought to that of B3I, which it broadcasts.
    """
    r_e, v_e = precise_positions(orbits, sat, t, epoch_gps_s=epoch_gps_s)
    clock, rate = precise_clocks(orbits, ephemerides.precise_clocks, sat, t, epoch_gps_s=epoch_gps_s)
    periodic, periodic_rate = relativistic_clock(r_e, v_e)
    if ephemerides.antennas:
        r_e = r_e + satellite_offsets(ephemerides.antennas, sat, epoch_gps_s + t, r_e)
    there = np.isfinite(r_e[:, 0]) & np.isfinite(clock)
    clock = clock + periodic + clock_to_b3i(states, sat)
    column = np.clip(np.searchsorted(orbits.sat, sat), 0, len(orbits.sat) - 1)
    own = orbits.sat[column] == sat
    return replace(
        states, r_e=np.where(there[:, None], r_e, np.nan), v_e=np.where(there[:, None], v_e, np.nan),
        clock=np.where(there, clock, np.nan), clock_rate=np.where(there, rate + periodic_rate, np.nan),
        f_nav=sat // 100 == _E, accuracy=np.where(own, orbits.accuracy[column], np.nan),
        healthy=there & (states.healthy | ~states.has_message), has_message=there, age=np.where(there, 0.0, np.nan),
    )  # fmt: skip


def transmission_times(
    ephemerides: Ephemerides,
    sat: IntArray,
    t_received: FloatArray,
    pseudorange: FloatArray,
    record: IntArray,
    *,
    epoch_gps_s: float = 0.0,
) -> FloatArray:
    """When a signal left its satellite, by system time: ``t_received - pseudorange / c - satellite clock``.

    Parameters
    ----------
    ephemerides : Ephemerides
    sat : ndarray of int, shape (n,)
    t_received : ndarray, shape (n,)
        By the receiver's clock; its error drops out, being in the pseudorange too. [s]
    pseudorange : ndarray, shape (n,)
        [m]
    record : ndarray of int, shape (n,)
        Messages, see :func:`choose_messages`; rows with -1 return NaN.
    epoch_gps_s : float
        GPS time of ``t = 0``. [s]

    Returns
    -------
    ndarray, shape (n,)
        [s]

    Notes
    -----
    The clock is taken at the time the satellite's clock showed, which changes it by less than 1e-13 s, and without the
    relativistic term and group delays: 50 ns along the line of sight are 0.05 mm.
    """
    shown = t_received - pseudorange / SPEED_OF_LIGHT
    m, g = (record >= 0) & (sat // 100 != _R), (record >= 0) & (sat // 100 == _R)
    if ephemerides.precise_orbits is not None:
        orbits, clocks = ephemerides.precise_orbits, ephemerides.precise_clocks
        return shown - precise_clocks(orbits, clocks, sat, shown, epoch_gps_s=epoch_gps_s)[0]
    clock = np.full(len(sat), np.nan)
    clock[m] = _kepler_clock(ephemerides.kepler, record[m], shown[m], epoch_gps_s)[0]
    r = ephemerides.glonass
    clock[g] = r.clock[record[g]] + r.rate[record[g]] * (shown[g] - (r.toe[record[g]] - epoch_gps_s))
    return np.asarray(shown - clock)


def _kepler_clock(k: KeplerRecords, row: IntArray, t: FloatArray, epoch_gps_s: float) -> tuple[FloatArray, FloatArray]:
    d = t - (k.toc[row] - epoch_gps_s)
    return k.af0[row] + d * (k.af1[row] + d * k.af2[row]), k.af1[row] + 2.0 * k.af2[row] * d


def _nearest(toe: FloatArray, sent: FloatArray, t: FloatArray, limit: float, causal: bool) -> IntArray:
    """Place of the nearest ``toe`` within the limit, -1 if none; equal ones: the last sent."""
    nearest = np.full(t.shape, -1, dtype=np.int64)
    broadcasts = np.unique(sent) if causal else np.array([-np.inf])
    part = np.searchsorted(broadcasts, t, side="right") - 1  # how many broadcasts there had been
    for j in np.unique(part[part >= 0]):
        usable = np.flatnonzero(sent <= broadcasts[j]) if causal else np.arange(len(toe))
        order = usable[np.lexsort((sent[usable], toe[usable]))]
        order = order[np.append(toe[order][1:] > toe[order][:-1], True)]
        now = np.flatnonzero(part == j)
        best = order[np.searchsorted(0.5 * (toe[order][1:] + toe[order][:-1]), t[now])]
        nearest[now] = np.where(np.abs(t[now] - toe[best]) <= limit + _SLACK_S, best, -1)
    return nearest


def group_delays(states: SatelliteStates, sat: IntArray, bands: IntArray) -> tuple[FloatArray, BoolArray]:
    """Group delay of each signal relative to the broadcast clock.

    Parameters
    ----------
    states : SatelliteStates, n rows
    sat : ndarray of int, shape (n,)
    bands : ndarray of int, shape (n,)
        RINEX band, 1 to 9, of each row.

    Returns
    -------
    delay : ndarray, shape (n,)
        The satellite's clock for this signal is ``clock - delay``. [s]
    known : ndarray of bool, shape (n,)
        False where the message does not broadcast it: the delay of a neighbour is used, or zero; add
        :data:`UNKNOWN_DELAY` to the budget.

    Notes
    -----
    The table is in docs/gnss-models.md. With ``gamma = (f_1/f_2)^2``: GPS and QZSS L1 TGD, L2 gamma TGD (clock of the
    L1/L2 combination). Galileo E1 BGD, E5 gamma BGD of the message's own pair; the second pair of an I/NAV message is
    reached through E1. BeiDou's clock is that of B3I: B1I TGD1, B2I TGD2, B3I none. Newer messages broadcast L5 (GPS,
    QZSS), B1C and B2a, or B2b (BeiDou, whose B1I they do not have). Satellites of BeiDou from C17 on have B2b in B2I's
    place, and their D1 messages broadcast TGD1 once more as TGD2. GLONASS: none broadcast here.

    References
    ----------
    IS-GPS-200, 20.3.3.3.3.2 and 30.3.3.3.1.1; IS-GPS-705, 20.3.3.3.1.2; Galileo OS SIS ICD, 5.1.5; BeiDou B1I ICD,
    5.2.4.9, B1C ICD, 7.6; NavIC SIS ICD, 6.2.1.6.
    """
    delay, available = np.zeros(len(sat)), np.zeros(len(sat), dtype=bool)
    system = sat // 100
    first, second = states.group_delay.T

    def put(letter: str, band: int, value: FloatArray, broadcast: bool | BoolArray = True) -> None:
        m = (system == SYSTEMS.index(letter)) & (bands == band)
        good = m & np.isfinite(value)
        delay[good] = value[good]
        available[good] = np.broadcast_to(broadcast, good.shape)[good]

    for letter in "GJ":
        put(letter, 1, first)
        put(letter, 2, _gamma(letter, 1, 2) * first)
        put(letter, 5, first, broadcast=False)  # ISC of L5 is not in the message of 1980
        put(letter, 5, np.where(states.newer, second, np.nan))  # but in newer ones
    put("I", 9, first)
    put("I", 5, _gamma("I", 9, 5) * first)
    f = states.f_nav
    own = np.where(f, first, second)
    has_b = ~f | (second != 0.0)  # F/NAV does not broadcast E5b/E1; files write zero
    put("E", 1, own)
    put("E", 5, own - first + _gamma("E", 1, 5) * first)
    put("E", 7, own - second + _gamma("E", 1, 7) * second, has_b)
    put("E", 8, own - 0.5 * (first + second) + _gamma("E", 1, 8) * 0.5 * (first + second), has_b)
    put("E", 6, own, broadcast=False)
    newer, none = states.newer, np.zeros(len(sat))
    put("C", 2, first, ~newer)
    own_b2 = states.b2b | ~newer & (sat % 100 <= _LAST_OF_B2I)
    put("C", 7, np.where(own_b2, second, np.nan))
    put("C", 6, none)
    put("C", 1, first, newer)
    put("C", 5, np.where(newer & np.isfinite(second), second, 0.0), newer & np.isfinite(second))
    put("C", 8, none, broadcast=False)
    return delay, available


def clock_to_b3i(states: SatelliteStates, sat: IntArray) -> FloatArray:
    """What brings BeiDou's precise clocks (B1I/B3I) to that of B3I, by TGD1; zero for others. Shape (n,). [s]"""
    delay = states.group_delay[:, 0] / (1.0 - _gamma("C", 6, 2))
    return np.where((sat // 100 == _C) & ~states.newer & np.isfinite(delay), delay, 0.0)


def _gamma(system: str, first: int, second: int) -> float:
    return (BANDS[(system, str(first))] / BANDS[(system, str(second))]) ** 2
