"""Simulated satellite ranges of a receiver on a moving body: sky windows, faults, clock jumps, and the truth."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from schuler.arrays import BoolArray, FloatArray, IntArray, as_vector3
from schuler.exceptions import InputError
from schuler.gnss.constellation import nominal_orbits
from schuler.gnss.ephemerides import Ephemerides
from schuler.gnss.observations import Observations
from schuler.gnss.ranges import Ranges
from schuler.gnss.signals import SPEED_OF_LIGHT, SYSTEMS, satellite, satellite_name
from schuler.gnss.synthetic import (
    L1_CYCLE,
    RangeErrors,
    Sector,
    SyntheticRanges,
    TrueSky,
    broadcast_satellites,
    draw_ranges,
    true_sky,
    with_arcs,
)
from schuler.plotting.notebook import Abridged
from schuler.simulation.motion import Motion
from schuler.simulation.scalar_aids import outside, times
from schuler.units import DEG

HIGHEST = "highest"  # name of the satellite that stands highest when a fault begins


class SkyWindow(NamedTuple):
    """A time with fewer satellites.

    Attributes
    ----------
    start, stop : float
        [s]
    satellites : int
        Most satellites seen; the highest stay.
    """

    start: float
    stop: float
    satellites: int


class BlockedSky(NamedTuple):
    """A part of the sky that is blocked for a time."""

    sector: Sector
    start: float = -np.inf
    stop: float = np.inf


class RangeFault(NamedTuple):
    """A satellite that is wrong.

    Attributes
    ----------
    satellite : str
        RINEX name such as ``G05``, or ``highest``: the one that stands highest when the fault begins.
    start, stop : float
        [s]
    step : float
        Added to its range. [m]
    ramp : float
        Added to its range per second since the start, and to its range rate. [m/s]
    """

    satellite: str
    start: float
    stop: float
    step: float = 0.0
    ramp: float = 0.0


@dataclass(frozen=True, kw_only=True, repr=False)
class SatelliteModel(Abridged):
    """A receiver of raw measurements under a nominal sky.

    Attributes
    ----------
    systems : str
        RINEX letters, see :func:`schuler.gnss.constellation.nominal_orbits`.
    rate_hz, first_s : float
        Epochs: rate and time of the first. [Hz], [s]
    errors : RangeErrors
        Noise, multipath, atmosphere left, receiver clock.
    elevation_mask : float
        [rad]
    lever_arm_b : ndarray, shape (3,)
        From the IMU to the antenna, body axes. [m]
    blocked : tuple of BlockedSky
    windows : tuple of SkyWindow
        Times with few satellites.
    outages : tuple of (start, stop)
        Times without any. [s]
    faults : tuple of RangeFault
    clock_jumps : tuple of (time, jump)
        Steps of the receiver clock, often whole milliseconds. [s], [s]
    clock_shift : float
        Added to every stamp: a receiver whose time is wrong against the IMU's. [s]
    slips_per_hour : float
        Cycle slips of each carrier that the receiver does not state: one to five cycles of L1, of either sign, halves
        among them.
    """

    systems: str = "GE"
    rate_hz: float = 1.0
    first_s: float = 0.0
    errors: RangeErrors = field(default_factory=RangeErrors)
    elevation_mask: float = 10.0 * DEG
    lever_arm_b: FloatArray | tuple[float, float, float] = (0.0, 0.0, 0.0)
    blocked: tuple[BlockedSky, ...] = ()
    windows: tuple[SkyWindow, ...] = ()
    outages: tuple[tuple[float, float], ...] = ()
    faults: tuple[RangeFault, ...] = ()
    clock_jumps: tuple[tuple[float, float], ...] = ()
    clock_shift: float = 0.0
    slips_per_hour: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "lever_arm_b", as_vector3(self.lever_arm_b, "SatelliteModel.lever_arm_b"))
        if not self.rate_hz > 0.0:
            raise InputError(f"SatelliteModel.rate_hz: expected a positive rate, got {self.rate_hz}")
        for fault in self.faults:
            if fault.satellite != HIGHEST and satellite(fault.satellite) // 100 not in map(SYSTEMS.index, self.systems):
                raise InputError(f"a fault of {fault.satellite}, but the systems simulated are {self.systems}")
        for window in self.windows:
            if window.satellites < 0 or not window.stop > window.start:
                raise InputError(f"expected a window start < stop and a number of satellites, got {window}")


class SimulatedSatellites(NamedTuple):
    """Ranges and the truth behind them.

    Attributes
    ----------
    made : SyntheticRanges
        Ranges, receiver clock by epoch, errors by row (faults included).
    faulty : ndarray of bool, shape (n,)
        Rows of satellites that are wrong.
    slipped : ndarray of bool, shape (n,)
        Rows before which the carrier slipped.
    t : ndarray, shape (k,)
        True times of the epochs, those without satellites too. [s]
    ephemerides : Ephemerides
        The orbits as broadcast.
    """

    made: SyntheticRanges
    faulty: BoolArray
    slipped: BoolArray
    t: FloatArray
    ephemerides: Ephemerides

    @property
    def ranges(self) -> Ranges:
        """The ranges."""
        return self.made.ranges

    def observations(self) -> Observations:
        """Observations as the receiver logs them, see :meth:`SyntheticRanges.observations`."""
        return self.made.observations()


class PreparedSky(NamedTuple):
    """What all draws of a receiver on one motion share.

    Attributes
    ----------
    sky : TrueSky
    keep : ndarray of bool, shape (k,)
        Epochs outside outages.
    ephemerides : Ephemerides
        The orbits as broadcast.
    """

    sky: TrueSky
    keep: BoolArray
    ephemerides: Ephemerides


def simulate_satellites(
    motion: Motion, model: SatelliteModel, rng: np.random.Generator, *, epoch_gps_s: float = 0.0
) -> SimulatedSatellites:
    """Ranges and range rates of an antenna on a moving body.

    Parameters
    ----------
    motion : Motion
        Motion of the IMU.
    model : SatelliteModel
    rng : numpy.random.Generator
    epoch_gps_s : float
        GPS time of zero seconds. [s]

    Returns
    -------
    SimulatedSatellites

    Raises
    ------
    InputError
        If nothing is ever seen, or a faulty satellite is not seen while it is wrong.

    Notes
    -----
    Windows, sectors and outages only take rows away: the noise of the others does not depend on them. GLONASS
    satellites fly as their users compute them from the broadcast states, so that ranges and messages agree.
    """
    return draw_satellites(prepare_sky(motion, model, epoch_gps_s=epoch_gps_s), model, rng)


def prepare_sky(motion: Motion, model: SatelliteModel, *, epoch_gps_s: float = 0.0) -> PreparedSky:
    """Satellites, true ranges and true range rates of an antenna on a moving body, for any number of draws."""
    t = times(motion.duration, model.rate_hz, model.first_s)
    keep = outside(t, model.outages, "satellite epoch")
    s = motion.state(t)
    lever = np.asarray(model.lever_arm_b)
    r_e = s.r_eb_e + s.C_eb @ lever
    v_e = s.v_eb_e + np.einsum("nij,nj->ni", s.C_eb, np.cross(s.omega_eb_b, lever))
    orbits = nominal_orbits(model.systems, epoch_gps_s=epoch_gps_s)
    ephemerides = orbits.ephemerides(epoch_gps_s - 60.0, epoch_gps_s + motion.duration + 60.0)
    satellites = broadcast_satellites(ephemerides, epoch_gps_s=epoch_gps_s) if "R" in model.systems else orbits
    sky = true_sky(t, r_e, v_e, satellites, epoch_gps_s=epoch_gps_s, elevation_mask=model.elevation_mask)
    return PreparedSky(sky, keep, ephemerides)


def draw_satellites(
    prepared: PreparedSky, model: SatelliteModel, rng: np.random.Generator, *, errors: RangeErrors | None = None
) -> SimulatedSatellites:
    """Ranges and range rates under a prepared sky; see :func:`simulate_satellites`.

    Parameters
    ----------
    prepared : PreparedSky
        Made with this model.
    model : SatelliteModel
    rng : numpy.random.Generator
    errors : RangeErrors, optional
        Instead of the model's.
    """
    t = prepared.sky.t
    made = draw_ranges(prepared.sky, rng, model.errors if errors is None else errors)
    made = _selected(made, prepared.keep[made.epoch] & _visible(made.ranges, made.epoch, model))
    own = rng.spawn(1)[0]
    made = replace(made, ranges=with_arcs(made.ranges, made.epoch, own))
    made, slipped = _with_slips(made, model, own)
    made, faulty = _with_faults(made, model.faults)
    made = _with_jumps(made, t, model.clock_jumps)
    if model.clock_shift:
        made = replace(made, ranges=replace(made.ranges, t=made.ranges.t + model.clock_shift))
    return SimulatedSatellites(made, faulty, slipped, t, prepared.ephemerides)


def _visible(ranges: Ranges, epoch: IntArray, model: SatelliteModel) -> BoolArray:
    """Rows left by blocked sectors and by windows with few satellites."""
    visible = np.ones(len(ranges), dtype=bool)
    for part in model.blocked:
        inside = (ranges.t >= part.start) & (ranges.t < part.stop)
        visible &= ~(inside & part.sector.blocks(ranges.azimuth, ranges.elevation))
    for window in model.windows:
        inside = (ranges.t >= window.start) & (ranges.t < window.stop)
        visible &= ~inside | (_rank(epoch, ranges.elevation, visible) < window.satellites)
    if not visible.any():
        raise InputError("blocked sky and windows leave no satellite at all")
    return visible


def _rank(epoch: IntArray, elevation: FloatArray, visible: BoolArray) -> IntArray:
    """Place of each row among those seen at its epoch, the highest satellite being 0."""
    order = np.lexsort((-elevation, ~visible, epoch))
    first = np.concatenate(([True], np.diff(epoch[order]) > 0))
    begin = np.maximum.accumulate(np.where(first, np.arange(len(order)), 0))
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order)) - begin
    return rank


def _selected(made: SyntheticRanges, keep: BoolArray) -> SyntheticRanges:
    if keep.all():
        return made
    return replace(
        made,
        ranges=made.ranges.where(keep),
        epoch=made.epoch[keep],
        error=made.error[keep],
        rate_error=made.rate_error[keep],
    )


def _with_faults(made: SyntheticRanges, faults: tuple[RangeFault, ...]) -> tuple[SyntheticRanges, BoolArray]:
    r = made.ranges
    range_fault, rate_fault = np.zeros(len(r)), np.zeros(len(r))
    faulty = np.zeros(len(r), dtype=bool)
    for fault in faults:
        inside = (r.t >= fault.start) & (r.t < fault.stop)
        if fault.satellite == HIGHEST and inside.any():
            first = np.flatnonzero(inside & (r.t == r.t[inside][0]))
            sat = int(r.sat[first[np.argmax(r.elevation[first])]])
        else:
            sat = 0 if fault.satellite == HIGHEST else satellite(fault.satellite)
        rows = inside & (r.sat == sat)
        if not rows.any():
            visible = ", ".join(sorted({satellite_name(int(x)) for x in r.sat[inside]})) or "none"
            raise InputError(
                f"{fault.satellite} is not seen within {fault.start:g}..{fault.stop:g} s, when it is to be wrong; "
                f"satellites seen then: {visible}"
            )
        range_fault[rows] += fault.step + fault.ramp * (r.t[rows] - fault.start)
        rate_fault[rows] += fault.ramp
        faulty |= rows
    if not faults:
        return made, faulty
    wrong = replace(r, pseudorange=r.pseudorange + range_fault, range_rate=r.range_rate + rate_fault)
    return replace(made, ranges=wrong, error=made.error + range_fault, rate_error=made.rate_error + rate_fault), faulty


def _with_slips(
    made: SyntheticRanges, model: SatelliteModel, rng: np.random.Generator
) -> tuple[SyntheticRanges, BoolArray]:
    """Carriers with slips within arcs, which keep their number, and where."""
    r = made.ranges
    order = np.argsort(r.sat, kind="stable")
    within = np.zeros(len(r), dtype=bool)
    within[order[1:]] = np.diff(r.arc[order]) == 0
    slipped = within & (rng.random(len(r)) < model.slips_per_hour / (3600.0 * model.rate_hz))
    half_cycles = np.where(slipped, rng.choice((-1, 1), len(r)) * rng.integers(1, 11, len(r)), 0)
    total = np.empty(len(r))
    total[order] = np.cumsum(half_cycles[order])  # what satellites before have in common cancels like an ambiguity
    carrier_range = r.carrier_range + 0.5 * L1_CYCLE * total
    return replace(made, ranges=replace(r, carrier_range=carrier_range)), slipped


def _with_jumps(made: SyntheticRanges, t: FloatArray, jumps: tuple[tuple[float, float], ...]) -> SyntheticRanges:
    """Clock steps: in the pseudoranges, the carriers and the true clock, not in the range rates."""
    if not jumps:
        return made
    total = np.zeros(len(t))
    for time, jump in jumps:
        total[t >= time] += SPEED_OF_LIGHT * jump
    r = made.ranges
    ranges = replace(
        r, pseudorange=r.pseudorange + total[made.epoch], carrier_range=r.carrier_range + total[made.epoch]
    )
    return replace(made, ranges=ranges, clock=made.clock + total[:, None])
