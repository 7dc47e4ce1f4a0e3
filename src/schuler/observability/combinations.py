"""What is seen and what is not, written as physics: sparse combinations of states with recognised factors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from itertools import product

import numpy as np

from schuler.arrays import FloatArray
from schuler.observability.ranks import Spectrum
from schuler.plotting.notebook import Abridged

_Writer = Callable[[FloatArray, int, tuple[str, ...], Mapping[str, float]], str]
_SMALLEST = 1e-7  # parts of a combination below this, in units of the prior, are noise of the elimination
_ABOUT = 1e-2  # the same where directions that are weakly seen are left out: the rest is known so well
_RECOGNISED = 3e-6  # relative
_FRACTIONS = tuple(Fraction(a, b) for a, b in ((1, 1), (2, 1), (1, 2), (3, 1), (1, 3), (3, 2), (2, 3), (4, 1), (1, 4)))
#: Which states come first in a combination that is seen; of an unseen one the other way round.
_ORDER = ("dv", "dr", "b_a", "b", "b_g", "d")


@dataclass(frozen=True, repr=False)
class Combination(Abridged):
    """A combination of states.

    Attributes
    ----------
    coefficients : ndarray, shape (n,)
        Factors of the states in SI. Seen: ``coefficients @ x`` is known. Unseen: ``x`` along ``coefficients`` changes
        nothing that is measured.
    text : str
    """

    coefficients: FloatArray
    text: str


def seen(spectrum: Spectrum, constants: Mapping[str, float], *, which: str = "formal") -> list[Combination]:
    """A sparse basis of what the measurements determine.

    Parameters
    ----------
    spectrum : Spectrum
    constants : mapping of str to float
        Names and values that factors may be made of, such as ``{"g": 9.81, "w": 0.17}``; see :func:`recognised`.
    which : {"formal", "rank", "useful"}
        Which directions count as seen. Where weak ones are left out, parts below a hundredth of a prior 1-sigma are
        left out of the combinations too: they are then approximate.

    Returns
    -------
    list of Combination
        As many as the rank, single states first; each has a state that no other has, with factor 1. Velocity and
        biases are preferred for it, so that tilts and heading are written as their partners.
    """
    r = spectrum.chosen(which)
    rows = _echelon(spectrum.directions[:r], _groups(spectrum.names, reverse=False), _smallest(spectrum, r))
    return _texts(rows / spectrum.sigma, rows, spectrum.names, constants, _sum)


def unseen(spectrum: Spectrum, constants: Mapping[str, float], *, which: str = "formal") -> list[Combination]:
    """A sparse basis of the errors that leave no trace in the measurements; arguments as of :func:`seen`.

    Each is written as one state with the values of the others that hide it.
    """
    r = spectrum.chosen(which)
    rows = _echelon(spectrum.directions[r:], _groups(spectrum.names, reverse=True), _smallest(spectrum, r))
    return _texts(rows * spectrum.sigma, rows, spectrum.names, constants, _together)


def recognised(value: float, constants: Mapping[str, float]) -> str:
    """A number as a product of known constants and a simple fraction, or with four digits.

    Parameters
    ----------
    value : float
    constants : mapping of str to float
        Names to positive values; each may stand with a power of -2 to 2, two different ones at most.

    Examples
    --------
    >>> recognised(-19.62, {"g": 9.81})
    '-2 g'
    """
    if not np.isfinite(value) or value == 0.0:
        return f"{value:g}"
    sign = "-" if value < 0.0 else ""
    for text, number in _products(constants):
        for q in _FRACTIONS:
            if abs(abs(value) / (number * float(q)) - 1.0) < _RECOGNISED:
                factor = "" if q == 1 and text else str(q)
                return f"{sign}{factor}{' ' if factor and text else ''}{text}"
    return f"{value:.4g}"


def _products(constants: Mapping[str, float]) -> list[tuple[str, float]]:
    """Products of at most two constants, simplest first."""
    usable = {name: v for name, v in constants.items() if v > 0.0}
    products = [("", 1.0, 0)]
    powers = (1, -1, 2, -2)
    for name, v in usable.items():
        products += [(_power(name, p), v**p, 1 + abs(p)) for p in powers]
    names = list(usable)
    for i, j in product(range(len(names)), repeat=2):
        if i < j:
            for p, q in product(powers, repeat=2):
                a, b = (i, p), (j, q)
                up = [_power(names[k], e) for k, e in (a, b) if e > 0]
                down = [_power(names[k], -e) for k, e in (a, b) if e < 0]
                if up:
                    below = f" / ({' '.join(down)})" if len(down) > 1 else f" / {down[0]}" if down else ""
                    text = " ".join(up) + below
                else:
                    text = f"1 / ({' '.join(down)})"
                products.append((text, usable[names[i]] ** p * usable[names[j]] ** q, 3 + abs(p) + abs(q)))
    return [(text, v) for text, v, _ in sorted(products, key=lambda item: item[2])]


def _power(name: str, p: int) -> str:
    word = f"({name})" if " " in name and abs(p) > 1 else name
    text = word if abs(p) == 1 else f"{word}^{abs(p)}"
    return text if p > 0 else f"1 / {text if ' ' not in text else f'({text})'}"


def _smallest(spectrum: Spectrum, r: int) -> float:
    return max(_SMALLEST, spectrum.blur(r)) if r == spectrum.formal else _ABOUT


def _groups(names: tuple[str, ...], *, reverse: bool) -> list[list[int]]:
    """Places of states in the order in which they are taken out of the others."""
    of = [name.rpartition("_")[0] or name for name in names]
    place = {block: k for k, block in enumerate(_ORDER)}
    key = [place.get(block, len(_ORDER) + (block == "eps")) for block in of]
    groups = [[i for i in range(len(names)) if key[i] == k] for k in sorted(set(key))]
    return groups[::-1] if reverse else groups


def _echelon(rows: FloatArray, groups: list[list[int]], smallest: float) -> FloatArray:
    """Reduced echelon form with the largest pivot of each group, groups one after the other."""
    M = np.array(rows)
    if not len(M):
        return M
    pivots: list[tuple[int, int]] = []
    free = list(range(len(M)))
    for group in groups:
        columns = list(group)
        while free and columns:
            part = np.abs(M[np.ix_(free, columns)])
            i, j = np.unravel_index(int(np.argmax(part)), part.shape)
            if part[i, j] <= smallest:
                break
            row, column = free.pop(int(i)), columns.pop(int(j))
            M[row] /= M[row, column]
            others = [k for k in range(len(M)) if k != row]
            M[others] -= np.outer(M[others, column], M[row])
            pivots.append((column, row))
    M = M[[row for _, row in sorted(pivots)]]
    M[np.abs(M) < smallest * np.abs(M).max(axis=1, keepdims=True)] = 0.0
    return M


def _texts(
    physical: FloatArray, scaled: FloatArray, names: tuple[str, ...], constants: Mapping[str, float], write: _Writer
) -> list[Combination]:
    out = []
    pivots = _own(scaled)
    for row, pivot in zip(physical, pivots, strict=True):
        row = row / row[pivot]
        out.append((int(np.count_nonzero(row)) > 1, pivot, Combination(row, write(row, pivot, names, constants))))
    return [c for *_, c in sorted(out, key=lambda item: item[:2])]


def _own(rows: FloatArray) -> list[int]:
    """For each row a state that no other row has."""
    counts = np.count_nonzero(rows, axis=0)
    return [int(np.flatnonzero((row == 1.0) & (counts == 1))[0]) for row in rows]


def _sum(row: FloatArray, pivot: int, names: tuple[str, ...], constants: Mapping[str, float]) -> str:
    """``b_E + g eps_N``."""
    text = names[pivot]
    for i in np.flatnonzero(row):
        if i != pivot:
            factor = recognised(float(row[i]), constants)
            sign, factor = ("-", factor[1:]) if factor.startswith("-") else ("+", factor)
            text += f" {sign} {'' if factor == '1' else factor + ' '}{names[i]}"
    return text


def _together(row: FloatArray, pivot: int, names: tuple[str, ...], constants: Mapping[str, float]) -> str:
    """``eps_N with b_E = -g eps_N``."""
    others = []
    for i in np.flatnonzero(row):
        if i != pivot:
            factor = recognised(float(row[i]), constants)
            factor = {"1": "", "-1": "-"}.get(factor, factor + " ")
            others.append(f"{names[i]} = {factor}{names[pivot]}")
    return names[pivot] + (f" with {', '.join(others)}" if others else "")
