"""From a receiver's raw measurements and broadcast messages to ranges ready for positioning.

Receiver clocks that are set by whole milliseconds are found, with where it happened and by how much.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Literal, NamedTuple, get_args

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.frames import llh_from_ecef
from schuler.gnss.antennas import Antenna, phase_delays
from schuler.gnss.carrier import begin_arcs
from schuler.gnss.coarse import ReceiverPlace, epoch_medians, geometric_ranges, receiver_place
from schuler.gnss.ephemerides import Ephemerides
from schuler.gnss.ionosphere import ionosphere_free, klobuchar
from schuler.gnss.ionosphere_maps import map_delays
from schuler.gnss.observations import Observations
from schuler.gnss.ranges import Ranges
from schuler.gnss.satellites import (
    UNKNOWN_DELAY,
    SatelliteStates,
    choose_messages,
    group_delays,
    states_of_messages,
    transmission_times,
)
from schuler.gnss.signal_choice import ChosenSignals, choose_signals
from schuler.gnss.signals import SPEED_OF_LIGHT, SYSTEMS
from schuler.gnss.troposphere import Mapping as TroposphereMapping
from schuler.gnss.troposphere import saastamoinen
from schuler.gnss.weighting import Scheme, Weighting, range_sigmas
from schuler.timebase import calendar
from schuler.units import DEG

Ionosphere = Literal["klobuchar", "maps", "free", "none"]
Troposphere = Literal["saastamoinen", "none"]

#: Coefficients broadcast on 2021-04-28, a quiet Sun, for messages that have none.
STAND_IN_ALPHA = (9.313e-9, 1.490e-8, -5.960e-8, -1.192e-7)
STAND_IN_BETA = (8.806e4, 4.915e4, -1.311e5, -3.277e5)

_SHORTEST, _LONGEST = 1.0e7, 1.0e8  # pseudoranges; a receiver clock may be off by a tenth of a second [m]
_FLIGHT_S = 0.08  # for a choice of the message before anything is known [s]
_IMPLAUSIBLE = 10_000.0  # from the median of its epoch; the coarse position is much better than that [m]
_RESOLUTION_S = 1e-6  # times are corrected in steps of this, so that a disciplined receiver's stay as they are [s]
MILLISECOND = 1e-3 * SPEED_OF_LIGHT  # [m]
LONGEST_GAP_S = 60.0
_FASTEST = 3e4  # [m/s]
_CLEAR = 0.1  # a step is a whole number of milliseconds if it is as near as this to one [ms]


def prepare_ranges(
    observations: Observations,
    ephemerides: Ephemerides,
    *,
    position_e: ArrayLike | tuple[ArrayLike, ArrayLike] | None = None,
    signals: Mapping[str, tuple[str, ...]] | None = None,
    systems: str = "GRECJ",
    ionosphere: Ionosphere = "klobuchar",
    troposphere: Troposphere = "saastamoinen",
    mapping: TroposphereMapping = "niell",
    humidity: float = 0.7,
    elevation_mask: float = 10.0 * DEG,
    cn0_mask: float = 25.0,
    weighting: Weighting | Scheme = "elevation+cn0",
    causal: bool = False,
    max_age_s: Mapping[str, float] | None = None,
    antenna: Antenna | None = None,
) -> Ranges:
    """Ranges with the satellite's clock, its group delay and the atmosphere taken out, and how uncertain they are.

    Parameters
    ----------
    observations : Observations
    ephemerides : Ephemerides
    position_e : array_like, shape (3,), or pair of shapes (k,) and (k, 3), optional
        Approximate Earth-fixed receiver position, or times and positions of a track, good to 1 km. By default it is
        found from the pseudoranges themselves, every ten seconds; where there are never four satellites, the position
        in the observations' header is taken. [m]
    signals : mapping of str to tuple of str, optional
        Preferred signals by system, see :func:`schuler.gnss.signal_choice.choose_signals`.
    systems : str
        Letters of the systems to use.
    ionosphere : {"klobuchar", "maps", "free", "none"}
        Model with GPS's coefficients for all systems and frequencies; maps of the ephemerides, and that model where
        they have no value; combination of two frequencies; nothing.
    troposphere : {"saastamoinen", "none"}
    mapping, humidity
        See :func:`schuler.gnss.troposphere.saastamoinen`.
    elevation_mask : float
        [rad]
    cn0_mask : float
        Satellites whose signal is known to be weaker are not used. [dB-Hz]
    weighting : Weighting or str
        See :mod:`schuler.gnss.weighting`.
    causal : bool
        Use no broadcast message before it was sent.
    max_age_s : mapping of str to float, optional
        See :func:`schuler.gnss.satellites.choose_messages`.
    antenna : Antenna, optional
        The receiver's, upright and pointing to north: ranges and carriers become those of its reference point. See
        :func:`schuler.gnss.antennas.antenna_of`.

    Returns
    -------
    Ranges
        Every satellite of every epoch, with the reason where it is not to be used. GPS and QZSS share a clock, every
        other system has its own. ``pseudorange`` is NaN where only a Doppler shift was measured (or one frequency of
        two); the satellite is then placed by the other satellites' time of flight, 40 m along its orbit at worst.

    Raises
    ------
    InputError
        For unknown options, or a position that is none.

    Notes
    -----
    Whole milliseconds by which the receiver sets its clock are found and taken out (noted). Times are corrected by the
    receiver clock, rounded to a microsecond. Range rates get the satellite's clock rate and the term
    ``u . v_sat rate / c`` (3 mm/s at most) by which a second of transmission differs from one of reception; the
    atmosphere's rate of change (about 1 mm/s) is left in.
    """
    letters = _systems(systems)
    _check_models(ionosphere, troposphere)
    budget = weighting if isinstance(weighting, Weighting) else Weighting(scheme=weighting)
    channels = dict(zip(ephemerides.glonass.sat.tolist(), ephemerides.glonass.channel.tolist(), strict=True))
    free = ionosphere == "free"
    c = choose_signals(observations, signals=signals, pairs=free, systems=letters, glonass_channels=channels)
    selected = np.isin(c.sat // 100, [SYSTEMS.index(x) for x in letters])
    measured = np.isfinite(c.pseudorange).any(axis=1) | np.isfinite(c.range_rate) | ~selected
    c, selected = _rows(c, measured), selected[measured]
    epoch_gps_s, epochs = observations.epoch_gps_s, np.unique(c.t)
    epoch = np.searchsorted(epochs, c.t)
    sent = _sent(c, ephemerides, epoch, epoch_gps_s, causal=causal, max_age_s=max_age_s)
    states = sent.states
    combined, noise_factor, unknown = _without_delays(c, states, free=free)
    corrected = combined + SPEED_OF_LIGHT * states.clock
    phase = _carrier_ranges(c, {**channels, **observations.glonass_channels}) + SPEED_OF_LIGHT * states.clock
    usable = selected & states.has_message & states.healthy & sent.plausible
    place = receiver_place(
        c.t, corrected, states.r_e, usable, position_e=position_e, header_position_e=observations.position_e
    )
    clock = _receiver_clock(c, corrected, states, place, epochs, epoch, usable)
    air = _atmosphere(
        ephemerides, place, epoch_gps_s + c.t, c.frequency_hz[:, 0], ionosphere, troposphere, mapping, humidity,
        budget.ionosphere_share,
    )  # fmt: skip
    centre, first_centre = _phase_centres(antenna, c, place, air.notes, free=free)
    corrected = corrected - air.ionosphere - air.troposphere - centre
    phase = phase + air.ionosphere - air.troposphere - first_centre
    sigma_range, sigma_rate = range_sigmas(
        budget, c.sat, place.elevation, c.cn0, accuracy=states.accuracy,
        ionosphere=np.nan_to_num(air.ionosphere_sigma), troposphere=troposphere != "none" and place.located,
        noise_factor=np.nan_to_num(noise_factor, nan=1.0), unknown_delay=unknown,
    )  # fmt: skip
    reason = np.zeros(len(c.t), dtype=np.int64)
    for number, when in (
        (4, c.cn0 < cn0_mask),
        (3, place.elevation < elevation_mask),
        (5, ~(sent.plausible & ~clock.outlying) & np.isfinite(sent.measured)),
        (2, ~states.healthy),
        (1, ~states.has_message),
        (7, ~selected),
    ):  # the last one that holds is the one to report
        reason[when] = number
    t, time_notes = _received(epochs, clock.offset)
    group, groups = _clocks(c.sat, reason != 7)
    notes = (*c.notes, *_precise_notes(ephemerides), *place.notes, *clock.notes, *air.notes, *time_notes)
    return Ranges(
        t[epoch], c.sat, group, groups, states.r_e, states.v_e, corrected - clock.steps[epoch] * MILLISECOND,
        clock.rate, sigma_range, sigma_rate, place.elevation, place.azimuth, c.cn0, reason, notes, phase,
        begin_arcs(c.sat, phase, c.signal, c.lock),
        np.where(np.isfinite(phase), SPEED_OF_LIGHT / c.frequency_hz[:, 0], np.nan),
    )  # fmt: skip


class _Sent(NamedTuple):
    """Satellites as they sent what was measured, the measured range, and whether it can be one. (n,)"""

    states: SatelliteStates
    measured: FloatArray
    plausible: BoolArray


class _ReceiverClock(NamedTuple):
    """Range rates (n,) [m/s], outlying ranges (n,), the clock (k,) [m] and its whole milliseconds (k,), by epoch."""

    rate: FloatArray
    outlying: BoolArray
    offset: FloatArray
    steps: IntArray
    notes: list[str]


class _Atmosphere(NamedTuple):
    """Delays of the code (n,), and 1-sigma of what the ionosphere's model leaves (n,). [m]"""

    ionosphere: FloatArray
    troposphere: FloatArray
    ionosphere_sigma: FloatArray
    notes: list[str]


