"""The platform of a rotary study as a page turns it: attitude of the IMU and axes of the platform over one cycle."""

from __future__ import annotations

from typing import Any

import numpy as np

from schuler.rotary import gimbals
from schuler.rotary.report import cycle, projected
from schuler.rotary.schedule import Schedule

_FRAMES = 360
_DIGITS = 4


def platform_document(schedule: Schedule, duration: float) -> dict[str, Any]:
    """Frames of one cycle for the script of the page.

    Parameters
    ----------
    schedule : Schedule
    duration : float
        Of the mission. [s]

    Returns
    -------
    dict
        ``name``; ``t`` [s]; ``C``: of each frame the attitude of the IMU in the vehicle, nine numbers by rows;
        ``axes``: of each frame the directions of the platform's axes, outermost first; ``view``: what forward, right
        and down of the vehicle are on the page, to the right, up and towards the viewer.
    """
    t = np.linspace(0.0, cycle(schedule, duration), _FRAMES)
    angles = schedule.angles(t)
    axes = [
        gimbals.C_bs(schedule.axes[:k], angles[:, :k], np.eye(3)) @ schedule.axes[k] if k else
        np.broadcast_to(schedule.axes[0], (len(t), 3)) for k in range(len(schedule.axes))
    ]  # fmt: skip
    seen, depth = projected(np.eye(3))
    return {
        "name": schedule.name, "t": np.round(t, 3).tolist(),
        "C": np.round(schedule.C_bs(t).reshape(-1, 9), _DIGITS).tolist(),
        "axes": np.round(np.stack(axes, axis=1), _DIGITS).tolist(),
        "view": np.round(np.column_stack((seen, depth)), 6).tolist(),
    }  # fmt: skip
