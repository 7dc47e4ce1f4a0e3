"""Fine alignment at rest: the filter itself, fed with zero velocities, from a coarse attitude."""

from __future__ import annotations

import numpy as np

from schuler.arguments import explains_arguments
from schuler.arrays import ArrayLike, as_vector3
from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions, run
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import zero_velocity
from schuler.filtering.states import StateLayout
from schuler.mechanization.alignment import Alignment
from schuler.mechanization.strapdown import NavState
from schuler.navigation.result import NavigationResult
from schuler.recording.series import Increments
from schuler.sensors.spec import ImuSpec


@explains_arguments
def fine_alignment(
    increments: Increments,
    llh: ArrayLike,
    coarse: Alignment,
    spec: ImuSpec,
    layout: StateLayout,
    *,
    sigma_velocity: float = 0.01,
    sigma_position: float = 1.0,
    update_s: float = 1.0,
) -> tuple[InitialState, NavigationResult]:
    """Refine the attitude and estimate gyro biases from a stretch at rest.

    Parameters
    ----------
    increments : Increments
        A log at rest, body axes.
    llh : array_like, shape (3,)
        Position: latitude, longitude [rad], ellipsoidal height [m].
    coarse : Alignment
        Levelled and gyrocompassed, or with a heading from elsewhere.
    spec : ImuSpec
    layout : StateLayout
    sigma_velocity : float
        1-sigma disturbance of the rest: wind, passengers, an engine. [m/s]
    sigma_position : float
        1-sigma of the position. [m]
    update_s : float
        Spacing of the zero-velocity updates. [s]

    Returns
    -------
    initial : InitialState
        At the end of the stretch, for :func:`schuler.filtering.engine.run` or ``navigate``.
    result : NavigationResult
        The alignment's own history.

    Raises
    ------
    InputError
        If the stretch is shorter than five updates.

    Notes
    -----
    At rest an accelerometer bias cannot be told from a tilt, nor an east gyro bias from a heading error: the claimed
    covariance stops there, at ``b_a / g`` and ``b_g / (omega_ie cos(lat))``, and so does any method.

    The coarse attitude owes its error to the very biases that are estimated here. It is therefore started from with
    that correlation: taken as independent knowledge the biases would be counted twice.

    References
    ----------
    Groves (2013), section 5.6.3.
    """
    length = float(increments.t[-1] - increments.start)
    if length < 5.0 * update_s:
        raise InputError(f"fine alignment needs at least {5.0 * update_s:g} s at rest, got {length:.2f} s")
    nav = NavState.from_geodetic(increments.start, as_vector3(llh, "llh"), (0.0, 0.0, 0.0), coarse.rpy_nb)
    start = InitialState.from_sigmas(
        nav, layout, attitude=np.zeros(3), velocity=np.full(3, sigma_velocity), position=np.full(3, sigma_position)
    ).aligned(coarse, layout)
    schedule = zero_velocity(np.arange(increments.start + update_s, increments.t[-1] + 1e-9, update_s), sigma_velocity)
    forward = run(
        increments,
        schedule,
        start,
        layout,
        np.full(3, spec.gyro.random_walk**2),
        np.full(3, spec.accel.random_walk**2),
        FilterOptions(record_s=max(update_s, length / 1000.0)),
    )
    result = NavigationResult.from_run(
        forward, schedule.t, schedule.kind, layout, notes=("fine alignment at rest by zero-velocity updates",)
    )
    end = result.trajectory
    state = NavState(float(end.t[-1]), end.r_eb_e[-1], end.v_eb_e[-1], end.q_eb[-1])
    return InitialState(state, result.covariance[-1], result.parameters[-1]), result