def _check_models(ionosphere: str, troposphere: str) -> None:
    if ionosphere not in get_args(Ionosphere):
        raise InputError(f"ionosphere: expected klobuchar, maps, free or none, got {ionosphere!r}")
    if troposphere not in ("saastamoinen", "none"):
        raise InputError(f"troposphere: expected saastamoinen or none, got {troposphere!r}")


def _sent(
    c: ChosenSignals, ephemerides: Ephemerides, epoch: IntArray, epoch_gps_s: float, *, causal: bool,
    max_age_s: Mapping[str, float] | None,
) -> _Sent:  # fmt: skip
    """Choose each row's message and place its satellite at the time of transmission."""
    record = choose_messages(
        ephemerides, c.sat, c.t - _FLIGHT_S, epoch_gps_s=epoch_gps_s, f_nav=(c.bands == 5).any(axis=1), causal=causal,
        max_age_s=max_age_s,
    )  # fmt: skip
    flight, measured, plausible = _flight_ranges(c.pseudorange, epoch, int(epoch.max(initial=-1)) + 1)
    t_sent = transmission_times(ephemerides, c.sat, c.t, flight, record, epoch_gps_s=epoch_gps_s)
    states = states_of_messages(ephemerides, c.sat, t_sent, record, epoch_gps_s=epoch_gps_s)
    return _Sent(states, measured, plausible)


