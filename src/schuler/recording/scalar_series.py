"""A single number measured over time: heading, pressure height."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray, as_floats
from schuler.exceptions import InputError
from schuler.recording.times import check_times


@dataclass(frozen=True)
class ScalarSeries:
    """Measurements of one number.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Time of validity. [s]
    value : ndarray, shape (n,)
        Heading: of the body's x axis, from true north over east [rad]. Height: over the ellipsoid, or of a barometer
        over a level of its own [m].
    sigma : ndarray, shape (n,)
        1-sigma error, positive. [unit of the value]
    """

    t: FloatArray
    value: FloatArray
    sigma: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "t", check_times(self.t, "ScalarSeries.t"))
        n = len(self.t)
        object.__setattr__(self, "value", as_floats(self.value, "ScalarSeries.value", (n,)))
        object.__setattr__(self, "sigma", as_floats(self.sigma, "ScalarSeries.sigma", (n,)))
        if np.any(self.sigma <= 0.0):
            raise InputError(f"ScalarSeries.sigma: expected positive values, got {self.sigma.min()}")

    def __len__(self) -> int:
        return len(self.t)
