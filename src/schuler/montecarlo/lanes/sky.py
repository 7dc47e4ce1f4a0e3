"""Single satellites of a campaign in lanes: a true sky for all runs, errors of ranges and a receiver's clock by run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray, as_floats
from schuler.exceptions import InputError
from schuler.filtering.measurements import ARC_START, CARRIER_PHASE, PSEUDORANGE, RANGE_RATE, MeasurementSchedule
from schuler.filtering.states import StateLayout
from schuler.gnss.ranges import Ranges
from schuler.gnss.synthetic import RangeErrors, TrueSky, carrier_errors, clock_groups, range_errors, receiver_clock

#: Kinds that are one satellite's; a start of an arc counts as a phase.
SINGLE_KINDS = (PSEUDORANGE, RANGE_RATE, CARRIER_PHASE, ARC_START)
_VALUE = np.zeros(max(SINGLE_KINDS) + 1, dtype=np.int64)  # column of the measured value, by kind
_VALUE[list(SINGLE_KINDS)] = 3, 6, 3, 3
_BY_SATELLITE = ("r_sat_e", "v_sat_e", "range", "rate", "elevation", "azimuth", "visible")


class DrawnRanges(NamedTuple):
    """Errors of one run.

    Attributes
    ----------
    error : ndarray, shape (m,)
        Measured minus true of every measurement, the receiver's clock included. [m], [m/s]
    t : ndarray, shape (k,)
        Epochs. [s]
    clock : ndarray, shape (k, g)
        [m]
    drift : ndarray, shape (k,)
        [m/s]
    """

    error: FloatArray
    t: FloatArray
    clock: FloatArray
    drift: FloatArray

    def clock_states(self, layout: StateLayout, t: ArrayLike) -> FloatArray:
        """True states of the receiver's clocks, in the order of the layout; between epochs with their drift.

        Parameters
        ----------
        layout : StateLayout
        t : array_like, shape (r,)
            [s]

        Returns
        -------
        ndarray, shape (r, c)
        """
        t = np.asarray(t, dtype=np.float64)
        k = np.maximum(np.searchsorted(self.t, t + 1e-9) - 1, 0)
        values = {"clock": self.clock[k, 0] + self.drift[k] * (t - self.t[k]), "clock_drift": self.drift[k]}
        values |= {f"clock_{i + 1}": self.clock[k, i] - self.clock[k, 0] for i in range(1, self.clock.shape[1])}
        names = clock_blocks(layout)
        return np.stack([values[name] for name in names], axis=-1) if names else np.empty((len(t), 0))


@dataclass(frozen=True)
class SkyErrors:
    """Whose ranges are measured, and what their errors are drawn from.

    Attributes
    ----------
    sky : TrueSky
        Of the satellites that are measured at some time.
    errors : RangeErrors
    epoch, satellite : ndarray of int, shape (m,)
        Place of each measurement in the sky's times and satellites.
    group : ndarray of int, shape (s,)
        Clock of each satellite.
    groups : int
        Number of clocks.
    """

    sky: TrueSky
    errors: RangeErrors
    epoch: IntArray
    satellite: IntArray
    group: IntArray
    groups: int

    def where(self, keep: BoolArray) -> SkyErrors:
        """Those of some measurements; draws stay as they are."""
        return replace(self, epoch=self.epoch[keep], satellite=self.satellite[keep])

    def draw(self, kind: IntArray, rng: np.random.Generator) -> DrawnRanges:
        """Errors of one run, by the simulator's own models (:func:`schuler.gnss.synthetic.draw_ranges`).

        Parameters
        ----------
        kind : ndarray of int, shape (m,)
        rng : numpy.random.Generator
        """
        sky, at, clock_at = self.sky, (self.epoch, self.satellite), (self.epoch, self.group[self.satellite])
        error, rate_error, _, _ = range_errors(sky.t, sky.elevation, self.errors, rng)
        clock, drift = receiver_clock(sky.t, self.errors, self.groups, rng)
        value = np.where(kind == RANGE_RATE, rate_error[at] + drift[self.epoch], error[at] + clock[clock_at])
        phase = np.isin(kind, (CARRIER_PHASE, ARC_START))
        if phase.any():
            carrier = carrier_errors(sky.t, sky.elevation, self.errors, rng.spawn(1)[0])
            value = np.where(phase, carrier[at] + clock[clock_at], value)
        return DrawnRanges(value, sky.t, clock, drift)


def numbered(ranges: Ranges) -> Ranges:
    """Ranges whose values are the numbers of their rows: measurements made of them say where they come from."""
    row = np.arange(float(len(ranges)))
    return replace(ranges, pseudorange=row, range_rate=row, carrier_range=row)


def true_measurements(
    schedule: MeasurementSchedule, ranges: Ranges, epoch: IntArray, sky: TrueSky, errors: RangeErrors
) -> tuple[MeasurementSchedule, SkyErrors]:
    """Schedule of true ranges, and what draws their errors.

    Parameters
    ----------
    schedule : MeasurementSchedule
        Made of ``numbered(ranges)``.
    ranges : Ranges
    epoch : ndarray of int, shape (n,)
        Place in the sky's times of each row of the ranges.
    sky : TrueSky
    errors : RangeErrors
    """
    m, column = np.arange(len(schedule)), _VALUE[schedule.kind]
    row = schedule.z[m, column].astype(np.int64)
    order, group = clock_groups(sky.sat)
    seen = np.isin(sky.sat, ranges.sat[row])
    sky = replace(
        sky,
        **{name: getattr(sky, name)[:, seen] for name in _BY_SATELLITE},
        sat=sky.sat[seen],
    )
    satellite = np.argmax(ranges.sat[row][:, None] == sky.sat, axis=1)
    of = SkyErrors(sky, errors, epoch[row], satellite, group[seen], len(order))
    z, at = schedule.z.copy(), (of.epoch, of.satellite)
    z[m, column] = np.where(schedule.kind == RANGE_RATE, sky.rate[at], sky.range[at])
    return replace(schedule, z=z), of


def with_errors(schedule: MeasurementSchedule, error: FloatArray) -> MeasurementSchedule:
    """A schedule of true ranges with the errors of a run. ``error``: shape (m,)."""
    z = schedule.z.copy()
    z[np.arange(len(schedule)), _VALUE[schedule.kind]] += as_floats(error, "error", (len(schedule),))
    return replace(schedule, z=z)


def clock_blocks(layout: StateLayout) -> list[str]:
    """Names of the layout's clock states, in its order."""
    return [name for name in layout.models if name.startswith("clock")]


def check_layout(layout: StateLayout, single: bool) -> None:
    """Raise InputError if a layout has states that lanes do not have, or single satellites have no clock."""
    from schuler.filtering.states import AMBIGUITIES, BLOCKS

    clocks = clock_blocks(layout)
    others = [
        name
        for name in layout.models
        if BLOCKS[name][0][0] < 0 and not (single and (name in clocks or name in AMBIGUITIES))
    ]
    if others:
        raise InputError(
            "lanes estimate sensor errors only, and with single satellites clocks and ambiguities; use the engine for "
            f"the other state blocks ({', '.join(others)})"
        )
    if single and "clock" not in clocks:
        raise InputError("single satellites need the receiver's clock among the states: clock, clock_drift")
