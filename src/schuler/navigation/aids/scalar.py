"""Heading and height sensors, and fixes at surveyed places."""

from __future__ import annotations

import numpy as np

from schuler import frames
from schuler.arrays import ArrayLike, as_floats, as_vector3
from schuler.exceptions import InputError
from schuler.filtering.measurements import (
    FIX,
    GNSS_HEADING,
    HEADING,
    HEIGHT,
    MeasurementSchedule,
    gate_threshold,
)
from schuler.recording.series import ScalarSeries


def heading_measurements(
    heading: ScalarSeries, *, declination: float = 0.0, from_gnss: bool = False, gate: float | None = 0.9999
) -> MeasurementSchedule:
    """Heading of a magnetometer or of two antennas.

    Parameters
    ----------
    heading : ScalarSeries
        From north over east, of the body's x axis. [rad]
    declination : float
        Added to a magnetic heading: positive where the needle points east of true north. [rad]
    from_gnss : bool
        Two antennas: stops in an outage.
    gate : float, optional
        Probability with which a correct measurement passes.

    Notes
    -----
    Pitch near +-90 degrees has no heading; such attitudes are not caught.
    """
    kind = GNSS_HEADING if from_gnss else HEADING
    return MeasurementSchedule.of(
        kind, heading.t, heading.value + declination, heading.sigma**2, gate=gate_threshold(gate, 1)
    )


def height_measurements(
    height: ScalarSeries, *, lever_b: ArrayLike = (0.0, 0.0, 0.0), gate: float | None = 0.9999
) -> MeasurementSchedule:
    """Height of a barometer at ``lever_b`` [m] from the IMU; its bias is the state block ``baro``."""
    return MeasurementSchedule.of(
        HEIGHT, height.t, height.value, height.sigma**2, as_vector3(lever_b, "lever_b"), gate_threshold(gate, 1)
    )


def known_positions(
    t: ArrayLike,
    llh: ArrayLike,
    sigma: ArrayLike,
    *,
    lever_b: ArrayLike = (0.0, 0.0, 0.0),
    gate: float | None = None,
) -> MeasurementSchedule:
    """Fixes at surveyed places (a mark, a terminal), which go on in GNSS outages.

    Parameters
    ----------
    t : array_like, shape (m,)
        [s]
    llh : array_like, shape (m, 3)
        Latitude, longitude [rad], ellipsoidal height [m].
    sigma : array_like, shape (3,)
        1-sigma north, east, down. [m]
    lever_b : array_like, shape (3,)
        From the IMU to the point that was there. [m]
    gate : float, optional
        Probability with which a correct fix passes; by default every fix is used.

    Raises
    ------
    InputError
        If times and places do not pair, angles are not in radians, or a sigma is not positive.
    """
    t, llh = as_floats(t, "t", (None,)), as_floats(llh, "llh", (None, 3))
    if len(t) != len(llh):
        raise InputError(f"expected as many times as places, got {len(t)} and {len(llh)}")
    if np.any(np.abs(llh[:, 0]) > 0.5 * np.pi) or np.any(np.abs(llh[:, 1]) > 2.0 * np.pi):
        raise InputError("llh: expected latitude and longitude in radians; these look like degrees")
    sigma = as_vector3(sigma, "sigma")
    if np.any(sigma <= 0.0):
        raise InputError(f"sigma: expected positive values, got {sigma}")
    R = np.tile(np.diag(sigma**2), (len(t), 1, 1))
    order = np.argsort(t, kind="stable")
    return MeasurementSchedule.of(
        FIX, t[order], frames.ecef_from_llh(llh[order]), R, as_vector3(lever_b, "lever_b"), gate_threshold(gate, 3)
    )
