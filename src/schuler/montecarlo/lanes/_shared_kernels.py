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
import schuler.filtering.kernels.range as ranges
import schuler.filtering.kernels.sensor_errors as sensor_errors
import schuler.filtering.kernels.update as update
import schuler.filtering.kernels.vehicle as vehicle
import schuler.mechanization.kernels as mechanization
from schuler.filtering.kernels.vector import where_at_most
from schuler.jit import inlined, lane_version


@inlined
def longitude_direction(x, y, p):
    """Cosine and sine of longitude; no run comes near the poles."""
    return x / p, y / p


@inlined
def mean_rate(reg):
    """Mean angular rate of the present interval, body axes, and one over its length; zero before the first one."""
    k = where_at_most(reg[0], 0.0, 0.0, 1.0 / reg[0])
    return k * reg[4], k * reg[5], k * reg[6], k


@inlined
def estimated_lever(lever, est, i_lever):
    """Lever arm in body axes, of which runs in lanes estimate no error."""
    return lever[0], lever[1], lever[2]


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
add_clock_drift = lane_version(covariance.add_clock_drift)
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

turned_by = lane_version(update.turned_by)
pseudorange = lane_version(ranges.pseudorange, dcm=dcm, clock_columns=lane_version(ranges.clock_columns))
pseudorange_row = lane_version(
    update.pseudorange_row,
    estimated_lever=estimated_lever,
    turned_by=turned_by,
    dcm=dcm,
    pseudorange=pseudorange,
    multipath=lane_version(ranges.multipath),
)
carrier_phase_row = lane_version(
    update.carrier_phase_row,
    estimated_lever=estimated_lever,
    turned_by=turned_by,
    dcm=dcm,
    pseudorange=pseudorange,
    ambiguity=lane_version(ranges.ambiguity),
)
range_rate_row = lane_version(
    update.range_rate_row,
    estimated_lever=estimated_lever,
    turned_by=turned_by,
    dcm=dcm,
    mean_rate=mean_rate,
    range_rate=lane_version(ranges.range_rate, dcm=dcm),
    rate_columns=lane_version(vehicle.rate_columns),
)
