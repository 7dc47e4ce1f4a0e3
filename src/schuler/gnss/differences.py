"""Code and carrier differences between two receivers, and cycle slips between epochs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.frames import C_en, ecef_from_llh, llh_from_ecef
from schuler.gnss.antennas import Antenna, phase_delays
from schuler.gnss.carrier_scale import check_carrier_scale
from schuler.gnss.coarse import along_track, directions
from schuler.gnss.ephemerides import Ephemerides
from schuler.gnss.integrity import Integrity
from schuler.gnss.observations import Observations
from schuler.gnss.point import solve_points
from schuler.gnss.preparation import prepare_ranges
from schuler.gnss.ranges import predicted_ranges
from schuler.gnss.satellites import choose_messages, states_of_messages, transmission_times
from schuler.gnss.signals import SYSTEM_NAMES, SYSTEMS, wavelengths
from schuler.gnss.troposphere import saastamoinen
from schuler.gnss.weighting import noise_scale
from schuler.timebase import calendar

StrArray: TypeAlias = npt.NDArray[np.str_]

_SYSTEMS = "GECJ"  # those whose satellites share a frequency
_TOGETHER_S = 0.02  # between stamps of one epoch: clocks and orbits are taken at each receiver's own time [s]
_BASE_OFF = 200.0  # of the given base from its own single points [m]
_FLIGHT_S = 0.08  # [s]
_NO_MESSAGE, _OTHER_SYSTEM = 1, 7  # schuler.gnss.ranges.REASONS
_LONGEST_PAUSE_S = 10.0  # over which arcs go on [s]
_DRIFT = 0.001  # of differences over a pause: satellites' directions, atmosphere, 1-sigma [m/s]
_OUTLYING = 4.5  # normalised residual of a slip
_MOST_LOST = 0.5  # share of phases marked as having lost lock from which the mark says nothing
_SMALLEST_SLIP = 0.3  # half a cycle is the smallest there is [cycles]


@dataclass(frozen=True)
class SingleDifferences:
    """Rover minus base at k common epochs, of s slots: a satellite on a band. NaN where one of them did not measure.

    Attributes
    ----------
    t : ndarray, shape (k,)
        Reception by the rover, corrected for its clock. [s]
    r_e : ndarray, shape (k, 3)
        Approximate rover antenna, Earth-fixed. [m]
    base_llh : ndarray, shape (3,)
        Base antenna, or its mark. [rad, rad, m]
    sat : ndarray of int, shape (s,)
    band : tuple of str
        RINEX band of each slot.
    group : ndarray of int, shape (s,)
        Slots of a system and band, whose clocks and receiver delays are common.
    wavelength : ndarray, shape (s,)
        [m]
    code, carrier : ndarray, shape (k, s)
        Measured minus predicted for ``r_e``. [m]
    sigma_code, sigma_carrier : ndarray, shape (k, s)
        1-sigma. [m]
    gradient : ndarray, shape (k, s, 3)
        Derivative of the predicted range by the rover's Earth-fixed position.
    elevation : ndarray, shape (k, s)
        At the rover. [rad]
    arc : ndarray, shape (k, s)
        Another number where either receiver stated since the epoch before that lock was lost, or half a cycle came in
        doubt or was settled.
    notes : tuple of str
    """

    t: FloatArray
    r_e: FloatArray
    base_llh: FloatArray
    sat: IntArray
    band: tuple[str, ...]
    group: IntArray
    wavelength: FloatArray
    code: FloatArray
    carrier: FloatArray
    sigma_code: FloatArray
    sigma_carrier: FloatArray
    gradient: FloatArray
    elevation: FloatArray
    arc: FloatArray
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Slots:
    """Satellites, and the signals on one band in which rover and base measure them; (s,) each."""

    sat: IntArray
    rover: StrArray
    base: StrArray


@dataclass(frozen=True)
class _Receiver:
    """Measurements of one receiver as arrays of epochs and slots, (k, s), and where it was, (k, 3)."""

    stamp: FloatArray
    t: FloatArray
    r_e: FloatArray
    code: FloatArray
    carrier: FloatArray
    cn0: FloatArray
    arc: FloatArray


def single_differences(
    rover: Observations,
    base: Observations,
    ephemerides: Ephemerides,
    base_llh: FloatArray | None,
    *,
    systems: str,
    elevation_mask: float,
    cn0_mask: float,
    sigma_code: float,
    sigma_carrier: float,
    static: bool,
    antennas: tuple[Antenna | None, Antenna | None] = (None, None),
    base_eccentricity_n: FloatArray | None = None,
) -> SingleDifferences:
    """Match epochs, satellites and bands of two receivers, and subtract what geometry predicts.

    Parameters
    ----------
    rover, base, ephemerides, base_llh, systems, elevation_mask, cn0_mask, sigma_code, sigma_carrier, static, antennas
        See :func:`schuler.gnss.baseline.solve_baseline`.
    base_eccentricity_n : ndarray, shape (3,), optional
        Base antenna from ``base_llh``: north, east, down. [m]

    Returns
    -------
    SingleDifferences

    Raises
    ------
    InputError
        If there are no common epochs, satellites or carriers, or the base is not where it is said to be.

    Notes
    -----
    A satellite's position is taken at each receiver's own time of transmission, so that clocks that differ, and stamps
    up to 20 ms apart, do no harm. Of a band each receiver's signal with most carriers is used. A satellite is left out
    of an epoch where the single points of either receiver left it out.
    """
    if not systems or set(systems) - set(_SYSTEMS):
        raise InputError(
            f"systems: expected letters out of {_SYSTEMS}, whose satellites share frequencies (GLONASS's do not), "
            f"got {systems!r}"
        )
    for name, sigma in (("sigma_code", sigma_code), ("sigma_carrier", sigma_carrier)):
        if not sigma > 0.0:
            raise InputError(f"{name}: expected a positive standard deviation in metres, got {sigma}")
    slots, notes = _common_slots(rover, base, systems)
    located = partial(_receiver, systems=systems, elevation_mask=elevation_mask, cn0_mask=cn0_mask)
    b = located(base, ephemerides, slots.sat, slots.base, "base")
    to_antenna = np.zeros(3) if base_eccentricity_n is None else base_eccentricity_n
    if base_llh is None:
        base_llh = _mean_place(b, to_antenna)
        notes += ("base position: the mean of its single points, good to metres; the rover is off by as much",)
    base_e = ecef_from_llh(base_llh) + C_en(base_llh) @ to_antenna
    off = float(np.median(np.linalg.norm(b.r_e - base_e, axis=1)))
    if off > _BASE_OFF:
        raise InputError(f"base_llh: {off:.0f} m from where the base's own ranges place it; expected [rad, rad, m]")
    r = located(rover, ephemerides, slots.sat, slots.rover, "rover")
    shift = base.epoch_gps_s - rover.epoch_gps_s
    i, j = _common_epochs(r.stamp, b.stamp + shift, rover.epoch_gps_s)
    # what both single points have in common, atmosphere above all, would put the rover into another troposphere
    r_e = r.r_e[i] - b.r_e[j] + base_e
    r_e = np.broadcast_to(np.median(r_e, axis=0), r_e.shape) if static else r_e

    e, s = np.nonzero(np.isfinite(r.code[i] + r.carrier[i] + b.code[j] + b.carrier[j]))
    if not len(e):
        raise InputError("no satellite whose code and carrier both receivers measured at one epoch")
    cycle = np.array([wavelengths([one], name)[0] for one, name in zip(slots.sat, slots.rover, strict=True)])
    band = np.array([int(name[0]) for name in slots.rover])
    record = choose_messages(
        ephemerides, slots.sat[s], r.stamp[i][e] - _FLIGHT_S, epoch_gps_s=rover.epoch_gps_s,
        f_nav=np.char.startswith(slots.rover[s], "5"),
    )  # fmt: skip
    sent = _Sent(ephemerides, rover.epoch_gps_s, slots.sat[s], band[s], cycle[s], record)
    at_rover = _against_prediction(r, i[e], s, r.stamp[i][e], r_e[e], sent, antennas[0])
    at_base = _against_prediction(
        b, j[e], s, b.stamp[j][e] + shift, np.broadcast_to(base_e, (len(e), 3)), sent, antennas[1]
    )
    notes += at_rover.notes + at_base.notes
    if len(i) < len(r.stamp):
        notes += (f"{len(r.stamp) - len(i)} of {len(r.stamp)} epochs of the rover have none of the base",)

    def table(values: FloatArray) -> FloatArray:
        """Epochs by slots, NaN where one of the receivers did not measure."""
        full = np.full((len(i), len(slots.sat), *values.shape[1:]), np.nan)
        full[e, s] = values
        return full

    scale = table(np.sqrt(at_rover.scale**2 + at_base.scale**2))
    group = np.unique(
        [f"{one // 100}{name[0]}" for one, name in zip(slots.sat, slots.rover, strict=True)], return_inverse=True
    )[1]
    return SingleDifferences(
        r.t[i], r_e, base_llh, slots.sat, tuple(str(name[0]) for name in slots.rover), group.astype(np.int64), cycle,
        table(at_rover.code - at_base.code), table(at_rover.carrier - at_base.carrier), sigma_code * scale,
        sigma_carrier * scale, table(at_rover.gradient), table(at_rover.elevation),
        r.arc[i] + b.arc[j], notes,
    )  # fmt: skip


def _mean_place(receiver: _Receiver, to_antenna_n: FloatArray) -> FloatArray:
    """Mark below the mean of a receiver's single points. [rad, rad, m]"""
    mean_e = receiver.r_e.mean(axis=0)
    return llh_from_ecef(mean_e - C_en(llh_from_ecef(mean_e)) @ to_antenna_n)


