"""Code biases of satellites: by how much their signals are late against their clocks, or against each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.gnss.signals import BANDS, GLONASS_BANDS, SYSTEMS

#: Pairs of signals without whose ionosphere precise clocks are, by system, where a file of biases states no other.
CLOCK_PAIRS: Mapping[str, tuple[tuple[str, str], ...]] = MappingProxyType(
    {
        "G": (("1W", "2W"),),
        "R": (("1P", "2P"),),
        "E": (("1C", "5Q"), ("1X", "5X")),
        "C": (("2I", "6I"), ("2X", "6X")),
        "J": (("1C", "2L"), ("1X", "2X")),
    }
)
#: Signals that the messages' group delays are those of, by system and band; the first one that a file has counts.
DELAYED: Mapping[str, Mapping[int, tuple[str, ...]]] = MappingProxyType(
    {
        "G": {1: ("1W", "1P"), 2: ("2W", "2P"), 5: ("5Q", "5X")},
        "R": {1: ("1P",), 2: ("2P",)},
        "E": {1: ("1C", "1X"), 5: ("5Q", "5X"), 7: ("7Q", "7X"), 8: ("8Q", "8X")},
        "C": {2: ("2I", "2X"), 6: ("6I", "6X"), 7: ("7I", "7D"), 1: ("1P", "1X"), 5: ("5P", "5X")},
        "J": {1: ("1C", "1X"), 2: ("2L", "2X"), 5: ("5Q", "5X")},
    }
)
_LAST_BAND = 9


@dataclass(frozen=True)
class CodeBiases:
    """Biases of pseudoranges, one row a satellite, signal (or two) and time.

    Attributes
    ----------
    sat : ndarray of int, shape (n,)
    signal : tuple of str, length n
        RINEX band and attribute, such as ``1C``.
    begin, end : ndarray, shape (n,)
        GPS time in which it holds. [s]
    bias : ndarray, shape (n,)
        To be subtracted from what is measured, beside clocks of the same analysis centre; or that of ``signal`` less
        that of ``against``. [s]
    against : tuple of str, length n, optional
        Signal that the bias is relative to; empty where it is absolute, as all are by default.
    pairs : tuple of (str, str, str)
        Letter of a system, and the two signals without whose ionosphere the clocks are, as the file states.
    """

    sat: IntArray
    signal: tuple[str, ...]
    begin: FloatArray
    end: FloatArray
    bias: FloatArray
    against: tuple[str, ...] = ()
    pairs: tuple[tuple[str, str, str], ...] = ()

    def __post_init__(self) -> None:
        if not self.against:
            object.__setattr__(self, "against", ("",) * len(self.bias))
        for name in ("sat", "signal", "begin", "end", "against"):
            if len(getattr(self, name)) != len(self.bias):
                raise InputError(f"CodeBiases.{name}: expected {len(self.bias)} rows, got {len(getattr(self, name))}")

    def merged_with(self, other: CodeBiases) -> CodeBiases:
        """Rows of both; where both have a bias this one's counts."""
        a, b = self, other
        return CodeBiases(
            np.concatenate((a.sat, b.sat)), a.signal + b.signal, np.concatenate((a.begin, b.begin)),
            np.concatenate((a.end, b.end)), np.concatenate((a.bias, b.bias)), a.against + b.against, a.pairs + b.pairs,
        )  # fmt: skip


def biases_at(biases: CodeBiases, sat: IntArray, signal: npt.NDArray[np.str_], gps_s: FloatArray) -> FloatArray:
    """Absolute bias of each row's signal, NaN where there is none. Shapes (n,), (n,), (n,) to (n,). [s]"""
    out = np.full(len(sat), np.nan)
    for k in range(len(biases.bias) - 1, -1, -1):  # the first one counts
        if biases.against[k]:
            continue
        rows = (sat == biases.sat[k]) & (signal == biases.signal[k])
        out[rows & (gps_s >= biases.begin[k]) & (gps_s <= biases.end[k])] = biases.bias[k]
    return out


class RelativeBiases(NamedTuple):
    """Biases of n signals that follow from differences; NaN where differences do not lead there."""

    to_clock: FloatArray
    """Against precise clocks, shape (n,). [s]"""
    to_band: FloatArray
    """Less that of the signal of each RINEX band whose group delay is broadcast, shape (n, 10). [s]"""


