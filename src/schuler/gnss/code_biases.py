"""Code biases of satellites: by how much each of their signals is late against their precise clocks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import InputError


@dataclass(frozen=True)
class CodeBiases:
    """Biases of pseudoranges, one row a satellite, signal and time.

    Attributes
    ----------
    sat : ndarray of int, shape (n,)
    signal : tuple of str, length n
        RINEX band and attribute, such as ``1C``.
    begin, end : ndarray, shape (n,)
        GPS time in which it holds. [s]
    bias : ndarray, shape (n,)
        To be subtracted from what is measured, beside clocks of the same analysis centre. [s]
    """

    sat: IntArray
    signal: tuple[str, ...]
    begin: FloatArray
    end: FloatArray
    bias: FloatArray

    def __post_init__(self) -> None:
        for name in ("sat", "signal", "begin", "end"):
            if len(getattr(self, name)) != len(self.bias):
                raise InputError(f"CodeBiases.{name}: expected {len(self.bias)} rows, got {len(getattr(self, name))}")

    def merged_with(self, other: CodeBiases) -> CodeBiases:
        """Rows of both; where both have a bias this one's counts."""
        a, b = self, other
        return CodeBiases(
            np.concatenate((a.sat, b.sat)), a.signal + b.signal, np.concatenate((a.begin, b.begin)),
            np.concatenate((a.end, b.end)), np.concatenate((a.bias, b.bias)),
        )  # fmt: skip


def biases_at(biases: CodeBiases, sat: IntArray, signal: npt.NDArray[np.str_], gps_s: FloatArray) -> FloatArray:
    """Bias of each row's signal, NaN where there is none. Shapes (n,), (n,), (n,) to (n,). [s]"""
    out = np.full(len(sat), np.nan)
    for k in range(len(biases.bias) - 1, -1, -1):  # the first one counts
        rows = (sat == biases.sat[k]) & (signal == biases.signal[k])
        out[rows & (gps_s >= biases.begin[k]) & (gps_s <= biases.end[k])] = biases.bias[k]
    return out
