"""Usual fixes as measurements of loose coupling, in one compiled call each."""

from __future__ import annotations

import numpy as np

from schuler.filtering.measurements import POSITION, VELOCITY, MeasurementSchedule, gate_threshold
from schuler.live.messages import Fix
from schuler.navigation.config import GnssSection
from schuler.navigation.inputs.preparation import LARGEST_HEIGHT, LARGEST_VELOCITY, NO_POSITION

_NOTHING = np.empty(3), np.empty((3, 3))


class Weighing:
    """Weights of a configuration on fixes.

    Parameters
    ----------
    section : GnssSection
        Lever arm, gate, scales and floors of 1-sigmas, whether velocities are used.
    """

    def __init__(self, section: GnssSection) -> None:
        from schuler.jit import direct
        from schuler.live import _kernels

        _kernels.prepare_live()
        self._weigh_fix = direct(_kernels.weigh_fix)
        s = section
        self._weights = np.array(
            [
                np.append(s.sigma_scale * np.array(scale), np.array(floor) ** 2)
                for scale, floor in (
                    (s.position_sigma_scale, s.position_sigma_floor_m),
                    (s.velocity_sigma_scale, s.velocity_sigma_floor_m_s),
                )
            ]
        )
        self._limits = np.array([NO_POSITION, LARGEST_HEIGHT, LARGEST_VELOCITY])
        self._velocity = s.velocity
        self._kind = np.array([POSITION, VELOCITY])
        self._lever = np.tile(np.array(s.lever_arm_m, dtype=np.float64), (2, 1))
        self._gate = np.full(2, gate_threshold(None if isinstance(s.gate, str) else s.gate, 3))

    def schedule(self, fix: Fix) -> MeasurementSchedule | None:
        """Measurements of a fix, with the numbers of ``prepared_gnss`` and ``gnss_measurements``; None if not usual."""
        (v_n, cov_v_n), n = _NOTHING, 1
        if fix.v_n is not None and fix.cov_v_n is not None:
            v_n, cov_v_n, n = fix.v_n, fix.cov_v_n, 2
        llh, cov_r_n = fix.llh, fix.cov_r_n
        for x, shape in ((llh, (3,)), (cov_r_n, (3, 3)), (v_n, (3,)), (cov_v_n, (3, 3))):
            if x.shape != shape or x.dtype != np.float64 or not x.flags.c_contiguous:
                return None
        z, R = np.zeros((n, 8)), np.empty((n, 3, 3))
        if not self._weigh_fix(llh, cov_r_n, v_n, cov_v_n, self._limits, self._weights, z, R):
            return None
        n = n if self._velocity else 1
        t = np.empty(n)
        t[:] = fix.t
        return MeasurementSchedule(t, self._kind[:n], z[:n], R[:n], self._lever[:n], self._gate[:n])
