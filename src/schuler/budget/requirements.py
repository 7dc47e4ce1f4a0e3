"""Requirements in words that a program can check: ``horizontal < 10 m @ 60 s outage``."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.budget.covariance import QUANTITIES, quantity_sigma
from schuler.exceptions import InputError
from schuler.units import DEG

if TYPE_CHECKING:
    from schuler.budget.scenario import BudgetMission

_UNITS = {
    "m": 1.0, "km": 1e3, "cm": 1e-2, "m/s": 1.0, "cm/s": 1e-2, "km/h": 1.0 / 3.6, "deg": DEG, "mrad": 1e-3, "rad": 1.0,
}  # fmt: skip
_PATTERN = re.compile(
    r"^\s*(?P<quantity>[a-z]+)\s*<=?\s*(?P<value>[0-9.eE+-]+)\s*(?P<unit>[a-z/]+)"
    r"(?:\s*\(\s*(?P<factor>[0-9.]+)\s*sigma\s*\))?"
    r"(?:\s*@\s*(?P<when>.+?))?\s*$"
)


@dataclass(frozen=True)
class Requirement:
    """A bound on a quantity at some time.

    Attributes
    ----------
    quantity : str
        One of :data:`.covariance.QUANTITIES`.
    limit : float
        SI
    factor : float
        Sigmas that have to stay below the limit.
    when : {"end", "always", "outage", "at"}
        End of the mission; always after it has settled; in every outage, ``seconds`` after its start (or at its end if
        it is shorter); at a time.
    seconds : float
    text : str
        As given.
    """

    quantity: str
    limit: float
    factor: float
    when: str
    seconds: float
    text: str

    def epochs(self, mission: BudgetMission) -> BoolArray:
        """Records that count. Shape (r,)."""
        t = mission.times
        if self.when == "end":
            return np.asarray(np.arange(len(t)) == len(t) - 1)
        if self.when == "always":
            return np.asarray(t >= mission.settle_s)
        if self.when == "at":
            if not t[0] <= self.seconds <= t[-1] + 1e-6:
                raise InputError(f"{self.text}: the mission's records run {t[0]:g} to {t[-1]:g} s")
            return np.asarray(np.arange(len(t)) == int(np.searchsorted(t, self.seconds + 1e-6, side="right") - 1))
        if not mission.outages:
            raise InputError(f"{self.text}: the mission has no outage; give it one in gnss.outages_s")
        counts = np.zeros(len(t), dtype=bool)
        for start, stop in mission.outages:
            until = min(stop, start + self.seconds) if self.seconds > 0.0 else stop
            counts |= (t >= start - 1e-6) & (t <= until + 1e-6)
        return counts

    def worst(self, mission: BudgetMission, P: FloatArray) -> tuple[float, float]:
        """Largest value of ``factor`` sigma among the records that count, and when. SI, [s]"""
        sigma = np.where(self.epochs(mission), quantity_sigma(P, self.quantity), -1.0)
        k = int(np.argmax(sigma))
        return self.factor * float(sigma[k]), float(mission.times[k])


def requirement(text: str) -> Requirement:
    """Parse a requirement.

    Parameters
    ----------
    text : str
        ``QUANTITY < VALUE UNIT [(N sigma)] [@ WHEN]``: horizontal, vertical, position, velocity, heading or tilt; m,
        km, cm, m/s, km/h, deg, mrad; WHEN is ``end`` (the default), ``always``, ``N s`` (a time of the mission),
        ``outage`` or ``N s outage``. One sigma if none is given. Two or three components count as the root of their
        summed variances.

    Raises
    ------
    InputError
        If it cannot be read, with what was expected.
    """
    expected = (
        f"expected QUANTITY < VALUE UNIT [(N sigma)] [@ end | always | 30 s | outage | 60 s outage] with one of "
        f"{', '.join(QUANTITIES)}, such as 'horizontal < 10 m @ 60 s outage'"
    )
    match = _PATTERN.match(text)
    if match is None or match["quantity"] not in QUANTITIES or match["unit"] not in _UNITS:
        raise InputError(f"requirement: {expected}; got {text!r}")
    shown = QUANTITIES[match["quantity"]][1]
    alike = {"m": ("m", "km", "cm"), "m/s": ("m/s", "cm/s", "km/h"), "deg": ("deg", "mrad", "rad")}[shown]
    if match["unit"] not in alike:
        raise InputError(f"requirement: {match['quantity']} is in {', '.join(alike)}; got {text!r}")
    try:
        value = float(match["value"])
    except ValueError:
        raise InputError(f"requirement: {expected}; got {text!r}") from None
    factor = float(match["factor"] or 1.0)
    if not (value > 0.0 and factor > 0.0):
        raise InputError(f"requirement: expected a positive bound; got {text!r}")
    when, seconds = _when((match["when"] or "end").strip(), f"requirement: {expected}; got {text!r}")
    return Requirement(match["quantity"], value * _UNITS[match["unit"]], factor, when, seconds, text.strip())


def _when(text: str, fault: str) -> tuple[str, float]:
    if text in ("end", "always", "outage"):
        return text, 0.0
    match = re.match(r"^([0-9.]+)\s*(s|min|h)(\s*outage)?$", text)
    if match is None:
        raise InputError(fault)
    seconds = float(match[1]) * {"s": 1.0, "min": 60.0, "h": 3600.0}[match[2]]
    return ("outage" if match[3] else "at"), seconds
