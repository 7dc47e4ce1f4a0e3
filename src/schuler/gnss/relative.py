"""Ranges relative to a base: what both receivers' orbits, clocks and atmosphere have in common taken out."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.gnss.carrier import LONGEST_PAUSE_S, carrier_changes
from schuler.gnss.ranges import Ranges, predicted_ranges
from schuler.gnss.signals import SYSTEMS
from schuler.gnss.weighting import noise_scale

#: 1-sigma of a strong satellite's code overhead, where nothing else is known. [m]
LEAST_CODE = 0.3
_ROUNDS = 20  # in which means of arcs and epochs settle to a percent of the noise
_ENOUGH = 100  # degrees of freedom that tell a standard deviation to 7 %
_SLIP_CYCLES, _SLIP_SIGMAS = 0.3, 5.0  # of the difference of two bands; half a cycle is the smallest slip
_TOGETHER_S = 0.02  # between receptions of one epoch: each receiver's satellites are taken at its own time [s]


@dataclass(frozen=True)
class RelativeCarriers:
    """Carrier and code of satellites that a rover and a base measured at one time, in order of the rover's time.

    Both are ranges of the rover, with the base's measured less its true range taken out: the constant of an arc is a
    whole number of cycles beside the clocks of the two receivers.

    Attributes
    ----------
    row : ndarray of int, shape (m,)
        Row of the rover's ranges.
    carrier, code : ndarray, shape (m,)
        [m]
    sigma : ndarray, shape (m,)
        1-sigma of the carrier, of both receivers. [m]
    arc : ndarray of int, shape (m,)
        Equal numbers of a satellite share their constant: followed by both receivers at every epoch of theirs, no slip.
    kind : ndarray of int, shape (m,)
        Satellites of one system and wavelength, whose clocks and delays are common.
    wavelength : ndarray, shape (m,)
        [m]
    sigma_code : ndarray, shape (m,)
        1-sigma of the code, of both receivers. [m]
    """

    row: IntArray
    carrier: FloatArray
    code: FloatArray
    sigma: FloatArray
    arc: IntArray
    kind: IntArray
    wavelength: FloatArray
    sigma_code: FloatArray


def relative_ranges(
    rover: Ranges, base: Ranges, base_e: FloatArray, *, sigma_code: float | None, sigma_carrier: float
) -> tuple[Ranges, RelativeCarriers]:
    """Pseudoranges of a rover corrected by a base, and carriers whose differences have whole ambiguities.

    Parameters
    ----------
    rover, base : Ranges
        Prepared alike, on one axis of time, slips taken out of the arcs.
    base_e : ndarray, shape (3,)
        Base antenna, Earth-fixed. [m]
    sigma_code, sigma_carrier : float
        1-sigma of one receiver's measurement of a strong satellite overhead; it grows as
        :func:`schuler.gnss.weighting.noise_scale`. None takes that of codes from :func:`code_noise`. [m]

    Returns
    -------
    ranges : Ranges
        The rover's: pseudoranges less what the base's miss, the mean of each of its systems at the epoch kept out of
        it, so that the receiver clock stays the rover's. NaN where the base did not measure: a range of another datum
        does not belong beside them. Range rates and carriers as they were.
    carriers : RelativeCarriers

    Raises
    ------
    InputError
        If the receivers never measured a satellite's carrier at one time.
    """
    epochs, epoch = np.unique(rover.t, return_inverse=True)
    theirs, epoch_b = np.unique(base.t, return_inverse=True)
    nearest = _nearest(theirs, epochs)
    together = np.abs(theirs[nearest] - epochs) <= _TOGETHER_S
    if not together.any():
        raise InputError(
            f"base: no epoch in common: rover {epochs[0]:.1f}..{epochs[-1]:.1f} s, base {theirs[0]:.1f}.."
            f"{theirs[-1]:.1f} s of the recording's axis, {np.abs(theirs[nearest] - epochs).min():.3f} s apart at "
            f"best, expected {_TOGETHER_S:g} s; give a base log of that time"
        )
    both = rover.used & together[epoch]
    key_b = epoch_b * 1000 + base.sat
    order = np.argsort(key_b, kind="stable")
    wanted = nearest[epoch] * 1000 + rover.sat
    place = np.minimum(np.searchsorted(key_b[order], wanted), len(order) - 1)
    other = order[place]
    both &= (key_b[other] == wanted) & base.used[other]
    row = np.flatnonzero(both & np.isfinite(rover.pseudorange) & np.isfinite(base.pseudorange[other]))
    partner = other[row]
    distance = predicted_ranges(base.r_sat_e[partner], base_e)[0]
    scale = np.hypot(
        *(noise_scale(r.elevation[k], r.cn0[k], "elevation+cn0") for r, k in ((rover, row), (base, partner)))
    )

    missed = base.pseudorange[partner] - distance
    system = epoch[row] * (len(base.groups) + 1) + base.group[partner]
    _, group = np.unique(system, return_inverse=True)
    mean = np.bincount(group, missed) / np.bincount(group)
    pseudorange = np.full(len(rover), np.nan)
    pseudorange[row] = rover.pseudorange[row] - missed + mean[group]
    phases = np.isfinite(rover.carrier_range[row] + base.carrier_range[partner])
    same = np.abs(rover.wavelength[row] - base.wavelength[partner]) < 1e-9  # NaN is not the same
    same &= rover.sat[row] // 100 != SYSTEMS.index("R")  # whose satellites differ in frequency
    keep = phases & same
    if not keep.any():
        raise InputError(
            "base: no satellite whose carrier phase both receivers measured at one time on one frequency; carriers "
            "need signals of one band (GPS L1 with L1), GLONASS has none"
        )
    everything, row, partner = row, row[keep], partner[keep]
    arc = _common_arcs(rover, base, row, partner, sigma_carrier)
    wavelength = rover.wavelength[row]
    kinds = np.stack((rover.sat[row] // 100, np.round(wavelength * 1e6).astype(np.int64)), axis=1)
    _, kind = np.unique(kinds, axis=0, return_inverse=True)
    carrier = rover.carrier_range[row] - base.carrier_range[partner] + distance[keep]
    code = rover.pseudorange[row] - missed[keep]
    carriers = RelativeCarriers(
        row, carrier, code, sigma_carrier * scale[keep], arc, kind.ravel(), wavelength, np.full(len(row), np.nan)
    )
    if sigma_code is None:
        sigma_code = code_noise(carriers, rover.t[row], rover.sat[row], scale[keep])
    sigma = rover.sigma_range.copy()
    sigma[everything] = sigma_code * scale
    carriers = replace(carriers, sigma_code=sigma_code * scale[keep])
    return replace(rover, pseudorange=pseudorange, sigma_range=sigma), carriers


def with_second_band(
    first: RelativeCarriers, second: RelativeCarriers, row: IntArray, sat: IntArray
) -> RelativeCarriers:
    """Carriers of two bands, whose integers are searched together.

    Parameters
    ----------
    first, second : RelativeCarriers
    row : ndarray of int, shape (m,)
        Row of the first band's ranges for each of the second; -1 where there is none.
    sat : ndarray of int, shape (n,)
        Satellites of the first band's ranges.

    Returns
    -------
    RelativeCarriers
        In order of time. Those of the second band where the first has one, too: its arcs end where the first's do, and
        where the difference of both bands, in which geometry and clocks cancel, jumps by 0.3 cycles and five sigma.
    """
    place = np.minimum(np.searchsorted(first.row, row), len(first.row) - 1)
    kept = np.flatnonzero((row >= 0) & (first.row[place] == row))
    by_sat = kept[np.lexsort((row[kept], sat[row[kept]]))]
    one, x = place[by_sat], first.carrier[place[by_sat]] - second.carrier[by_sat]
    noise = np.hypot(first.sigma[one], second.sigma[by_sat])
    jumped = np.abs(np.diff(x)) > np.maximum(
        _SLIP_CYCLES * second.wavelength[by_sat[1:]], _SLIP_SIGMAS * np.hypot(noise[1:], noise[:-1])
    )
    begins = jumped | (np.diff(first.arc[one]) != 0) | (np.diff(second.arc[by_sat]) != 0)
    begins |= np.diff(sat[row[by_sat]]) != 0
    arc = np.concatenate(([0], np.cumsum(begins)))
    joined = {f.name: np.concatenate((getattr(first, f.name), getattr(second, f.name)[by_sat])) for f in fields(first)}
    joined["row"] = np.concatenate((first.row, row[by_sat]))
    joined["arc"] = np.concatenate((first.arc, arc[: len(by_sat)]))
    joined["kind"] = np.concatenate((first.kind, int(first.kind.max()) + 1 + second.kind[by_sat]))
    order = np.argsort(joined["row"], kind="stable")
    return RelativeCarriers(**{name: values[order] for name, values in joined.items()})


def code_noise(c: RelativeCarriers, t: FloatArray, sat: IntArray, scale: FloatArray) -> float:
    """Noise and multipath of codes by their carriers, 1-sigma of one receiver and a strong satellite overhead. [m]

    Parameters
    ----------
    c : RelativeCarriers
    t, sat, scale : ndarray, shape (m,)
        Time [s], satellite and noise relative to a strong satellite overhead, of both receivers, of each row.

    Returns
    -------
    float
        At least 0.3 m, which stands where arcs are too short to tell.

    Notes
    -----
    Code less carrier is a constant in an arc and one number of a kind at an epoch, beside noise: both means are taken
    off, one after the other until nothing is left. Multipath that lasts as long as an arc is in its mean, and does not
    show.
    """
    x, w = c.code - c.carrier, 1.0 / scale**2
    _, arc = np.unique(np.stack((sat, c.arc), axis=1), axis=0, return_inverse=True)
    _, epoch = np.unique(np.stack((np.searchsorted(np.unique(t), t), c.kind), axis=1), axis=0, return_inverse=True)
    arc, epoch = arc.ravel(), epoch.ravel()
    for _ in range(_ROUNDS):
        for group in (arc, epoch):
            x = x - (np.bincount(group, w * x) / np.bincount(group, w))[group]
    freedom = len(x) - (arc.max() + 1) - (epoch.max() + 1)
    if freedom < _ENOUGH:
        return LEAST_CODE
    return float(max(LEAST_CODE, np.sqrt(np.sum(w * x**2) / freedom)))


def _common_arcs(rover: Ranges, base: Ranges, row: IntArray, partner: IntArray, sigma: float) -> IntArray:
    """Number the arcs of each satellite in which neither receiver missed an epoch or slipped."""
    unbroken = [_unbroken(rover, sigma)[row], _unbroken(base, sigma)[partner]]
    order = np.lexsort((rover.t[row], rover.sat[row]))
    a, b = order[:-1], order[1:]
    new = (rover.sat[row][a] != rover.sat[row][b]) | (rover.t[row][b] - rover.t[row][a] > LONGEST_PAUSE_S)
    for number in unbroken:
        new |= number[a] != number[b]
    arc = np.zeros(len(row), dtype=np.int64)
    arc[b] = np.cumsum(new)
    return arc


def _unbroken(r: Ranges, sigma: float) -> IntArray:
    """Number that counts up wherever a satellite's carrier is not that of the epoch before, continued."""
    begins = np.ones(len(r), dtype=np.int64)
    begins[carrier_changes(r, sigma).now] = 0
    order = np.argsort(r.sat, kind="stable")
    number = np.empty(len(r), dtype=np.int64)
    number[order] = np.cumsum(begins[order])
    return number


def _nearest(values: FloatArray, wanted: FloatArray) -> IntArray:
    """Places of the nearest of increasing values."""
    if len(values) < 2:
        return np.zeros(len(wanted), dtype=np.int64)
    place = np.clip(np.searchsorted(values, wanted), 1, len(values) - 1)
    return np.asarray(place - (wanted - values[place - 1] < values[place] - wanted))
