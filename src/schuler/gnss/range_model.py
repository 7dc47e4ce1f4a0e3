"""What a range and a range rate should be, and how they change with the receiver's position and velocity.

Models, with satellites as in :class:`schuler.gnss.ranges.Ranges` (axes of transmission)::

    range      = |r_s - r| + (omega / c) (x_s y - y_s x) + clock(group)
    range rate = u . (v_s - v) + (omega / c) (vx_s y + x_s vy - vy_s x - y_s vx) + drift

``u`` is the unit vector from receiver to satellite, ``v_s`` the satellite's velocity. A second of reception is not a
second of transmission: the rate a receiver measures is ``1 + u . v_s / c`` times smaller (3 mm/s at most), which
:func:`schuler.gnss.preparation.prepare_ranges` puts right, as do synthetic ranges, so that the model stays linear.
"""

from __future__ import annotations

import numpy as np

from schuler.arrays import FloatArray
from schuler.earth import WGS84
from schuler.gnss.signals import SPEED_OF_LIGHT

_TURN = WGS84.omega_ie / SPEED_OF_LIGHT


def predicted_ranges(r_sat_e: FloatArray, r_e: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Range without clock, and its derivative by the receiver's position. Shapes (..., 3) to (...), (..., 3).

    Source: Groves (2013), section 8.5.3, to first order in the travel time; see :func:`schuler.gnss.ranges.sagnac`.
    """
    d = r_sat_e - r_e
    distance = np.sqrt(np.sum(d * d, axis=-1))
    gradient = -d / distance[..., None]
    gradient[..., 0] -= _TURN * r_sat_e[..., 1]
    gradient[..., 1] += _TURN * r_sat_e[..., 0]
    return distance + _TURN * (r_sat_e[..., 0] * r_e[..., 1] - r_sat_e[..., 1] * r_e[..., 0]), gradient


def predicted_rates(
    r_sat_e: FloatArray, v_sat_e: FloatArray, r_e: FloatArray, v_e: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Range rate without drift, and its derivative by the receiver's velocity. Shapes (..., 3) to (...), (..., 3).

    It is the derivative of :func:`predicted_ranges` by time: the same gradient, and the satellite's part.
    """
    _, gradient = predicted_ranges(r_sat_e, r_e)
    d = r_sat_e - r_e
    u = d / np.sqrt(np.sum(d * d, axis=-1))[..., None]
    satellite = np.sum(u * v_sat_e, axis=-1)
    satellite = satellite + _TURN * (v_sat_e[..., 0] * r_e[..., 1] - v_sat_e[..., 1] * r_e[..., 0])
    return satellite + np.sum(gradient * v_e, axis=-1), gradient
