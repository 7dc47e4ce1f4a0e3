"""Lever arm of an antenna that nobody stated: estimated where the fixes of a log show that it is not zero."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler.filtering.engine import unpack_symmetric
from schuler.navigation.config import NavigationConfig
from schuler.navigation.prepared import PreparedRun
from schuler.navigation.tuning.tuning import likelier

_SIGMA_M = 0.5  # of an antenna on the same vehicle
_APART = 50.0  # normalised square of an estimate that is not zero: chi-square of three degrees of freedom, 7 sigma

#: Note on a run that estimates it.
LEVER_ESTIMATED = (
    "the lever arm from the IMU to the antenna is not stated, and the fixes show that it is not zero: it is estimated; "
    "measure it and state gnss.lever_arm_m"
)


def with_lever(config: NavigationConfig) -> NavigationConfig:
    """The configuration with a lever arm that is estimated."""
    return config.model_copy(update={"gnss": config.gnss.model_copy(update={"lever_sigma_m": _SIGMA_M})})


def has_lever(prepared: PreparedRun, free: PreparedRun) -> bool:
    """Whether a log shows that its antenna is not at the IMU.

    Parameters
    ----------
    prepared : PreparedRun
        Without a lever arm, its noise tuned.
    free : PreparedRun
        The same with one that is estimated.

    Notes
    -----
    Two conditions: fixes held back are likelier with it (:func:`~schuler.navigation.tuning.tuning.likelier`), and the
    estimate at the end is far from zero for its covariance. Errors of scale of a poor IMU meet the first, never both.
    """
    if not likelier(prepared, free):
        return False
    forward, part = replace(free, options=replace(free.options, smoother=False)).run(), free.layout["lever"]
    lever = forward.rec_est[-1, part.start - 9 : part.stop - 9]
    P = unpack_symmetric(forward.rec_P[-1:], free.layout.size)[0, part, part]
    return bool(lever @ np.linalg.solve(P, lever) > _APART)
