"""Bands that random numbers are met within: four standard errors, of both sides where the source drew runs too."""

from __future__ import annotations

from math import sqrt

from schuler.reproduce.cells import Cell, Reference, against, claimed

#: Standard errors allowed. Some hundred numbers are compared, so that two of them would fail one run in three.
ERRORS = 4.0
#: Runs of the source where it states none: those of its appendix B, the only number before its chapter 7 besides 60.
SOURCE_RUNS = 100


def deviation(
    name: str,
    expected: float,
    ours: float,
    runs: int,
    *,
    theirs: int = 0,
    unit: str = "",
    reference: Reference = "corrected",
    also: float = 0.0,
    source: str = "",
) -> Cell:
    """A standard deviation over runs beside a number.

    Parameters
    ----------
    name : str
    expected : float
        To be met, in ``unit``.
    ours : float
    runs, theirs : int
        Number of our runs, and of those behind the printed number; zero if it is no estimate.
    unit, reference : str
    also : float
        Further relative tolerance, of discretisation or printed digits.
    source : str
        What the thesis prints.
    """
    error = sqrt(0.5 / (runs - 1) + (0.5 / (theirs - 1) if theirs else 0.0))
    return against(
        name, expected, ours, relative=ERRORS * error + also, unit=unit, reference=reference, source=source
    )  # fmt: skip


def share(name: str, claim: str, ours: float, n: int, *, least: float) -> Cell:
    """A share of n logs that is to be ``least`` or more, less four standard errors of a binomial number."""
    low = least - ERRORS * sqrt(least * (1.0 - least) / n)
    return claimed(name, claim, ours, low=low, tolerance="statistical")


def read_off(name: str, printed: str, ours: float, unit: str) -> Cell:
    """A standard deviation that the text reads off a chart of runs.

    The band is half a unit of the last digit stated, and four standard errors of :data:`SOURCE_RUNS` runs.
    """
    value = float(printed)
    half = 0.5 * 10.0 ** -len(printed.partition(".")[2])
    return against(
        name, value, ours, absolute=half, relative=ERRORS / sqrt(2.0 * (SOURCE_RUNS - 1)), unit=unit, tolerance="read",
        source=f"about {printed}",
    )  # fmt: skip


def about(name: str, printed: str, ours: float, unit: str = "") -> Cell:
    """A round number of the text or read off a curve: within half a unit of its last digit that is not zero.

    ``about 550`` is 545 to 555, ``about 600`` 550 to 650.
    """
    whole, _, places = printed.partition(".")
    unit_of_last = 10.0 ** -len(places) if places else 10.0 ** (len(whole) - len(whole.rstrip("0")))
    return against(
        name, float(printed), ours, absolute=0.5 * unit_of_last, unit=unit, tolerance="read", source=f"about {printed}"
    )  # fmt: skip