def _receiver_clock(
    c: ChosenSignals, corrected: FloatArray, states: SatelliteStates, place: ReceiverPlace, epochs: FloatArray,
    epoch: IntArray, usable: BoolArray,
) -> _ReceiverClock:  # fmt: skip
    """Range rates of satellites, and the clock that the ranges of an epoch have in common, if the place is known."""
    n, k = len(c.t), len(epochs)
    rate = c.range_rate + SPEED_OF_LIGHT * states.clock_rate
    if not place.located:
        return _ReceiverClock(rate, np.zeros(n, dtype=np.bool_), np.zeros(k), np.zeros(k, dtype=np.int64), [])
    toward = _radial_speed(states, place)
    rate = rate + toward * c.range_rate / SPEED_OF_LIGHT
    residual = corrected - geometric_ranges(states.r_e, place.r_e)
    clock = epoch_medians(epoch, np.where(usable, residual, np.nan), k)
    drift = epoch_medians(epoch, np.where(usable, rate - toward, np.nan), k)
    steps, irregular = millisecond_steps(epochs, clock, drift)
    outlying = _outlying(residual, clock, epoch, usable)
    return _ReceiverClock(rate, outlying, clock, steps, list(_clock_notes(epochs, steps, irregular)))


def _atmosphere(
    ephemerides: Ephemerides, place: ReceiverPlace, gps_s: FloatArray, frequency_hz: FloatArray,
    ionosphere: Ionosphere, troposphere: Troposphere, mapping: TroposphereMapping, humidity: float, remains: float,
) -> _Atmosphere:  # fmt: skip
    """Delays of the models, zero where the place is not known."""
    none = np.zeros(len(gps_s))
    if not place.located:
        return _Atmosphere(none, none, none, [])
    llh = llh_from_ecef(place.r_e)
    delay, notes, sigma = none, list[str](), none
    if ionosphere == "klobuchar":
        delay, notes, share = _klobuchar(ephemerides, llh, place, gps_s, frequency_hz)
        sigma = remains * share * delay
    elif ionosphere == "maps":
        delay, sigma, notes = _by_maps(ephemerides, llh, place, gps_s, frequency_hz, remains)
    wet = none
    if troposphere == "saastamoinen":
        wet = saastamoinen(llh, place.elevation, gps_s, humidity=humidity, mapping=mapping)
    return _Atmosphere(delay, wet, sigma, notes)


