"""1-sigma of a clock shift that a proposal makes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from schuler import frames
from schuler.diagnosis.result import Diagnosis
from schuler.proposal.decision import Decision
from schuler.recording.recording import Recording

_ARM_M = 0.5  # 1-sigma of a lever arm along the track, which looks like a shift at constant speed
_SLOWEST_M_S, _CHORD_S = 5.0, 5.0  # of a speed (what is slower is smaller), and over which it is taken

#: Entries of a shift and of its 1-sigma.
SHIFT, SIGMA = "imu.clock_shift_s", "imu.clock_shift_sigma_s"


def uncertainty_of_shift(recording: Recording, diagnosis: Diagnosis, data: Mapping[str, Any]) -> Decision | None:
    """How uncertain a shift of the IMU's clock is that motions tell; None where it needs no estimate.

    Parameters
    ----------
    recording : Recording
        As it is to be navigated.
    diagnosis : Diagnosis
        Of it.
    data : mapping
        Configuration with the shift.

    Notes
    -----
    The diagnosis compares motions and knows no lever arm: half a metre ahead is 0.05 s at 10 m/s. A lever arm that a
    run with a fixed shift estimates takes in what the shift is off, with a sigma that leaves that out; so the run that
    estimates one estimates the rest of the shift, too.
    """
    sigma = diagnosis.estimates.get("time_offset_sigma_s")
    gnss = data.get("gnss", {})
    stated = {"delay_sigma_s", "lever_arm_m", "lever_sigma_m"} & set(gnss)
    loose = recording.gnss is not None and gnss.get("coupling", "loose") == "loose"
    if sigma is None or stated or not loose:
        return None
    value = round(float(np.hypot(sigma, _ARM_M / _speed(recording))), 3)
    text = f"turns and accelerations tell it to {sigma:.3f} s, and an antenna {_ARM_M:g} m ahead looks like a shift"
    return Decision(SIGMA, value, text)


def _speed(recording: Recording) -> float:
    """Root of the mean square of the speed between fixes some seconds apart. [m/s]"""
    gnss = recording.need_gnss()
    k = np.unique(np.searchsorted(gnss.t, np.arange(gnss.t[0], gnss.t[-1], _CHORD_S)))
    chord = np.linalg.norm(np.diff(frames.ecef_from_llh(gnss.llh[k]), axis=0), axis=1)
    return float(max(np.sqrt(np.mean((chord / np.diff(gnss.t[k])) ** 2)), _SLOWEST_M_S)) if len(k) > 1 else _SLOWEST_M_S
