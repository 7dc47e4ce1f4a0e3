"""Choices that stretches with withheld fixes decide: what does not predict these better is left as it was."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import SchulerError
from schuler.navigation.config import NavigationConfig
from schuler.navigation.evaluation.errors import outage_errors
from schuler.navigation.run import navigate
from schuler.recording.recording import Recording
from schuler.recording.series import GnssSeries
from schuler.recording.trajectory import Trajectory
from schuler.toml import merged

_WITHHELD_S = 10.0
_PERIOD = 3.0  # of withheld stretches, in their lengths
_MANY = 12  # stretches that a shorter log is cut into, shorter ones
_LONGEST_S = 900.0  # of the log is navigated to compare
_GAP = 5.0  # median intervals of fixes that are a gap, in which nothing judges
_FEWEST = 6  # stretches that say something


@dataclass(frozen=True)
class Judgement:
    """Errors at the end of withheld stretches.

    Attributes
    ----------
    ends : ndarray, shape (n,)
        Horizontal, no less than the fixes' own 1-sigma. [m]
    length_s : float
        Of a stretch. [s]
    """

    ends: FloatArray
    length_s: float

    @property
    def median(self) -> float:
        """Median of the errors. [m]"""
        return float(np.median(self.ends))

    def better_than(self, other: Judgement, least: float) -> bool:
        """Whether errors are smaller than others, stretch by stretch and beyond chance.

        Parameters
        ----------
        other : Judgement
        least : float
            Standard errors by which the mean logarithm of their ratio must be below zero; above it, if negative.
        """
        n = min(len(self.ends), len(other.ends))
        if n < _FEWEST or len(self.ends) != len(other.ends):
            return False
        ratio = np.log(self.ends / other.ends)
        smaller = least < 0.0 or self.median < other.median
        return bool(smaller and ratio.mean() < -least * ratio.std(ddof=1) / np.sqrt(n))


def judged(recording: Recording, data: Mapping[str, Any]) -> Judgement | None:
    """Errors of ten seconds without fixes, twice a minute, shorter and more often in a log of minutes.

    Noise is that of the configuration, not tuned.

    Parameters
    ----------
    recording : Recording
    data : mapping
        Nested entries of the configuration.

    Returns
    -------
    Judgement
        None if the log is too short, or cannot be navigated so.
    """
    gnss = recording.gnss
    if gnss is None or not len(gnss):
        return None
    stop = min(recording.stop, recording.start + _LONGEST_S)
    step = np.diff(gnss.t[gnss.t <= stop])
    covered = float(np.sum(step[step <= _GAP * np.median(step)])) if len(step) else 0.0
    for span in (stop - recording.start, covered):  # in a log with long pauses of fixes stretches are shorter, too
        outcome = _judged(recording, gnss, data, stop, min(_WITHHELD_S, span / (_MANY * _PERIOD)))
        if outcome is None or len(outcome.ends) >= _FEWEST:
            return outcome
    return None


def _judged(
    recording: Recording, gnss: GnssSeries, data: Mapping[str, Any], stop: float, length: float
) -> Judgement | None:
    """Errors of as many stretches of one length as there are until a time; None if the log cannot be navigated so."""
    if length <= 0.0:
        return None
    cut = replace(recording, imu=recording.need_imu().between(recording.start, stop), gnss=gnss.where(gnss.t <= stop))
    coarse = {"tune": False, "smooth": False, "output_rate_hz": 10.0}
    withheld = {"every_s": _PERIOD * length, "length_s": length}
    try:
        config = NavigationConfig.parse(merged(data, {"outages": withheld, "filter": coarse}))
        result = navigate(cut, config)
        reference = Trajectory.from_geodetic(gnss.t, gnss.llh, gnss.v_n)
        errors = outage_errors(result.errors(reference, at_antenna=True), result.outages)
    except SchulerError:
        return None
    floor = float(np.sqrt(np.median(np.trace(gnss.cov_r_n[:, :2, :2], axis1=1, axis2=2) / 2.0)))
    return Judgement(np.hypot([e.end_horizontal for e in errors], floor), length)