@dataclass(frozen=True)
class _Sent:
    """What n measurements of both receivers have in common: satellite, band, wavelength [m] and broadcast message."""

    ephemerides: Ephemerides
    epoch_gps_s: float
    sat: IntArray
    band: IntArray
    wavelength: FloatArray
    record: IntArray


class _AgainstPrediction(NamedTuple):
    """Measured minus predicted, factor of the noise, slope of the prediction and elevation. (n,), gradient (n, 3)"""

    code: FloatArray
    carrier: FloatArray
    scale: FloatArray
    gradient: FloatArray
    elevation: FloatArray
    notes: tuple[str, ...]


def _against_prediction(
    x: _Receiver, row: IntArray, slot: IntArray, time: FloatArray, r_e: FloatArray, sent: _Sent, antenna: Antenna | None
) -> _AgainstPrediction:
    """Code and carrier of one receiver at ``r_e`` against geometry, its antenna and the troposphere. [m]"""
    measured = x.code[row, slot]
    at = transmission_times(sent.ephemerides, sent.sat, time, measured, sent.record, epoch_gps_s=sent.epoch_gps_s)
    r_s = states_of_messages(sent.ephemerides, sent.sat, at, sent.record, epoch_gps_s=sent.epoch_gps_s).r_e
    predicted, gradient = predicted_ranges(r_s, r_e)
    elevation, azimuth = directions(r_e, r_s)
    stand_ins: list[str] = []
    if antenna is not None:
        predicted = predicted + phase_delays(antenna, sent.sat, sent.band, elevation, azimuth, stand_ins)
    predicted = predicted + saastamoinen(llh_from_ecef(r_e), elevation, sent.epoch_gps_s + time)
    return _AgainstPrediction(
        measured - predicted, sent.wavelength * x.carrier[row, slot] - predicted,
        noise_scale(elevation, x.cn0[row, slot], "elevation+cn0"), gradient, elevation, tuple(stand_ins),
    )  # fmt: skip


