"""Heading from a course where the mount of the IMU in the vehicle is estimated: their errors are one."""

from __future__ import annotations

import numpy as np

from schuler import rotation
from schuler.arrays import FloatArray
from schuler.filtering.initial_state import InitialState
from schuler.filtering.states import StateLayout


def with_mount_in_heading(initial: InitialState, layout: StateLayout, lever_b: FloatArray) -> InitialState:
    """Initial state whose heading came from the course, with the error that the mount angle leaves in it.

    Parameters
    ----------
    initial : InitialState
        Heading and mount are independent in it, or not known to depend on each other.
    layout : StateLayout
        Without the block ``mount`` nothing changes.
    lever_b : ndarray, shape (3,)
        From the IMU to the antenna, whose position was taken. [m]

    Returns
    -------
    InitialState

    Notes
    -----
    A course is the heading of the vehicle; that of the IMU is the course plus the yaw of its mount. So an error of the
    yaw that is estimated is one of the heading, one to one: both stay uncertain together until accelerations show the
    heading. Taken as independent, they would share the mount's true yaw between them as their stated uncertainties
    are, and no uncertainty of the mount could free the heading.
    """
    if "mount" not in layout:
        return initial
    yaw = layout["mount"].start + 1
    T = np.eye(layout.size)
    T[2, yaw] = 1.0
    T[6:9, yaw] = rotation.skew(rotation.rotate(initial.nav.q_nb, lever_b))[:, 2]
    return InitialState(initial.nav, T @ initial.P @ T.T, initial.parameters)
