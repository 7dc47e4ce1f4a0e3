"""Choices of a field calibration."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from schuler.calibration.field.schedule import EarthRate, Secondary
from schuler.exceptions import InputError
from schuler.filtering.states import StateModel

#: Blocks of sensor states behind position, velocity and attitude: with them the filter has Yaman's 39 states.
BLOCKS = ("b_a", "b_g", "S_a", "S_g", "M_a", "M_g", "G_g")


@dataclass(frozen=True, slots=True)
class FieldOptions:
    """How a log of turns and rests is worked off.

    Attributes
    ----------
    blocks : tuple of str
        What is estimated, out of :data:`BLOCKS`; those the specification has no uncertainty for are left out.
    models : dict of str to StateModel
        Stochastic models that replace those of the specification, by block.
    primary : bool
        Magnitude of gravity at rest (P1), where no full gravity vector is used.
    earth_rate : {"auto", "vector", "vertical", "magnitude", "off"}
        What is known of the rate at rest: that it is the Earth's, all axes, the unit does not turn; that it is along
        the vertical only, which lets a hand sway; or one of these two by whether the log shows swaying. Form of P2 as
        printed.
    secondary : {"full", "reduced", "off"}
        Gravity vector against the carried attitude.
    secondary_from_s : float
        From when on, after the start of the log. [s]
    during_turns : bool
        Use it in turns too. Off by default: in a hand gravity is not the only specific force there.
    block_s : float
        Readings at rest are averaged over this. [s]
    passes : int
        Largest number of passes; they end when no parameter moves by more than ``settled`` of its sigma.
    settled : float
    rescale : bool
        Enlarge the noise to what innovations show, if they show more than chance.
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
        """As in the source: one pass, P1 and P2 as printed from the start, gravity vector from the second half on.

        References
        ----------
        Yaman (2017), sections 4.7 and 5.
        """
        return cls(earth_rate="magnitude", secondary="reduced", secondary_from_s=second_half_s, passes=1, rescale=False)
