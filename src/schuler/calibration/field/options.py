"""Options of a field calibration and of its coach."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from schuler.calibration.field.schedule import EarthRate, Secondary
from schuler.exceptions import InputError
from schuler.filtering.states import StateModel
from schuler.units import DEG

#: Blocks of sensor states behind position, velocity and attitude: with them the filter has Yaman's 39 states.
BLOCKS = ("b_a", "b_g", "S_a", "S_g", "M_a", "M_g", "G_g")


@dataclass(frozen=True, slots=True)
class FieldOptions:
    """Options of :func:`schuler.calibration.field.calibration.calibrate_field`.

    Attributes
    ----------
    blocks : tuple of str
        Estimated blocks out of :data:`BLOCKS`; those without uncertainty in the specification are left out.
    models : dict of str to StateModel
        Stochastic models that replace those of the specification, by block.
    primary : bool
        Magnitude of gravity at rest (P1), where no full gravity vector is used.
    earth_rate : {"auto", "vector", "vertical", "magnitude", "off"}
        Measurement of the rate at rest: Earth rate on all axes, the unit does not turn; along the vertical only, where
        a hand sways; "auto": one of these two by whether the log shows swaying; the magnitude, P2 as printed.
    secondary : {"full", "reduced", "off"}
        Gravity vector against the carried attitude.
    secondary_from_s : float
        Time after the start of the log from which it is used. [s]
    during_turns : bool
        Use it in turns too. Off by default: a hand accelerates the unit there.
    block_s : float
        Readings at rest are averaged over this. [s]
    passes : int
        Largest number of passes; they end when no parameter moves by more than ``settled`` of its sigma.
    settled : float
    rescale : bool
        Enlarge the noise where innovations are significantly larger than stated.
    record_s : float
        Spacing of the history. [s]
    """

    blocks: tuple[str, ...] = BLOCKS
    models: dict[str, StateModel] = field(default_factory=dict)
    primary: bool = True
    earth_rate: EarthRate | Literal["auto"] = "auto"
    secondary: Secondary = "full"
    secondary_from_s: float = 0.0
    during_turns: bool = False
    block_s: float = 1.0
    passes: int = 8
    settled: float = 0.05
    rescale: bool = True
    record_s: float = 1.0

    def __post_init__(self) -> None:
        unknown = [name for name in (*self.blocks, *self.models) if name not in BLOCKS]
        if unknown:
            raise InputError(f"blocks: expected some of {', '.join(BLOCKS)}, got {unknown[0]!r}")
        if not (self.block_s > 0.0 and self.passes >= 1 and self.settled > 0.0 and self.record_s > 0.0):
            raise InputError("expected positive block_s, passes, settled and record_s")

    @classmethod
    def thesis(cls, *, second_half_s: float = 270.0) -> FieldOptions:
        """Options of the thesis: one pass, P1 and P2 as printed from the start, gravity vector from the second half on.

        References
        ----------
        Yaman (2017), sections 4.7 and 5.
        """
        return cls(earth_rate="magnitude", secondary="reduced", secondary_from_s=second_half_s, passes=1, rescale=False)


@dataclass(frozen=True, slots=True)
class CoachOptions:
    """Options of :func:`schuler.calibration.field.coaching.coach`.

    Attributes
    ----------
    target : float
        A parameter is calibrated when its 1-sigma is below this share of that before the log, by a margin of 5 %.
    rest_s, first_rest_s : float
        Length of a rest; of the first one, and of one more in the same place. [s]
    angles : tuple of float
        Turns to choose from, about the x, y and z axis both ways. [rad]
    turn_rate : float
        Rate of turns by hand. [rad/s]
    reaction_s : float
        Time from an advice to the beginning of the turn, at rest. [s]
    ahead : int
        Number of equal moves in a row that are compared, of turns up to 90 deg.
    patience_s : float
        Parameters that would not reach the target within this time are given up. [s]
    """

    target: float = 0.1
    rest_s: float = 5.0
    first_rest_s: float = 10.0
    angles: tuple[float, ...] = (45.0 * DEG, 90.0 * DEG, 180.0 * DEG, 360.0 * DEG)
    turn_rate: float = 36.0 * DEG
    reaction_s: float = 2.0
    ahead: int = 3
    patience_s: float = 300.0

    def __post_init__(self) -> None:
        if not 0.0 < self.target < 1.0:
            raise InputError(f"target: expected a share between 0 and 1, got {self.target!r}")
        if not self.rest_s >= 3.0 or not self.first_rest_s >= 6.0:
            raise InputError(
                f"expected rest_s of 3 s or more and first_rest_s of 6 s or more, got {self.rest_s:g} and "
                f"{self.first_rest_s:g}: the ends of a rest are not used, and noise is learnt from the first"
            )
        if not (self.angles and all(0.0 < a <= 2.0 * np.pi for a in self.angles)):
            raise InputError(f"angles: expected turns of up to 2 pi in radians, got {self.angles!r}")
        if not (self.turn_rate > 0.0 and self.reaction_s >= 0.0 and self.ahead >= 1 and self.patience_s > 0.0):
            raise InputError("expected positive turn_rate, ahead and patience_s, and reaction_s of zero or more")
