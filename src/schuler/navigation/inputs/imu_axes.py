"""Axes of the sensors in the body, which budget or calibration states, and the attitude that is claimed with them.

Signs of the gyroscopes are the fixes' to contradict, by their course.
"""

from __future__ import annotations

import numpy as np

from schuler.arrays import FloatArray
from schuler.diagnosis.course import course_turns
from schuler.filtering.states import StateLayout
from schuler.navigation.sections import AidingSection
from schuler.navigation.start.calibrated_errors import state_places
from schuler.navigation.start.calibration import CalibrationStart
from schuler.navigation.start.sensor_errors import M_A, M_G, SIZE
from schuler.recording.series import GnssSeries, ImuSeries
from schuler.sensors import ImuSpec
from schuler.units import DEG

#: Beginning of the note.
AXES_UNCERTAIN = "the attitude is that of the sensors' axes"
#: Beginning of the note on gyroscopes of a wrong sign, by which the verdict on a run knows it.
AGAINST_COURSE = "the gyroscopes turn against the course of the fixes"
_CLEARLY = 3.0  # times the 1-sigma of the filter alone


def axes_covariance(
    spec: ImuSpec, layout: StateLayout, aiding: AidingSection, calibrated: CalibrationStart | None = None
) -> FloatArray:
    """Covariance of the rotation between body and sensors' axes that no state stands for, body axes.

    Parameters
    ----------
    spec : ImuSpec
    layout : StateLayout
        Cross-couplings among its states are in its own covariance.
    aiding : AidingSection
        Aids that show axes of the body itself.
    calibrated : CalibrationStart, optional
        Its covariance counts instead of the budget.

    Returns
    -------
    ndarray, shape (3, 3)
        Diagonal. [rad^2]

    Notes
    -----
    About each axis it is the largest variance among the four cross-couplings of the other two: at rest and straight on
    the attitude is the one in which the accelerometers feel gravity and acceleration as they should, in turns the one
    in which the gyroscopes feel their axis. Each is off by a cross-coupling, not by a mean of several.

    Wheels that do not slip show pitch and heading of the body, if the mount angles are stated without an uncertainty:
    the body then is the vehicle. With mount angles to estimate the body is the case, and wheels only tell how the
    sensors' axes lie in the vehicle. A heading sensor without a bias to estimate shows the heading.
    """
    if calibrated is None:
        variance = np.zeros(SIZE)
        variance[M_A], variance[M_G] = spec.accel.misalignment**2, spec.gyro.misalignment**2
    else:
        variance = np.diag(calibrated.errors.covariance).copy()
    variance[state_places(layout)[1]] = 0.0
    largest = np.maximum(variance[M_A], variance[M_G]).reshape(3, 3)
    about = np.array([max(largest[i, j], largest[j, i]) for i, j in ((1, 2), (2, 0), (0, 1))])
    if aiding.non_holonomic is not None and "mount" not in layout:
        about[1:] = 0.0
    if aiding.heading is not None and "b_heading" not in layout:
        about[2] = 0.0
    return np.diag(about)


def claimed_attitude(P: FloatArray, C: FloatArray, axes_covariance_b: FloatArray) -> FloatArray:
    """Covariance of the attitude of the body, no direction of which is better known than the sensors' axes are.

    Parameters
    ----------
    P : ndarray, shape (..., 3, 3)
        Covariance of the attitude of the sensors' axes, as a filter or smoother has it, any frame. [rad^2]
    C : ndarray, shape (..., 3, 3)
        Maps body axes to that frame.
    axes_covariance_b : ndarray, shape (3, 3)
        Of :func:`axes_covariance`. [rad^2]

    Returns
    -------
    ndarray, shape (..., 3, 3)
        ``P + (F - P)_+``, the positive part by eigenvalues, with F the axes' covariance in that frame. [rad^2]

    Notes
    -----
    The sum ``P + F`` would count twice what P has: it is wide where the motion has not shown the attitude yet, and the
    axes are then a small part of it. Directions that P knows worse stay to the last bit, and so does a P that is no
    number.
    """
    F = C @ axes_covariance_b @ np.swapaxes(C, -1, -2)
    finite = np.isfinite(P).all(axis=(-2, -1), keepdims=True)
    w, V = np.linalg.eigh(np.where(finite, F - P, 0.0))
    more = (V * np.maximum(w, 0.0)[..., None, :]) @ np.swapaxes(V, -1, -2)
    raised: FloatArray = P + 0.5 * (more + np.swapaxes(more, -1, -2))
    return raised


def axes_note(axes_covariance_b: FloatArray, P_attitude: FloatArray, *, calibrated: bool = False) -> list[str]:
    """A sentence if the sensors' axes are far less known than the attitude would be without them.

    Parameters
    ----------
    axes_covariance_b : ndarray, shape (3, 3)
        Of :func:`axes_covariance`. [rad^2]
    P_attitude : ndarray, shape (3, 3)
        Covariance of the attitude at the end of a run, as the filter has it, any axes. [rad^2]
    calibrated : bool
        A calibration says it, not the budget.
    """
    axes = float(np.sqrt(axes_covariance_b.max()))
    alone = float(np.sqrt(max(np.linalg.eigvalsh(P_attitude)[0], 0.0)))
    if not axes > _CLEARLY * alone:
        return []
    source, less = ("calibration", "") if calibrated else ("budget", "; 33 states or a calibration make it less")
    return [
        f"{AXES_UNCERTAIN}, which the IMU's {source} states to {axes / DEG:.2g} deg: that of the body is claimed to no "
        f"better, where motion shows the sensors' to {alone / DEG:.1g} deg{less}"
    ]


def against_course(imu: ImuSeries, gnss: GnssSeries | None) -> list[str]:
    """A sentence if the gyroscopes turn against the course of the fixes in either half of the motion.

    Parameters
    ----------
    imu : ImuSeries
        Body axes, as it is navigated.
    gnss : GnssSeries, optional
        Fixes that the run is given, at their times by the IMU's clock.
    """
    turns = None if gnss is None else course_turns(imu, gnss)
    if turns is None or not turns.reversed:
        return []
    axis = f"{turns.axis}, " if turns.axis else ""
    (a, b), (sigma_a, sigma_b) = turns.gain, turns.sigma
    return [
        f"{AGAINST_COURSE}: about {axis}the vertical that the accelerometers show, the course turns {a:.2f} times as "
        f"fast as they in the first half of the motion and {b:.2f} times in the second (1-sigma {sigma_a:.1g}, "
        f"{sigma_b:.1g})"
    ]