def cycle_slips(d: SingleDifferences, *, static: bool) -> tuple[BoolArray, BoolArray]:
    """Find where arcs of constant ambiguity begin: after pauses, and where a phase jumps against the others.

    Parameters
    ----------
    d : SingleDifferences
    static : bool
        The rover does not move.

    Returns
    -------
    begins : ndarray of bool, shape (k, s)
        The ambiguity is new at this epoch.
    slipped : ndarray of bool, shape (k, s)
        Phases that jumped against the epoch before.

    Notes
    -----
    What a receiver states to have slipped begins anew. Other carrier changes from epoch to epoch must fit one
    displacement of the rover (none, static) and one change of the clocks, the same for all systems and bands. The
    largest normalised residual above 4.5, if it means more than 0.3 cycles, is a slip, then the next, until the others
    agree (Baarda's data snooping). Where too few phases are left to tell which one jumped, all begin anew.
    """
    present = np.isfinite(d.carrier)
    begins, slipped = present.copy(), np.zeros_like(present)
    for k in range(1, len(d.t)):
        pause = d.t[k] - d.t[k - 1]
        both = np.flatnonzero(present[k] & present[k - 1] & (d.arc[k] == d.arc[k - 1]))
        if pause > _LONGEST_PAUSE_S or not len(both):
            continue
        clock = np.ones((len(both), 1))
        A = clock if static else np.hstack((d.gradient[k, both], clock))
        sigma = np.hypot(d.sigma_carrier[k, both], d.sigma_carrier[k - 1, both]) + _DRIFT * pause
        jumped = outlying_phases(A, d.carrier[k, both] - d.carrier[k - 1, both], sigma, d.wavelength[both])
        if jumped is None:
            continue
        begins[k, both[~jumped]] = False
        slipped[k, both[jumped]] = True
    return begins, slipped