def _phase_centres(
    antenna: Antenna | None, c: ChosenSignals, place: ReceiverPlace, notes: list[str], *, free: bool
) -> tuple[FloatArray, FloatArray]:
    """What the receiver's antenna adds to ranges, and to carriers on the first band. Shapes (n,), (n,). [m]"""
    none = np.zeros(len(c.t))
    if antenna is None or not place.located:
        return none, none
    first = phase_delays(antenna, c.sat, c.bands[:, 0], place.elevation, place.azimuth, notes)
    if not free:
        return first, first
    second = phase_delays(antenna, c.sat, c.bands[:, 1], place.elevation, place.azimuth, notes)
    f1, f2 = c.frequency_hz.T
    return np.where(np.isfinite(f2), first + f2**2 / (f1**2 - f2**2) * (first - second), first), first


def _precise_notes(ephemerides: Ephemerides) -> list[str]:
    if ephemerides.precise_orbits is not None and any(a.sat for a in ephemerides.antennas):
        return ["orbits and clocks are precise ones, of the satellites' antennas"]
    if ephemerides.precise_orbits is not None:
        return [
            "orbits and clocks are precise ones; positions are of centres of mass, up to 3 m above the antennas, which "
            "goes into the receiver clock but for some decimetres"
        ]
    if ephemerides.precise_clocks is not None:
        return ["precise clocks without precise orbits are not used: give the SP3 file of the same analysis centre"]
    return []


def _systems(systems: str) -> str:
    unknown = [s for s in systems if s not in SYSTEMS]
    if unknown or not systems:
        raise InputError(f"systems: expected letters out of {SYSTEMS}, such as GE, got {systems!r}")
    return systems


def _rows(c: ChosenSignals, keep: ArrayLike) -> ChosenSignals:
    k = np.asarray(keep)
    return ChosenSignals(
        c.t[k], c.sat[k], c.pseudorange[k], c.bands[k], c.frequency_hz[k], c.range_rate[k], c.cn0[k], c.carrier[k],
        c.signal[k], c.lock[k], c.notes,
    )  # fmt: skip


