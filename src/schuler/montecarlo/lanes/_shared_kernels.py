"""The engine's own functions in lanes: the same Python text, compiled by a second dispatcher (``jit.lane_version``).

A function is here after those it calls. Where the text branches on the size of a number, the helper that branches is
replaced by what all lanes do: the series for small rotations, and positions off the poles.
"""
# mypy: disallow-untyped-defs=False, disallow-incomplete-defs=False
# mypy: disallow-untyped-calls=False, check-untyped-defs=False

from __future__ import annotations

import schuler.filtering.kernels.covariance as covariance
import schuler.filtering.kernels.update as update
import schuler.mechanization.kernels as mechanization
import schuler.montecarlo.lanes._vector_kernels as vector
from schuler.jit import inlined, lane_version

LANES = vector.LANES  # importing it has made the lanes' types known before anything here can be compiled


@inlined
def longitude_direction(x, y, p):
    """Cosine and sine of longitude; no run comes near the poles."""
    return x / p, y / p


ned_axes = lane_version(update.ned_axes, longitude_direction=longitude_direction)

fit_interval = lane_version(mechanization.fit_interval)
cut_interval = lane_version(mechanization.cut_interval)
body_integrals = lane_version(
    mechanization.body_integrals, rotation_coefficients=lane_version(mechanization.rotation_series)
)
half_angle = lane_version(
    mechanization.half_angle, half_angle_coefficients=lane_version(mechanization.half_angle_series)
)
advance_ecef = lane_version(
    mechanization.advance_ecef,
    body_integrals=body_integrals,
    gravity_e=lane_version(mechanization.gravity_e),
    half_angle=half_angle,
    half_earth_turn=lane_version(mechanization.half_earth_turn),
)

dcm = lane_version(covariance.dcm)
invert3 = lane_version(covariance.invert3)
compensate = lane_version(covariance.compensate)
transition = lane_version(covariance.transition)
