"""From a receiver's raw measurements and broadcast messages to ranges ready for positioning."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from schuler.arguments import explains_arguments
from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.gnss.antennas import Antenna, phase_delays
from schuler.gnss.atmosphere import Ionosphere, Troposphere, atmosphere, check_models
from schuler.gnss.carrier import begin_arcs
from schuler.gnss.carrier_scale import without_wrong_rates
from schuler.gnss.coarse import ReceiverPlace, epoch_medians, receiver_place
from schuler.gnss.code_biases import biases_at, relative_biases_at
from schuler.gnss.ephemerides import Ephemerides
from schuler.gnss.ionosphere import ionosphere_free
from schuler.gnss.observations import Observations
from schuler.gnss.ranges import Ranges
from schuler.gnss.receiver_clock import MILLISECOND, receiver_clock, reception_times
from schuler.gnss.satellites import (
    UNKNOWN_DELAY,
    SatelliteStates,
    choose_messages,
    clock_to_b3i,
    group_delays,
    states_of_messages,
    transmission_times,
)
from schuler.gnss.signal_choice import ChosenSignals, bands_apart, choose_signals
from schuler.gnss.signals import SPEED_OF_LIGHT, SYSTEMS
from schuler.gnss.sun_and_moon import solid_tide
from schuler.gnss.troposphere import Mapping as TroposphereMapping
from schuler.gnss.weighting import Scheme, Weighting, range_sigmas
from schuler.units import DEG

_SHORTEST, _LONGEST = 1.0e7, 1.0e8  # pseudoranges; a receiver clock may be off by a tenth of a second [m]
_FLIGHT_S = 0.08  # for a choice of the message before anything is known [s]


@explains_arguments
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
    ionosphere : {"klobuchar", "beidou", "galileo", "nequick-g", "maps", "free", "none"}
        Model with GPS's coefficients for all systems and frequencies, BeiDou's with its own (taken where GPS's are
        missing, too), two with Galileo's; maps of the ephemerides, and that model where
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
    Range rates of signals whose codes change otherwise are left out
    (:func:`~schuler.gnss.carrier_scale.without_wrong_rates`). Whole milliseconds by which the receiver sets its clock
    are found and taken out (noted). Times are corrected by the
    receiver clock, rounded to a microsecond. Range rates get the satellite's clock rate and the term
    ``u . v_sat rate / c`` (3 mm/s at most) by which a second of transmission differs from one of reception; the
    atmosphere's rate of change (about 1 mm/s) is left in.
    """
    letters = _systems(systems)
    check_models(ionosphere, troposphere)
    budget = weighting if isinstance(weighting, Weighting) else Weighting(scheme=weighting)
    channels = dict(zip(ephemerides.glonass.sat.tolist(), ephemerides.glonass.channel.tolist(), strict=True))
    free = ionosphere == "free"
    observations, rate_notes = without_wrong_rates(observations, letters)
    c = choose_signals(observations, signals=signals, pairs=free, systems=letters, glonass_channels=channels)
    selected = np.isin(c.sat // 100, [SYSTEMS.index(x) for x in letters])
    measured = np.isfinite(c.pseudorange).any(axis=1) | np.isfinite(c.range_rate) | ~selected
    c, selected = _rows(c, measured), selected[measured]
    epoch_gps_s, epochs = observations.epoch_gps_s, np.unique(c.t)
    epoch = np.searchsorted(epochs, c.t)
    sent = _sent(c, ephemerides, epoch, epoch_gps_s, causal=causal, max_age_s=max_age_s)
    states = sent.states
    delays, bias_notes = _delays(c, observations.signals, states, ephemerides, epoch_gps_s)
    combined, noise_factor, unknown = _without_delays(c, states, delays, free=free)
    corrected = combined + SPEED_OF_LIGHT * states.clock
    channels |= observations.glonass_channels
    metres = _carrier_ranges(c, channels)
    phase = metres + SPEED_OF_LIGHT * states.clock
    usable = selected & states.has_message & states.healthy & sent.plausible
    place = receiver_place(
        c.t, corrected, states.r_e, usable, position_e=position_e, header_position_e=observations.position_e
    )
    clock = receiver_clock(c.range_rate, corrected, states, place, epochs, epoch, usable)
    air = atmosphere(
        ephemerides, place, c.sat, states.r_e, epoch_gps_s + c.t, c.frequency_hz[:, 0], ionosphere, troposphere,
        mapping, humidity, budget.ionosphere_share,
    )  # fmt: skip
    centre, first_centre = _phase_centres(antenna, c, place, air.notes, free=free)
    tide = _tides(ephemerides, states, place, epoch_gps_s + c.t, air.notes)
    corrected = corrected - air.ionosphere - air.troposphere - centre - tide
    phase = phase + air.ionosphere - air.troposphere - first_centre - tide
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
    t, time_notes = reception_times(epochs, clock.offset)
    group, groups = _clocks(c.sat, reason != 7)
    notes = (
        *c.notes,
        *rate_notes,
        *_precise_notes(ephemerides),
        *bias_notes,
        *place.notes,
        *clock.notes,
        *air.notes,
        *time_notes,
    )
    return Ranges(
        t[epoch], c.sat, group, groups, states.r_e, states.v_e, corrected - clock.steps[epoch] * MILLISECOND,
        clock.rate, sigma_range, sigma_rate, place.elevation, place.azimuth, c.cn0, reason, notes, phase,
        begin_arcs(c.sat, phase, c.signal, c.lock),
        np.where(np.isfinite(phase), SPEED_OF_LIGHT / c.frequency_hz[:, 0], np.nan),
        bands_apart(observations, c, metres, channels),
    )  # fmt: skip


class _Sent(NamedTuple):
    """Satellites as they sent what was measured, the measured range, and whether it can be one. (n,)"""

    states: SatelliteStates
    measured: FloatArray
    plausible: BoolArray


def _sent(
    c: ChosenSignals, ephemerides: Ephemerides, epoch: IntArray, epoch_gps_s: float, *, causal: bool,
    max_age_s: Mapping[str, float] | None,
) -> _Sent:  # fmt: skip
    """Choose each row's message and place its satellite at the time of transmission."""
    beidou = c.sat // 100 == SYSTEMS.index("C")
    b2b = beidou & (c.bands == 7).any(axis=1) & np.isin(c.bands, (0, 6, 7)).all(axis=1)
    modern = (c.bands == 5).any(axis=1) | (beidou & (c.bands == 1).any(axis=1))
    record = choose_messages(
        ephemerides, c.sat, c.t - _FLIGHT_S, epoch_gps_s=epoch_gps_s, f_nav=modern,
        b2b=b2b & (ephemerides.precise_orbits is None), causal=causal, max_age_s=max_age_s,
    )  # fmt: skip
    flight, measured, plausible = _flight_ranges(c.pseudorange, epoch, int(epoch.max(initial=-1)) + 1)
    t_sent = transmission_times(ephemerides, c.sat, c.t, flight, record, epoch_gps_s=epoch_gps_s)
    states = states_of_messages(ephemerides, c.sat, t_sent, record, epoch_gps_s=epoch_gps_s)
    return _Sent(states, measured, plausible)


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


def _tides(
    ephemerides: Ephemerides, states: SatelliteStates, place: ReceiverPlace, gps_s: FloatArray, notes: list[str]
) -> FloatArray:
    """What tides of the solid Earth add to ranges; nothing beside broadcast orbits, which err by metres. (n,) [m]"""
    if ephemerides.precise_orbits is None or not place.located:
        return np.zeros(len(gps_s))
    r_e = np.broadcast_to(place.r_e, (len(gps_s), 3))
    to_sat = states.r_e - r_e
    to_sat /= np.linalg.norm(to_sat, axis=1)[:, None]
    notes.append("tides of the solid Earth are taken out: positions are those of the ground at rest")
    return np.asarray(-np.sum(to_sat * solid_tide(r_e, gps_s), axis=1))


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
        c.signal[k], c.lock[k], c.second[k], c.notes,
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


class _Delays(NamedTuple):
    """By how much both pseudoranges are late against the satellite's clock, and whether that is stated. (n, 2), [s]"""

    late: FloatArray
    stated: BoolArray


def _delays(
    c: ChosenSignals, names: tuple[str, ...], states: SatelliteStates, ephemerides: Ephemerides, epoch_gps_s: float
) -> tuple[_Delays, list[str]]:
    """Group delays of the messages, and biases of a file where it leads to the clocks or to those."""
    broadcast = [group_delays(states, c.sat, c.bands[:, k]) for k in range(2)]
    out = _Delays(np.stack([x[0] for x in broadcast], axis=1), np.stack([x[1] for x in broadcast], axis=1))
    table, precise = ephemerides.code_biases, ephemerides.precise_orbits is not None
    if table is None:
        return out, []
    absolute = np.array([not x for x in table.against])
    notes = []
    if not precise and absolute.any():
        notes.append("code biases are not used: they belong to precise clocks, give the SP3 file of their centre")
        if absolute.all():
            return out, notes
    name, measured = np.array([*names, ""]), np.isfinite(c.pseudorange)
    clock, delay = np.zeros(measured.shape, dtype=bool), np.zeros(measured.shape, dtype=bool)
    for k, signal in enumerate((c.signal, c.second)):
        relative = relative_biases_at(table, c.sat, name[signal], epoch_gps_s + c.t)
        if precise:
            bias = biases_at(table, c.sat, name[signal], epoch_gps_s + c.t)
            bias = np.where(np.isfinite(bias), bias, relative.to_clock) + clock_to_b3i(states, c.sat)
            clock[:, k] = np.isfinite(bias)
            out.late[clock[:, k], k], out.stated[clock[:, k], k] = bias[clock[:, k]], True
        # against the group delay of the signal's own band if there is one, else that of another band
        own = c.bands[:, k]
        for band in (own, *(np.full(len(own), x) for x in range(1, relative.to_band.shape[1]))):
            late, stated = group_delays(states, c.sat, band)
            late = late + relative.to_band[np.arange(len(own)), band]
            here = np.isfinite(late) & ~clock[:, k] & ~delay[:, k] & (stated | (band is own))
            out.late[here, k], out.stated[here, k] = late[here], stated[here]
            delay[here & (stated | (c.sat // 100 == SYSTEMS.index("R"))), k] = True
    parts = [f"code biases are those of the file for {int((measured & (clock | delay)).sum())} pseudoranges"]
    if (measured & delay).any():
        parts.append(f"{int((measured & delay).sum())} of them relative to group delays of the messages")
    if (measured & ~clock & ~delay).any():
        parts.append(f"{int((measured & ~clock & ~delay).sum())} have none in it")
    return out, [*notes, ", ".join(parts)]


def _without_delays(
    c: ChosenSignals, states: SatelliteStates, delays: _Delays, *, free: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Pseudoranges with group delays taken out: combined, noise factor, 1-sigma of unknown delays."""
    sure = delays.stated | (~states.has_message | (c.sat // 100 == SYSTEMS.index("R")))[:, None]
    unknown_first, unknown_second = np.where(sure, 0.0, UNKNOWN_DELAY).T
    first, second = (c.pseudorange - SPEED_OF_LIGHT * delays.late).T
    if not free:
        return first, np.ones(len(c.t)), unknown_first
    pair = (c.bands > 0).all(axis=1)
    combined, factor = np.full(len(c.t), np.nan), np.ones(len(c.t))
    f1, f2 = c.frequency_hz[pair].T
    combined[pair], factor[pair] = ionosphere_free(first[pair], second[pair], f1, f2)
    share = np.ones(len(c.t))
    share[pair] = f1**2 / (f1**2 - f2**2)
    factor = np.where(np.isfinite(factor), factor, np.sqrt(share**2 + (share - 1.0) ** 2))
    return combined, factor, np.hypot(share * unknown_first, (share - 1.0) * unknown_second)


def _clocks(sat: IntArray, selected: BoolArray) -> tuple[IntArray, tuple[str, ...]]:
    """Place of each satellite's clock, and the clocks' names; zero for systems not asked for."""
    gps, qzss = SYSTEMS.index("G"), SYSTEMS.index("J")
    owner = np.where(sat // 100 == qzss, gps, sat // 100)
    present = np.unique(owner[selected])
    return np.where(selected, np.searchsorted(present, owner), 0), tuple(SYSTEMS[i] for i in present)
