"""How well a platform at rest and turning can calibrate gyroscopes of a given noise, before anything is measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.exceptions import InputError

_TURN = 2.0 * np.pi


@dataclass(frozen=True)
class CalibrationAccuracy:
    """1-sigma of what a rest and a rotation about one axis tell, from white noise alone; each axis of the gyroscopes.

    Attributes
    ----------
    rate : float
        Of the rotation. [rad/s]
    rest_s, turning_s : float
        [s]
    bias : float
        ``ARW / sqrt(T_rest)``, (3.48). [rad/s]
    response : float
        Scale factor and installation errors: ``ARW / rate * sqrt(1 / T_turning + 1 / T_rest)``. [-]
    response_source : float
        (3.49) as the thesis has it, without the noise of the bias that is subtracted: ``sqrt(2)`` too small for equal
        times. [-]
    at_rate : float
        Bias left at this rate once both are compensated: that of the mean while turning, because what is applied,
        bias plus response times rate, is that mean. [rad/s]
    """

    rate: float
    rest_s: float
    turning_s: float
    bias: float
    response: float
    response_source: float
    at_rate: float


def predicted_accuracy(
    random_walk: float, rate: float, *, rest_s: float = 60.0, turning_s: float = 60.0
) -> CalibrationAccuracy:
    """Predict the accuracy of a calibration by rotation.

    Parameters
    ----------
    random_walk : float
        Angle random walk of the gyroscopes. [rad/sqrt(s)]
    rate : float
        Of the rotation; the sign does not matter. [rad/s]
    rest_s, turning_s : float
        Times at rest and turning. [s]

    Returns
    -------
    CalibrationAccuracy

    Raises
    ------
    InputError
        If the noise is negative, or a time or the rate is not positive.

    References
    ----------
    Du (2015), eqs. (3.48), (3.49); the latter corrected.
    """
    if not (random_walk >= 0.0 and np.isfinite(random_walk)):
        raise InputError(f"random_walk: expected a number of zero or more, got {random_walk!r}")
    for name, value in (("rate", abs(rate)), ("rest_s", rest_s), ("turning_s", turning_s)):
        if not (value > 0.0 and np.isfinite(value)):
            raise InputError(f"{name}: expected a finite number other than zero, times positive, got {value!r}")
    w = abs(rate)
    return CalibrationAccuracy(
        rate,
        rest_s,
        turning_s,
        bias=random_walk / float(np.sqrt(rest_s)),
        response=random_walk / w * float(np.sqrt(1.0 / turning_s + 1.0 / rest_s)),
        response_source=random_walk / w / float(np.sqrt(turning_s)),
        at_rate=random_walk / float(np.sqrt(turning_s)),
    )


def whole_turns(rate: float, at_least: float) -> float:
    """Shortest time of whole revolutions at ``rate`` [rad/s] that is at least so long. [s]"""
    if not (np.isfinite(rate) and rate != 0.0 and at_least > 0.0):
        raise InputError(f"expected a rate other than zero and a positive time, got {rate!r} rad/s, {at_least!r} s")
    turn = _TURN / abs(rate)
    return float(np.ceil(at_least / turn - 1e-9)) * turn