def outlying_phases(A: FloatArray, y: FloatArray, sigma: FloatArray, cycle: FloatArray) -> BoolArray | None:
    """Rows of ``y = A x`` that jumped by part of a cycle or more; None where it cannot be told which.

    Parameters
    ----------
    A : ndarray, shape (n, k)
    y, sigma, cycle : ndarray, shape (n,)
        Changes of phase, their 1-sigma and the length of a cycle. [m]
    """
    jumped = np.zeros(len(y), dtype=bool)
    while True:
        rows = np.flatnonzero(~jumped)
        if len(rows) <= A.shape[1]:
            return None
        Q, _ = np.linalg.qr(A[rows] / sigma[rows, None])
        w = y[rows] / sigma[rows]
        residual = w - Q @ (Q.T @ w)
        redundancy = np.maximum(1.0 - np.sum(Q * Q, axis=1), 1e-6)
        slip = np.abs(residual) / redundancy * sigma[rows] / cycle[rows]
        score = np.where(slip > _SMALLEST_SLIP, np.abs(residual) / np.sqrt(redundancy), 0.0)
        worst = int(np.argmax(score))
        if score[worst] <= _OUTLYING:
            return jumped
        if len(rows) < A.shape[1] + 2:
            return None
        jumped[rows[worst]] = True


def _common_slots(rover: Observations, base: Observations, systems: str) -> tuple[_Slots, tuple[str, ...]]:
    """Satellites on bands that both receivers measured, in one signal a system, band and receiver."""
    first, second = _signals(rover, systems), _signals(base, systems)
    sat: list[int] = []
    names: tuple[list[str], list[str]] = ([], [])
    for system, band in sorted(first.keys() & second.keys()):
        pair = first[(system, band)], second[(system, band)]
        seen = [set(o.sat[_rows(o, system, name)].tolist()) for o, name in zip((rover, base), pair, strict=True)]
        for one in sorted(seen[0] & seen[1]):
            sat.append(one)
            for column, name in zip(names, pair, strict=True):
                column.append(name)
    if not sat:
        raise InputError(
            f"no satellite of {systems} whose code and carrier both receivers measured on one band: rover has "
            f"{_listed(first)}, base {_listed(second)}"
        )
    used = sorted({f"{SYSTEMS[one // 100]} {a} with {b}" for one, a, b in zip(sat, *names, strict=True)})
    return _Slots(np.array(sat), np.array(names[0]), np.array(names[1])), (f"signals: {', '.join(used)}",)


