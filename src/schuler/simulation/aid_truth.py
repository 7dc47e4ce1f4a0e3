"""True errors of the aids of a simulated recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.plotting.notebook import Abridged
from schuler.sensors.errors import ImuErrors
from schuler.simulation.satellites import SimulatedSatellites


@dataclass(frozen=True, kw_only=True, repr=False)
class AidTruth(Abridged):
    """Errors of the aids of one simulated recording; None where there is no such aid.

    Attributes
    ----------
    mount_rpy : ndarray, shape (3,)
        Roll, pitch, yaw of the IMU's axes in the vehicle. [rad]
    repeated : ndarray of bool, shape (n,), optional
        IMU samples that hold the values of the one before.
    gnss_drift_position, gnss_drift_velocity : ndarray, shape (k, 3), optional
        Correlated errors at each fix, north, east, down. [m], [m/s]
    gnss_stale : ndarray of bool, shape (k,), optional
        Fixes that repeat the one before.
    odometer_scale : float, optional
        Relative error of the odometer. [-]
    heading_bias : ndarray, shape (h,), optional
        Error of each heading. [rad]
    height_bias : ndarray, shape (b,), optional
        Error of each barometric height. [m]
    satellites : SimulatedSatellites, optional
        Clock by epoch, errors by range, which rows are faulty.
    gnss_delay : float
        Time by which GNSS fixes belong to a later moment than their stamp, on the clock of the IMU. [s]
    """

    mount_rpy: FloatArray
    repeated: BoolArray | None = None
    gnss_drift_position: FloatArray | None = None
    gnss_drift_velocity: FloatArray | None = None
    gnss_stale: BoolArray | None = None
    odometer_scale: float | None = None
    heading_bias: FloatArray | None = None
    height_bias: FloatArray | None = None
    satellites: SimulatedSatellites | None = None
    gnss_delay: float = 0.0

    def parameters(self, errors: ImuErrors | None = None) -> dict[str, Any]:
        """True values of state blocks, as plain numbers that stay with the recording's metadata.

        Parameters
        ----------
        errors : ImuErrors, optional
            Errors of the IMU: ``b_g``, ``b_a``, the parts drawn once.

        Returns
        -------
        dict
            By the names of :data:`schuler.filtering.states.BLOCKS`. What wanders is given as it is at the last sample
            of its series, about where a filter's last estimate belongs (a clock goes on by its drift until there), and
            at the first one with ``_start`` behind the name.
        """
        values_by_state: dict[str, Any] = {}
        if errors is not None:
            values_by_state |= {name: np.asarray(getattr(errors, name)).tolist() for name in ("b_g", "b_a")}
        if self.mount_rpy.any():
            values_by_state["mount"] = self.mount_rpy[1:].tolist()
        if self.gnss_delay:
            values_by_state["delay"] = self.gnss_delay
        if self.odometer_scale is not None:
            values_by_state["odometer"] = self.odometer_scale
        wandering = {"b_heading": self.heading_bias, "baro": self.height_bias}
        if self.gnss_drift_position is not None and self.gnss_drift_position.any():
            wandering["b_r"] = self.gnss_drift_position
        if self.gnss_drift_velocity is not None and self.gnss_drift_velocity.any():
            wandering["b_v"] = self.gnss_drift_velocity
        if self.satellites is not None:
            clock = self.satellites.made.clock
            wandering |= {"clock": clock[:, 0], "clock_drift": self.satellites.made.drift}
            wandering |= {f"clock_{k + 1}": clock[:, k] - clock[:, 0] for k in range(1, clock.shape[1])}
        for name, values in wandering.items():
            if values is not None and len(values):
                values_by_state |= {name: values[-1].tolist(), f"{name}_start": values[0].tolist()}
        return values_by_state
