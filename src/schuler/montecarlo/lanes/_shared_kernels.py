"""The engine's own functions in lanes: the same Python text, compiled by a second dispatcher (``jit.lane_version``).

A function is here after those it calls. Where the text branches on the size of a number, the helper that branches is
replaced by what all lanes do: the series for small rotations, and positions off the poles.
"""
# mypy: disallow-untyped-defs=False, disallow-incomplete-defs=False
# mypy: disallow-untyped-calls=False, check-untyped-defs=False

from __future__ import annotations

import schuler.filtering.kernels.accumulation as accumulation
import schuler.filtering.kernels.axes as axes
import schuler.filtering.kernels.covariance as covariance
import schuler.filtering.kernels.sensor_errors as sensor_errors
import schuler.filtering.kernels.update as update
import schuler.mechanization.kernels as mechanization
from schuler.jit import inlined, lane_version


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

invert3 = lane_version(sensor_errors.invert3)
spread_estimates = lane_version(sensor_errors.spread_estimates, invert3=invert3)
compensate = lane_version(sensor_errors.compensate)

dcm = lane_version(covariance.dcm)
gram = lane_version(covariance.gram)
transition = lane_version(covariance.transition)
add_half_noise = lane_version(covariance.add_half_noise, dcm=dcm)
scale_parameters = lane_version(covariance.scale_parameters)
navigation_rows = lane_version(
    covariance.navigation_rows,
    apply_navigation=lane_version(covariance.apply_navigation),
    add_parameters=lane_version(
        covariance.add_parameters,
        gram=gram,
        gram_two=lane_version(covariance.gram_two),
        gram_one=lane_version(covariance.gram_one),
    ),
)

regressor_integrals = lane_version(accumulation.regressor_integrals)
store_interval = lane_version(accumulation.store_interval, dcm=dcm, regressor_integrals=regressor_integrals)
parameter_columns = lane_version(
    accumulation.parameter_columns,
    sum_source=lane_version(accumulation.sum_source, gram=gram),
    column=lane_version(accumulation.column),
)

turn_axes = lane_version(
    axes.turn_axes,
    spread_estimates=spread_estimates,
    write_change=lane_version(
        axes.write_change,
        add_rotation=lane_version(axes.add_rotation, response=lane_version(axes.response)),
        dcm=dcm,
    ),
    add_turned=lane_version(axes.add_turned),
)
