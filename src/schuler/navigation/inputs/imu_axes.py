"""Axes of an uncalibrated IMU, which its budget states to fractions of a degree or worse."""

from __future__ import annotations

import numpy as np

from schuler.arrays import FloatArray
from schuler.sensors import ImuSpec
from schuler.units import DEG

#: Beginning of the note.
AXES_UNCERTAIN = "the attitude is that of the sensors' axes"
_CLEARLY = 3.0  # times the claimed 1-sigma


def axes_against_claim(spec: ImuSpec, P_attitude: FloatArray) -> list[str]:
    """A sentence if the budget's misalignment is far above the claimed uncertainty of roll and pitch.

    Parameters
    ----------
    spec : ImuSpec
    P_attitude : ndarray, shape (3, 3)
        Covariance of the attitude at the end of a run, Earth-fixed axes. [rad^2]

    Notes
    -----
    A rotation of both triads together cannot be told from the attitude of the body by any measurement but one of the
    body's own axes. With 15 states it is not in the covariance: in simulated town drives with 2 % of misalignment roll
    and pitch were off by five times their 1-sigma. With states for the misalignments of both triads it is
    (``filtering.kernels.axes``).
    """
    misalignment = max(spec.gyro.misalignment, spec.accel.misalignment)
    claimed = float(np.sqrt(max(np.linalg.eigvalsh(P_attitude)[0], 0.0)))
    if not misalignment > _CLEARLY * claimed:
        return []
    return [
        f"{AXES_UNCERTAIN}, which the IMU's budget states to {misalignment / DEG:.1g} deg: roll, pitch and heading of "
        f"the body may differ by that, more than the {claimed / DEG:.1g} deg claimed; a calibration makes it less"
    ]
