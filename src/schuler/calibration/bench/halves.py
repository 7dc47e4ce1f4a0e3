"""Law of halves of bench methods: both halves of each rest, and odd against even poses, calibrated by themselves."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from schuler.arrays import IntArray
from schuler.calibration.bench.poses import Poses
from schuler.calibration.result.halves import checked, halves_of, tried
from schuler.calibration.result.result import CalibrationResult


def halved(
    result: CalibrationResult,
    poses: Poses,
    calibrate: Callable[[Poses, IntArray], CalibrationResult],
    *,
    shared: Sequence[str] = (),
) -> CalibrationResult:
    """A result with its claims held against halves of its poses.

    Parameters
    ----------
    result : CalibrationResult
    poses : Poses
        As the method was given them.
    calibrate : callable
        The method, of some poses and their places among all.
    shared : sequence of str
        Blocks that come from readings both halves share, not compared.

    Returns
    -------
    CalibrationResult
        See :func:`schuler.calibration.result.halves.checked`.
    """
    every = np.arange(len(poses))
    pairs = {
        name: tried(lambda k: calibrate(poses.of(k), k), (every[a], every[b]))
        for name, (a, b) in halves_of(len(poses)).items()
    }
    if poses.parts is not None:
        pairs["both halves of each rest"] = tried(lambda part: calibrate(part, every), poses.parts)
    causes = ("the biases changed between the poses: temperature, drift, or the unit was not put down alike",)
    return checked(
        result, pairs, causes=causes, needs="not compared: it takes rests of 40 samples or more", skip=shared
    )
