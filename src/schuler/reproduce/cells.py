"""One number of a thesis beside ours, with the band within which they agree."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from schuler.exceptions import InputError

#: Where a band comes from. "read": a number read from a printed curve. "band": stated by the thesis or by
#: the independent check of its equations.
Tolerance: TypeAlias = Literal["rounding", "printed digits", "discretisation", "statistical", "read", "band", ""]

#: Whose number it is: the thesis's own, or that of its equations after their errors are corrected.
Reference: TypeAlias = Literal["thesis", "corrected", ""]

_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


@dataclass(frozen=True)
class Cell:
    """One number and what it is to be.

    Attributes
    ----------
    name : str
        What it is, such as "consumer, 30 s: heading".
    ours : float
        In ``unit``.
    unit : str
    printed : str
        As the source has it, number or claim; empty where it has none.
    low, high : float
        Ours agrees within; both NaN where there is nothing to agree with.
    tolerance : str
        Kind of the band.
    reference : str
        ``thesis``; ``corrected`` where the band belongs to corrected equations; empty without band.
    why : str
        Why a number that the source prints is not compared; empty where it is.
    settings : str
        Settings that the source does not state, and over which set ours was computed; empty where one sufficed.
    least, most : float
        Ours over that set; the band is wider by as much.
    transcribed : bool
        Ours is the printed number itself, carried through: a data sheet, a constant, what simulated sensors or roads
        were made from. Only a slip could make it differ.
    """

    name: str
    ours: float
    unit: str = ""
    printed: str = ""
    low: float = math.nan
    high: float = math.nan
    tolerance: Tolerance = ""
    reference: Reference = ""
    why: str = ""
    settings: str = ""
    least: float = math.nan
    most: float = math.nan
    transcribed: bool = False

    def __post_init__(self) -> None:
        if self.compared and not (self.low <= self.high and (math.isfinite(self.low) or math.isfinite(self.high))):
            raise InputError(f"{self.name}: expected a band with at least one end, got {self.low} to {self.high}")
        if self.compared == (not self.reference):
            raise InputError(f"{self.name}: expected a band with its reference, or neither")
        if self.uncompared != bool(self.why):
            raise InputError(
                f"{self.name}: expected the reason why the printed {self.printed!r} is not compared"
                if self.uncompared
                else f"{self.name}: expected no reason for a number that is compared, or not printed"
            )

    @property
    def compared(self) -> bool:
        """Whether there is a band."""
        return not (math.isnan(self.low) and math.isnan(self.high))

    @property
    def agrees(self) -> bool | None:
        """Whether ours is in the band; None without one. A number that is none never agrees."""
        return bool(self.low <= self.ours <= self.high) if self.compared else None

    @property
    def decisive(self) -> bool:
        """Whether the band could have been missed by little: two ends of one sign, less than a factor of two apart."""
        if not (self.compared and math.isfinite(self.low) and math.isfinite(self.high)):
            return False
        near, far = sorted((abs(self.low), abs(self.high)))
        return self.low * self.high > 0.0 and far < 2.0 * near

    @property
    def numeric(self) -> bool:
        """Whether what is printed is, or holds, a number; an ordering or a shape has none."""
        return any(c.isdigit() for c in self.printed)

    @property
    def uncompared(self) -> bool:
        """Whether the source prints a number here that ours is not compared with."""
        return self.numeric and not self.compared

    @property
    def left_out(self) -> bool:
        """Whether the source prints a number that ours is not compared with, and misses by a fifth or more."""
        if not self.uncompared:
            return False
        value = float(_NUMBER.findall(self.printed)[-1])
        return not abs(self.ours - value) <= 0.2 * abs(value)

    def shown(self) -> str:
        """Ours, with as many digits as it takes to tell it from the ends of its band, and its range over settings."""
        text = f"{self.ours:.{self._digits()}g}"
        return f"{text} ({self.least:.3g} to {self.most:.3g} over {self.settings})" if self.settings else text

    def band(self) -> str:
        """The band in words; empty without one."""
        if not self.compared:
            return ""
        digits = self._digits()
        if math.isinf(self.low):
            return f"at most {self.high:.{digits}g}"
        if math.isinf(self.high):
            return f"at least {self.low:.{digits}g}"
        return f"{self.low:.{digits}g} to {self.high:.{digits}g}"

    def _digits(self) -> int:
        ends = [end for end in (self.low, self.high) if math.isfinite(end)]
        numbers = {self.ours, *ends} if math.isfinite(self.ours) else set(ends)
        return next((n for n in range(4, 16) if len({f"{v:.{n}g}" for v in numbers}) == len(numbers)), 16)

    def to_dict(self) -> dict[str, object]:
        """Plain values, band as ``low`` and ``high``."""
        return {
            "name": self.name, "printed": self.printed, "ours": self.ours, "unit": self.unit, "low": self.low,
            "high": self.high, "tolerance": self.tolerance, "reference": self.reference, "agrees": self.agrees,
            "why_not_compared": self.why, "transcribed": self.transcribed, "settings": self.settings,
            "least": self.least if self.settings else None, "most": self.most if self.settings else None,
        }  # fmt: skip


def against(
    name: str,
    printed: float,
    ours: float,
    *,
    relative: float = 0.0,
    absolute: float = 0.0,
    unit: str = "",
    tolerance: Tolerance = "statistical",
    reference: Reference = "thesis",
    source: str | None = None,
) -> Cell:
    """Ours against a number, within ``absolute + relative * abs(printed)``.

    Parameters
    ----------
    name : str
    printed : float
        The number to be met, in ``unit``.
    ours : float
    relative, absolute : float
        Half width of the band; at least one above zero.
    unit, tolerance, reference : str
        See :class:`Cell`.
    source : str, optional
        What the thesis prints, where that is not the number to be met.

    Returns
    -------
    Cell

    Raises
    ------
    InputError
        If the band has no width.
    """
    half = absolute + relative * abs(printed)
    if not half > 0.0:
        raise InputError(f"{name}: expected a relative or an absolute tolerance above 0")
    text = f"{printed:g}" if source is None else source
    return Cell(name, float(ours), unit, text, printed - half, printed + half, tolerance, reference)


def digits(name: str, printed: str, ours: float, *, unit: str = "", reference: Reference = "thesis") -> Cell:
    """Ours against a number as printed: within half a unit of its last digit.

    Parameters
    ----------
    name : str
    printed : str
        Such as ``"0.112"`` or ``"3.743e-5"``.
    ours : float
    unit, reference : str
        See :class:`Cell`.

    Returns
    -------
    Cell
    """
    mantissa, _, exponent = printed.lower().partition("e")
    places = len(mantissa.partition(".")[2])
    half = 0.5 * 10.0 ** (int(exponent or 0) - places) * (1.0 + 1e-9)
    value = float(printed)
    return Cell(name, float(ours), unit, printed, value - half, value + half, "printed digits", reference)


def over_settings(cell: Cell, others: Sequence[float], settings: str) -> Cell:
    """The cell with what ours is with other settings that the source does not state.

    Parameters
    ----------
    cell : Cell
        With a band.
    others : sequence of float
        Ours with each of the others of a bounded set, which data sheets or the source's other pages bound.
    settings : str
        The set in words, such as "drift of 0 to 20 deg/h".

    Returns
    -------
    Cell
        Its band is wider by the range: a systematic uncertainty of ours. A range of a factor of two decides nothing.
    """
    least, most = min(cell.ours, *others), max(cell.ours, *others)
    if min(cell.low, least) > 0.0:  # sizes scatter by factors
        low, high = cell.low * cell.ours / most, cell.high * cell.ours / least
    else:
        low, high = cell.low - (most - cell.ours), cell.high + (cell.ours - least)
    return replace(cell, low=low, high=high, settings=settings, least=least, most=most)


def transcribed(*cells: Cell) -> tuple[Cell, ...]:
    """The cells, those compared marked as numbers that went in."""
    return tuple(replace(cell, transcribed=cell.compared) for cell in cells)


def claimed(
    name: str,
    claim: str,
    ours: float,
    *,
    low: float = -math.inf,
    high: float = math.inf,
    unit: str = "",
    tolerance: Tolerance = "band",
    reference: Reference = "thesis",
) -> Cell:
    """Ours against a claim in words, turned into a number that has to be above ``low``, below ``high`` or between.

    Parameters
    ----------
    name : str
        What the number is, such as "ratio of the final errors".
    claim : str
        In few words of our own.
    ours : float
    low, high : float
    unit, tolerance, reference : str
        See :class:`Cell`.

    Returns
    -------
    Cell
    """
    return Cell(name, float(ours), unit, claim, low, high, tolerance, reference)


def shown(name: str, ours: float, *, unit: str = "", printed: str = "", why: str = "") -> Cell:
    """A number of ours that is compared with nothing.

    Parameters
    ----------
    name : str
    ours : float
    unit, printed : str
        See :class:`Cell`.
    why : str
        Why it is not compared; needed where a number is printed.

    Returns
    -------
    Cell

    Raises
    ------
    InputError
        If a number is printed and ``why`` is empty.
    """
    return Cell(name, float(ours), unit, printed, why=why)
