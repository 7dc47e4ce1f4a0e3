"""Angle random walk of gyroscopes from their own log: of differences of samples, or of the Allan deviation at rest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.recording.series import Increments

_LEAST = 20  # differences of the Allan deviation at its averaging time, that do not overlap


def differenced_random_walk(increments: Increments, spans: Sequence[tuple[float, float]]) -> FloatArray:
    """Angle random walk from differences of consecutive samples within spans, at rest or turning evenly.

    Parameters
    ----------
    increments : Increments
        IMU axes.
    spans : sequence of (float, float)
        [s]

    Returns
    -------
    ndarray, shape (3,)
        [rad/sqrt(s)]

    Notes
    -----
    Right for white noise. A filter in the sensor that makes samples resemble each other makes it too small; then use
    :func:`allan_random_walk`.
    """
    squares, count = np.zeros(3), 0
    for start, stop in spans:
        part = increments.between(start, stop)
        rate = part.dtheta_ib_b / part.dt[:, None]
        squares += np.sum(0.5 * np.diff(rate, axis=0) ** 2 * part.dt[1:, None], axis=0)
        count += len(part) - 1
    return np.asarray(np.sqrt(squares / max(count, 1)))


def allan_random_walk(increments: Increments, span: tuple[float, float], *, tau_s: float = 1.0) -> FloatArray:
    """Angle random walk from the Allan deviation of a rest, ``sigma(tau) sqrt(tau)``.

    Parameters
    ----------
    increments : Increments
        IMU axes, evenly sampled.
    span : (float, float)
        At rest. [s]
    tau_s : float
        Where the curve falls with the square root: beyond the sensor's filter, before its instability. [s]

    Returns
    -------
    ndarray, shape (3,)
        [rad/sqrt(s)]

    Raises
    ------
    InputError
        If the rest is shorter than twenty times ``tau_s``.

    References
    ----------
    Du (2015), section 4.1, where the NAV440's 0.4 deg/sqrt(h) are found this way; IEEE Std 952, annex C.
    """
    from schuler.characterisation.allan import allan_deviation

    part = increments.between(*span)
    duration = float(np.sum(part.dt))
    if duration < _LEAST * tau_s:
        raise InputError(
            f"span: expected a rest of at least {_LEAST * tau_s:g} s for an averaging time of {tau_s:g} s, "
            f"got {duration:g} s; rest longer or pass a shorter tau_s"
        )
    rate_hz = len(part) / duration
    found = [
        allan_deviation(axis / part.dt, rate_hz, taus=[tau_s], noise=0.0).deviation[0] for axis in part.dtheta_ib_b.T
    ]
    return np.asarray(np.array(found) * np.sqrt(tau_s))
