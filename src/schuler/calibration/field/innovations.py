"""Innovations of a calibration over time: what each measurement said that was not expected."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray
from schuler.filtering.engine import ForwardRun
from schuler.filtering.measurements import DIMENSIONS, FIX, KINDS, ZERO_VELOCITY, MeasurementSchedule

_HELD = (FIX, ZERO_VELOCITY)  # keep the place and say nothing of the sensors


@dataclass(frozen=True, eq=False)
class Innovations:
    """Innovations of one kind of measurement.

    Attributes
    ----------
    t : ndarray, shape (k,)
        [s]
    z : ndarray, shape (k, d)
        Each component, measured less expected, over its own 1-sigma. [-]
    """

    t: FloatArray
    z: FloatArray


def innovations_of(schedule: MeasurementSchedule, forward: ForwardRun) -> dict[str, Innovations]:
    """Innovations by kind, without those that hold the place; what was not used is left out.

    Parameters
    ----------
    schedule : MeasurementSchedule
        Of the pass.
    forward : ForwardRun
    """
    found = {}
    for kind in np.unique(schedule.kind):
        if kind in _HELD:
            continue
        d = DIMENSIONS[int(kind)]
        used = (schedule.kind == kind) & np.isfinite(forward.nis)
        z = forward.innovation[used, :d] / np.sqrt(forward.variance[used, :d])
        found[KINDS[int(kind)]] = Innovations(schedule.t[used], z)
    return found
