"""What goes wrong with an IMU's stream: pauses, samples that are repeated, stamps that jitter."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from schuler.arrays import BoolArray
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries


@dataclass(frozen=True, kw_only=True)
class StreamFaults:
    """Faults of a stream.

    Attributes
    ----------
    gaps : tuple of (start, stop)
        Times whose samples are lost. Of increments the motion in them is lost with them. [s]
    repeats : float
        Probability with which a sample holds the values of the one before under its own stamp.
    jitter : float
        1-sigma of stamps about the times they belong to; at most 0.4 sample intervals are added or taken off. [s]
    clock_shift : float
        Added to every stamp. [s]
    """

    gaps: tuple[tuple[float, float], ...] = ()
    repeats: float = 0.0
    jitter: float = 0.0
    clock_shift: float = 0.0

    def __post_init__(self) -> None:
        if not (0.0 <= self.repeats < 1.0 and self.jitter >= 0.0):
            raise InputError(
                f"expected repeats in 0..1 (1 excluded) and jitter >= 0, got {self.repeats}, {self.jitter}"
            )
        for start, stop in self.gaps:
            if not stop > start:
                raise InputError(f"a gap stops after it starts, got {start}..{stop} s")


class FaultyStream(NamedTuple):
    """A log with faults, which rows of the sound one it kept, and which of its own repeat the one before."""

    imu: ImuSeries
    kept: BoolArray
    repeated: BoolArray


def faulty_stream(imu: ImuSeries, faults: StreamFaults, rng: np.random.Generator) -> FaultyStream:
    """A sound log with the faults of its stream.

    Parameters
    ----------
    imu : ImuSeries
    faults : StreamFaults
    rng : numpy.random.Generator

    Raises
    ------
    InputError
        If fewer than two samples are left.
    """
    repeated = rng.uniform(size=len(imu)) < faults.repeats
    shake = rng.standard_normal(len(imu))
    kept = np.ones(len(imu), dtype=bool)
    for start, stop in faults.gaps:
        kept &= ~((imu.t >= start) & (imu.t < stop))
    if kept.sum() < 2:
        raise InputError("the gaps leave no two IMU samples")
    repeated[0] = False
    source = np.maximum.accumulate(np.where(repeated, 0, np.arange(len(imu))))
    t = imu.t + faults.clock_shift
    if faults.jitter:
        limit = 0.4 * imu.interval
        t = t + np.clip(faults.jitter * shake, -limit, limit)
    temperature = None if imu.temperature is None else imu.temperature[kept]
    log = replace(imu, t=t[kept], gyro=imu.gyro[source[kept]], accel=imu.accel[source[kept]], temperature=temperature)
    return FaultyStream(log, kept, repeated[kept])