def relative_biases_at(
    biases: CodeBiases, sat: IntArray, signal: npt.NDArray[np.str_], gps_s: FloatArray
) -> RelativeBiases:
    """What differences of biases say of signals, over as many of them as it takes (1C to 1W to 2W).

    Parameters
    ----------
    biases : CodeBiases
    sat : ndarray of int, shape (n,)
    signal : ndarray of str, shape (n,)
        RINEX band and attribute.
    gps_s : ndarray, shape (n,)

    Notes
    -----
    A clock without ionosphere of the signals i and k is late by nothing for ``a B_i + (1 - a) B_k``, with
    ``a = f_i^2 / (f_i^2 - f_k^2)``; so the bias of a signal s is ``(B_s - B_i) + (1 - a) (B_i - B_k)``. Differences
    that close a circle are adjusted by least squares.

    References
    ----------
    Schaer (2016), SINEX_BIAS 1.00; Teunissen and Montenbruck (2017), section 19.6.1.
    """
    out = RelativeBiases(np.full(len(sat), np.nan), np.full((len(sat), _LAST_BAND + 1), np.nan))
    relative = np.array([bool(x) for x in biases.against], dtype=bool)
    for one in np.unique(biases.sat[relative]):
        rows, at = np.flatnonzero(relative & (biases.sat == one)), np.flatnonzero(sat == one)
        edges = np.unique((biases.begin[rows], biases.end[rows]))
        at = at[(gps_s[at] >= edges[0]) & (gps_s[at] <= edges[-1])]
        part = np.minimum(np.searchsorted(edges, gps_s[at], side="right") - 1, len(edges) - 2)
        for k in np.unique(part):
            now = rows[(biases.begin[rows] <= edges[k]) & (biases.end[rows] >= edges[k + 1])]
            differences = dict[tuple[str, str], float]()
            for i in now:  # the first one counts, either way round
                first, second = biases.signal[i], biases.against[i]
                if (second, first) not in differences:
                    differences.setdefault((first, second), float(biases.bias[i]))
            _put(out, at[part == k], signal, SYSTEMS[one // 100], _connected(differences), biases.pairs)
    return out


def _put(
    out: RelativeBiases, at: IntArray, signal: npt.NDArray[np.str_], letter: str, parts: list[dict[str, float]],
    stated: tuple[tuple[str, str, str], ...],
) -> None:  # fmt: skip
    """Biases of one satellite at one time: a level for each signal of each part."""
    pairs = [(first, second) for system, first, second in stated if system == letter]
    for level in parts:
        clock = next((_ionosphere_free(level, letter, *p) for p in [*pairs, *CLOCK_PAIRS.get(letter, ())]
                      if p[0] in level and p[1] in level), np.nan)  # fmt: skip
        bands = np.full(_LAST_BAND + 1, np.nan)
        for band, names in DELAYED.get(letter, {}).items():
            bands[band] = next((level[x] for x in names if x in level), np.nan)
        for name in level:
            mine = at[signal[at] == name]
            out.to_clock[mine], out.to_band[mine] = level[name] - clock, level[name] - bands


def _ionosphere_free(level: dict[str, float], letter: str, first: str, second: str) -> float:
    f1, f2 = (
        GLONASS_BANDS[x[0]][0] if letter == "R" and x[0] in GLONASS_BANDS else BANDS[(letter, x[0])]
        for x in (first, second)
    )
    share = f1**2 / (f1**2 - f2**2)
    return share * level[first] + (1.0 - share) * level[second]


def _connected(differences: dict[tuple[str, str], float]) -> list[dict[str, float]]:
    """Level of every signal, up to a constant for each part that no difference leads out of."""
    names = sorted({x for pair in differences for x in pair})
    design = np.zeros((len(differences), len(names)))
    for row, (a, b) in zip(design, differences, strict=True):
        row[names.index(a)], row[names.index(b)] = 1.0, -1.0
    level = np.linalg.lstsq(design, np.array(list(differences.values())), rcond=None)[0]
    part = {name: {name} for name in names}
    for a, b in differences:
        joined = part[a] | part[b]
        part |= dict.fromkeys(joined, joined)
    distinct = {id(x): x for x in part.values()}.values()
    return [{name: float(level[names.index(name)]) for name in sorted(x)} for x in distinct]