def _flight_ranges(pseudorange: FloatArray, epoch: IntArray, epochs: int) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Ranges for the time of flight, the measured ones (first band, else second) and which of these are plausible.

    An implausible range is replaced by the median of its epoch. Shapes (n, 2), (n,) to (n,). [m]
    """
    measured = np.where(np.isfinite(pseudorange[:, 0]), pseudorange[:, 0], pseudorange[:, 1])
    plausible = (measured > _SHORTEST) & (measured < _LONGEST)
    typical = epoch_medians(epoch, np.where(plausible, measured, np.nan), epochs)
    typical = np.where(np.isfinite(typical), typical, _FLIGHT_S * SPEED_OF_LIGHT)
    return np.where(plausible, measured, typical[epoch]), measured, plausible


def _carrier_ranges(c: ChosenSignals, channels: Mapping[int, int]) -> FloatArray:
    """Carrier phases times wavelength; none of GLONASS satellites whose channel is not known. Shape (n,). [m]"""
    unknown = (c.sat // 100 == SYSTEMS.index("R")) & ~np.isin(c.sat, list(channels))
    return np.where(unknown, np.nan, c.carrier * SPEED_OF_LIGHT / c.frequency_hz[:, 0])


def _radial_speed(states: SatelliteStates, place: ReceiverPlace) -> FloatArray:
    """Velocity of the satellites along the line of sight, away from the receiver: ``u . v_sat``. Shape (n,). [m/s]"""
    to_sat = states.r_e - place.r_e
    to_sat /= np.linalg.norm(to_sat, axis=1)[:, None]
    return np.asarray(np.sum(to_sat * states.v_e, axis=1))


def _outlying(residual: FloatArray, clock: FloatArray, epoch: IntArray, usable: BoolArray) -> BoolArray:
    """Residuals far from the clock of their epoch, where four or more tell it. Shape (n,)."""
    alone = usable & np.isfinite(residual)
    off = np.abs(residual - clock[epoch]) > _IMPLAUSIBLE
    return np.asarray(alone & off & (np.bincount(epoch[alone], minlength=len(clock))[epoch] >= 4))


def _without_delays(
    c: ChosenSignals, states: SatelliteStates, *, free: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Pseudoranges with group delays taken out: combined, noise factor, 1-sigma of unknown delays."""
    delays, knowns = zip(*(group_delays(states, c.sat, c.bands[:, i]) for i in range(2)), strict=True)
    first = c.pseudorange[:, 0] - SPEED_OF_LIGHT * delays[0]
    unknown_first = np.where(knowns[0] | ~states.has_message | (c.sat // 100 == SYSTEMS.index("R")), 0.0, UNKNOWN_DELAY)
    if not free:
        return first, np.ones(len(c.t)), unknown_first
    second = c.pseudorange[:, 1] - SPEED_OF_LIGHT * delays[1]
    pair = (c.bands > 0).all(axis=1)
    combined, factor = np.full(len(c.t), np.nan), np.ones(len(c.t))
    f1, f2 = c.frequency_hz[pair].T
    combined[pair], factor[pair] = ionosphere_free(first[pair], second[pair], f1, f2)
    unknown_second = np.where(
        knowns[1] | ~states.has_message | (c.sat // 100 == SYSTEMS.index("R")), 0.0, UNKNOWN_DELAY
    )
    share = np.ones(len(c.t))
    share[pair] = f1**2 / (f1**2 - f2**2)
    factor = np.where(np.isfinite(factor), factor, np.sqrt(share**2 + (share - 1.0) ** 2))
    return combined, factor, np.hypot(share * unknown_first, (share - 1.0) * unknown_second)


def _klobuchar(
    ephemerides: Ephemerides, llh: FloatArray, place: ReceiverPlace, gps_s: FloatArray, frequency_hz: FloatArray
) -> tuple[FloatArray, list[str], float]:
    alpha, beta, notes, share = ephemerides.klobuchar_alpha, ephemerides.klobuchar_beta, [], 1.0
    if alpha is None or beta is None:
        alpha, beta, share = STAND_IN_ALPHA, STAND_IN_BETA, 2.0
        notes.append(
            "the messages have no Klobuchar coefficients: those of 2021-04-28 stand in, at twice the usual uncertainty"
        )
    return klobuchar(alpha, beta, llh, place.elevation, place.azimuth, gps_s, frequency_hz), notes, share


def _by_maps(
    ephemerides: Ephemerides, llh: FloatArray, place: ReceiverPlace, gps_s: FloatArray, frequency_hz: FloatArray,
    remains: float,
) -> tuple[FloatArray, FloatArray, list[str]]:  # fmt: skip
    """Delays by maps and their 1-sigma, by Klobuchar's model where maps have no value. (n,), (n,) [m]"""
    maps = ephemerides.ionosphere_maps
    if maps is None:
        raise InputError(
            'ionosphere: "maps" needs an IONEX file among the ephemerides, and there is none; give one of the day, or '
            'take "klobuchar"'
        )
    delay, sigma = map_delays(maps, llh, place.elevation, place.azimuth, gps_s, frequency_hz)
    outside = ~np.isfinite(delay)
    if not outside.any():
        return delay, sigma, []
    if outside.all():
        raise InputError(
            f"ionosphere: the maps are of {_date(maps.t[0])} to {_date(maps.t[-1])} GPS, or have no value there; the "
            f"observations begin at {_date(gps_s[0])}; give the IONEX file of that day"
        )
    model, notes, share = _klobuchar(ephemerides, llh, place, gps_s, frequency_hz)
    notes.append(f"{int(outside.sum())} of {len(delay)} ranges are outside of the ionosphere's maps: Klobuchar's model")
    return np.where(outside, model, delay), np.where(outside, remains * share * model, sigma), notes


def _date(gps_s: float) -> str:
    return f"{calendar(float(gps_s)):%Y-%m-%d %H:%M}"


def _clock_notes(epochs: FloatArray, steps: IntArray, irregular: IntArray) -> list[str]:
    notes = []
    jumps = np.flatnonzero(np.diff(steps))
    if len(jumps):
        first = jumps[0]
        notes.append(
            f"the receiver set its clock by whole milliseconds {len(jumps)} times, first by "
            f"{steps[first + 1] - steps[first]:+d} ms at {epochs[first + 1]:.3f} s: taken out"
        )
    if len(irregular):
        notes.append(
            f"the receiver clock moved by more than 0.1 ms, but no whole milliseconds, {len(irregular)} times, first "
            f"at {epochs[irregular[0]]:.3f} s: left as it is"
        )
    return notes


def _received(epochs: FloatArray, clock: FloatArray) -> tuple[FloatArray, list[str]]:
    """Times of reception, corrected by the receiver clock [m]; an epoch without one takes that of the epoch before."""
    with_clock = np.flatnonzero(np.isfinite(clock))
    if not len(with_clock):
        return epochs, []
    last = with_clock[np.maximum(np.searchsorted(with_clock, np.arange(len(epochs)), side="right") - 1, 0)]
    t = epochs - np.round(clock[last] / SPEED_OF_LIGHT / _RESOLUTION_S) * _RESOLUTION_S
    if np.any(np.diff(t) <= 0.0):
        return epochs, ["times corrected by the receiver clock would not increase: left as they are"]
    return t, []


def _clocks(sat: IntArray, selected: BoolArray) -> tuple[IntArray, tuple[str, ...]]:
    """Place of each satellite's clock, and the clocks' names; zero for systems not asked for."""
    gps, qzss = SYSTEMS.index("G"), SYSTEMS.index("J")
    owner = np.where(sat // 100 == qzss, gps, sat // 100)
    present = np.unique(owner[selected])
    return np.where(selected, np.searchsorted(present, owner), 0), tuple(SYSTEMS[i] for i in present)


def millisecond_steps(t: FloatArray, clock: FloatArray, drift: FloatArray) -> tuple[IntArray, IntArray]:
    """Whole milliseconds by which a receiver clock has been set since the first epoch.

    Parameters
    ----------
    t : ndarray, shape (k,)
        Epochs. [s]
    clock : ndarray, shape (k,)
        Receiver clock at each, NaN where unknown; errors of 10 km do not matter. [m]
    drift : ndarray, shape (k,)
        Its rate from Doppler shifts. Where it is NaN, or beyond 100 ppm (a step between two measurements), the rate of
        the previous interval without a step is used. [m/s]

    Returns
    -------
    steps : ndarray of int, shape (k,)
        To be subtracted from the clock, in milliseconds, to make it continuous.
    irregular : ndarray of int
        Epochs at which the clock moved by more than 0.1 ms that is no whole number of milliseconds; left as it is.

    Notes
    -----
    Nothing is looked for across gaps of more than a minute, where a drift alone can make a millisecond.
    """
    steps = np.zeros(len(t), dtype=np.int64)
    irregular = []
    with_clock = np.flatnonzero(np.isfinite(clock))
    usual = 0.0
    for a, b in pairwise(with_clock.tolist()):
        dt, moved = t[b] - t[a], clock[b] - clock[a]
        if not 0.0 < dt <= LONGEST_GAP_S:
            continue
        rates = drift[[a, b]]
        rates = rates[np.abs(rates) < _FASTEST]
        unexpected = (moved - (rates.mean() if len(rates) else usual) * dt) / MILLISECOND
        whole = int(np.round(unexpected))
        if abs(unexpected - whole) > _CLEAR:
            irregular.append(int(b))
        elif whole:
            steps[b:] += whole
        else:
            usual = moved / dt
    return steps, np.array(irregular, dtype=np.int64)