def _rows(o: Observations, system: int, name: str) -> BoolArray:
    measured = np.isfinite(o.carrier) & np.isfinite(o.pseudorange)
    return np.asarray((o.sat // 100 == system) & (o.signal == o.signals.index(name)) & measured)


def _signals(o: Observations, systems: str) -> dict[tuple[int, str], str]:
    """Signal with most carriers beside codes by system and band."""
    most: dict[tuple[int, str], tuple[int, str]] = {}
    for letter in systems:
        system = SYSTEMS.index(letter)
        for name in o.signals:
            count = int(_rows(o, system, name).sum())
            if count > most.get((system, name[0]), (0, ""))[0]:
                most[(system, name[0])] = (count, name)
    return {key: name for key, (_, name) in most.items()}


def _listed(signals: dict[tuple[int, str], str]) -> str:
    return ", ".join(f"{SYSTEM_NAMES[SYSTEMS[s]]} {name}" for (s, _), name in sorted(signals.items())) or "none"


def _receiver(
    o: Observations,
    ephemerides: Ephemerides,
    sat: IntArray,
    signal: StrArray,
    name: str,
    *,
    systems: str,
    elevation_mask: float,
    cn0_mask: float,
) -> _Receiver:
    """One receiver's measurements of satellites that its single points use."""
    for system, band in sorted({(one // 100, band) for one, band in zip(sat.tolist(), signal.tolist(), strict=True)}):
        check_carrier_scale(o, SYSTEMS[system], band, name)
    ranges = prepare_ranges(o, ephemerides, systems=systems, elevation_mask=elevation_mask, cn0_mask=cn0_mask)
    asked = ranges.reason != _OTHER_SYSTEM
    if (asked & (ranges.reason == _NO_MESSAGE)).sum() == asked.sum():
        raise InputError(
            f"{name}: no ephemeris for any of its satellites at {date(o.epoch_gps_s + o.t[0])} GPS; "
            f"{listed_messages(ephemerides)}: take a navigation file of that day"
        )
    points = solve_points(ranges, integrity=Integrity(neighbours=False), velocity=False)
    if not points.ok.any():
        raise InputError(
            f"{name}: no single point could be solved: {points.summary()}; expected stamps in GPS time, messages of "
            "that day, and codes that fit them"
        )
    stamp = o.epochs
    ranges = points.screened(ranges)
    row = _nearest(stamp, points.t)  # corrected by the receiver clock, some milliseconds at most
    t = stamp.copy()
    t[row] = points.t
    r_e = along_track(t, points.t[points.ok], points.r_e[points.ok])
    good = set(zip(row[points.epoch[ranges.used]].tolist(), ranges.sat[ranges.used].tolist(), strict=True))
    code, carrier, cn0 = np.full((3, len(stamp), len(sat)), np.nan)
    arc = np.zeros((len(stamp), len(sat)))
    at = np.searchsorted(stamp, o.t)
    for k, (one, band) in enumerate(zip(sat.tolist(), signal.tolist(), strict=True)):
        rows = np.flatnonzero(_rows(o, one // 100, band) & (o.sat == one))
        arc[at[rows], k] = _stated_slips(o.lock[rows])
        arc[:, k] = np.cumsum(arc[:, k])
        rows = rows[~(o.cn0[rows] < cn0_mask)]
        rows = rows[np.array([(i, one) in good for i in at[rows].tolist()], dtype=bool)]
        code[at[rows], k], carrier[at[rows], k], cn0[at[rows], k] = o.pseudorange[rows], o.carrier[rows], o.cn0[rows]
    return _Receiver(stamp, t, r_e, code, carrier, cn0, arc)


def _stated_slips(lock: IntArray) -> BoolArray:
    """Where the indicators of a signal say that the phase is not that of before. Shape (n,).

    A receiver that marks most phases as having lost lock says nothing by it.
    """
    lost = (lock & 1) > 0
    half = np.diff(lock & 2, prepend=lock[:1] & 2) != 0
    return np.asarray(half | (lost if np.mean(lost) < _MOST_LOST else False))


def date(gps_s: float) -> str:
    """GPS time since 1980-01-06 as a date and a time of day, for sentences. [s]"""
    return f"{calendar(gps_s):%Y-%m-%d %H:%M:%S}"


def listed_messages(ephemerides: Ephemerides) -> str:
    """Clause on the days of the messages, and of precise orbits, for sentences."""
    toe, orbits = np.concatenate((ephemerides.kepler.toe, ephemerides.glonass.toe)), ephemerides.precise_orbits
    held = f"messages are of {date(toe.min())} to {date(toe.max())}" if len(toe) else "there are no messages at all"
    return held if orbits is None else f"{held}, precise orbits of {date(orbits.t[0])} to {date(orbits.t[-1])}"


def _nearest(values: FloatArray, wanted: FloatArray) -> IntArray:
    """Places of the nearest of increasing values."""
    if len(values) < 2:
        return np.zeros(len(wanted), dtype=np.int64)
    place = np.clip(np.searchsorted(values, wanted), 1, len(values) - 1)
    return np.asarray(place - (wanted - values[place - 1] < values[place] - wanted))


def _common_epochs(rover: FloatArray, base: FloatArray, epoch_gps_s: float) -> tuple[IntArray, IntArray]:
    """Places of epochs that both receivers stamped alike."""
    nearest = _nearest(base, rover)
    apart = np.abs(base[nearest] - rover)
    together = apart <= _TOGETHER_S
    if not together.any():
        spans = [f"{date(x[0] + epoch_gps_s)} to {date(x[-1] + epoch_gps_s)}" for x in (rover, base)]
        raise InputError(
            f"no common epochs: rover from {spans[0]}, base from {spans[1]} (GPS time); the nearest stamps are "
            f"{apart.min():.3f} s apart, expected {_TOGETHER_S:g} s at most; take a base log of that time"
        )
    return np.flatnonzero(together), nearest[together]
