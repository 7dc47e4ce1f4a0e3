"""Bands of the cells of this thesis: few runs of hardware against many of ours."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.exceptions import InputError
from schuler.reproduce.cells import Cell, Reference, against, claimed

#: Standard errors of a statistical band: among 300 cells one is outside by chance.
ERRORS = 3.0


def against_runs(
    name: str,
    printed: float,
    values: ArrayLike,
    *,
    of: int = 1,
    own: Sequence[float] = (),
    unit: str = "",
    digit: float = 0.0,
    reference: Reference = "thesis",
    source: str | None = None,
) -> Cell:
    """The thesis's mean of few runs against the mean of ours, three standard errors of both.

    Parameters
    ----------
    name : str
    printed : float
    values : array_like, shape (n,)
        Values of our runs, in the unit.
    of : int
        Runs of the thesis behind the number.
    own : sequence of float
        Each of them, for their scatter; without, that of ours is taken.
    unit : str
    digit : float
        A unit of the last digit printed; half of it is added to the band.
    reference, source : str
        See :func:`schuler.reproduce.cells.against`.

    Notes
    -----
    For biases, of either sign. Of RMS values see :func:`against_rms`.
    """
    x = np.asarray(values, dtype=np.float64)
    half = _both(x, own, of) + 0.5 * digit
    return against(name, printed, float(np.mean(x)), absolute=half, unit=unit, reference=reference, source=source)


def against_rms(
    name: str,
    printed: float,
    values: ArrayLike,
    *,
    of: int = 1,
    own: Sequence[float] = (),
    unit: str = "",
    digit: float = 0.0,
    reference: Reference = "thesis",
    source: str | None = None,
) -> Cell:
    """Cell as :func:`against_runs` for RMS errors, which scatter by a factor: errors of their logarithms."""
    x = np.asarray(values, dtype=np.float64)
    factor = float(np.exp(_both(np.log(x), np.log(own) if len(own) else (), of)))
    text = f"{printed:g}" if source is None else source
    low, high = (printed - 0.5 * digit) / factor, (printed + 0.5 * digit) * factor
    return Cell(name, float(np.mean(x)), unit, text, low, high, "statistical", reference)


def _both(x: FloatArray, own: ArrayLike, of: int) -> float:
    """Three standard errors of the difference of two means."""
    theirs = np.asarray(own, dtype=np.float64)
    ours = float(np.var(x, ddof=1))
    runs, scatter = (len(theirs), float(np.var(theirs, ddof=1))) if len(theirs) > 1 else (of, ours)
    return ERRORS * float(np.sqrt(scatter / runs + ours / len(x)))


def emulated(name: str, low: float, high: float, values: ArrayLike, *, unit: str = "") -> Cell:
    """An independent emulation of 200 runs: its 10 % and three standard errors of the means of both.

    Parameters
    ----------
    name : str
    low, high : float
        Its mean, or the ends of its range.
    values : array_like, shape (n,)
    unit : str
    """
    x = np.asarray(values, dtype=np.float64)
    half = ERRORS * float(np.std(x, ddof=1)) * float(np.sqrt(1.0 / 200.0 + 1.0 / len(x)))
    text = f"{low:g}" if low == high else f"{low:g} to {high:g}"
    return Cell(
        name, float(np.mean(x)), unit, f"independent emulation: {text}", 0.9 * low - half, 1.1 * high + half,
        "statistical", "corrected",
    )  # fmt: skip


def below(name: str, claim: str, values: ArrayLike, high: float = 1.0) -> Cell:
    """A ratio that is claimed to be below a number: its mean less three standard errors has to be.

    Parameters
    ----------
    name, claim : str
    values : array_like, shape (n,)
        The ratio of every run, or one number.
    high : float
    """
    x = np.atleast_1d(np.asarray(values, dtype=np.float64))
    error = ERRORS * float(np.std(x, ddof=1)) / float(np.sqrt(len(x))) if len(x) > 1 else 0.0
    return claimed(name, claim, float(np.mean(x)), high=high + error, tolerance="statistical" if error else "band")


def period(name: str, expected: float, t: ArrayLike, x: ArrayLike) -> Cell:
    """The period of the strongest swing of an error, which is said to be that of the rotation: half a bin."""
    from schuler.reproduce.du.study.metrics import swing_period

    t = np.asarray(t, dtype=np.float64)
    half = expected**2 / (2.0 * float(t[-1] - t[0]))
    return against(
        name, expected, swing_period(t, x), absolute=half, unit="s", tolerance="discretisation",
        source="the period of the rotation",
    )  # fmt: skip


@contextmanager
def interruptible() -> Iterator[None]:
    """Turn what campaigns say when they are interrupted too early back into the interruption."""
    try:
        yield
    except InputError as error:
        if "interrupted" in str(error):
            raise KeyboardInterrupt from error
        raise
