"""Simulated aiding: GNSS positions and velocities with white and time-correlated errors, and an odometer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from schuler import frames, rotation
from schuler.arrays import FloatArray, as_vector3
from schuler.exceptions import InputError
from schuler.recording.series import GnssSeries, OdometerSeries
from schuler.sensors.noise import gauss_markov
from schuler.simulation.motion import Motion


@dataclass(frozen=True, kw_only=True)
class GnssModel:
    """What a receiver delivers and how wrong it is.

    Attributes
    ----------
    rate_hz : float
    sigma_position, sigma_velocity : ndarray, shape (3,)
        White 1-sigma north, east, down. [m], [m/s]
    drift_position, drift_velocity : ndarray, shape (3,)
        1-sigma of first-order Gauss-Markov errors beside them, which a receiver's own accuracy does not show.
        [m], [m/s]
    drift_time : float
        Their correlation time. [s]
    lever_arm_b : ndarray, shape (3,)
        From the IMU to the antenna, body axes. [m]
    first_s : float
        Time of the first fix; need not fall on an IMU sample. [s]
    outages : tuple of (start, stop)
        Windows without fixes. [s]
    latency : float
        Time from validity to delivery, kept in ``GnssSeries.received``. [s]
    clock_shift : float
        Added to every stamp: a receiver whose time is wrong. [s]
    """

    rate_hz: float = 1.0
    sigma_position: FloatArray | tuple[float, float, float] = (1.5, 1.5, 3.0)
    sigma_velocity: FloatArray | tuple[float, float, float] = (0.05, 0.05, 0.1)
    drift_position: FloatArray | tuple[float, float, float] = (0.0, 0.0, 0.0)
    drift_velocity: FloatArray | tuple[float, float, float] = (0.0, 0.0, 0.0)
    drift_time: float = 60.0
    lever_arm_b: FloatArray | tuple[float, float, float] = (0.0, 0.0, 0.0)
    first_s: float = 0.0
    outages: tuple[tuple[float, float], ...] = ()
    latency: float = 0.0
    clock_shift: float = 0.0

    def __post_init__(self) -> None:
        for name in ("sigma_position", "sigma_velocity", "drift_position", "drift_velocity", "lever_arm_b"):
            object.__setattr__(self, name, as_vector3(getattr(self, name), f"GnssModel.{name}"))
        if not (self.rate_hz > 0.0 and self.drift_time > 0.0 and self.latency >= 0.0):
            raise InputError("GnssModel: expected positive rate_hz and drift_time and latency >= 0")
        if np.any(np.asarray(self.sigma_position) <= 0.0) or np.any(np.asarray(self.sigma_velocity) <= 0.0):
            raise InputError("GnssModel: a receiver's white errors must be positive; use 1e-3 for a nearly perfect one")


def simulate_gnss(motion: Motion, model: GnssModel, rng: np.random.Generator) -> GnssSeries:
    """GNSS solutions of an antenna on a moving body.

    Parameters
    ----------
    motion : Motion
        Of the IMU.
    model : GnssModel
    rng : numpy.random.Generator

    Returns
    -------
    GnssSeries
        Covariances are those of the white errors only, as receivers report them.
    """
    t = np.arange(model.first_s, motion.duration + 1e-9, 1.0 / model.rate_hz)
    white = rng.standard_normal((len(t), 6))
    drift = gauss_markov(1.0, model.drift_time, (len(t), 6), 1.0 / model.rate_hz, rng)
    keep = np.ones(len(t), dtype=bool)
    for start, stop in model.outages:
        keep &= ~((t >= start) & (t < stop))
    if not keep.any():
        raise InputError("the outages leave no GNSS fix at all")
    t, white, drift = t[keep], white[keep], drift[keep]
    s = motion.state(t)
    lever = np.asarray(model.lever_arm_b)
    r = s.r_eb_e + s.C_eb @ lever
    v_e = s.v_eb_e + np.einsum("nij,nj->ni", s.C_eb, np.cross(s.omega_eb_b, lever))
    llh = frames.llh_from_ecef(r)
    C_en = frames.C_en(llh)
    error_r = np.asarray(model.sigma_position) * white[:, :3] + np.asarray(model.drift_position) * drift[:, :3]
    error_v = np.asarray(model.sigma_velocity) * white[:, 3:] + np.asarray(model.drift_velocity) * drift[:, 3:]
    n = len(t)
    return GnssSeries(
        t=t + model.clock_shift,
        llh=frames.llh_from_ecef(r + np.einsum("nij,nj->ni", C_en, error_r)),
        cov_r_n=np.tile(np.diag(np.asarray(model.sigma_position) ** 2), (n, 1, 1)),
        v_n=np.einsum("nji,nj->ni", C_en, v_e) + error_v,
        cov_v_n=np.tile(np.diag(np.asarray(model.sigma_velocity) ** 2), (n, 1, 1)),
        quality=np.full(n, 5),
        received=t + model.latency,
    )


def simulate_odometer(
    motion: Motion,
    rate_hz: float,
    rng: np.random.Generator,
    *,
    sigma: float = 0.05,
    scale_error: float = 0.0,
    lever_arm_b: Sequence[float] = (0.0, 0.0, 0.0),
) -> OdometerSeries:
    """Speed of a wheel along the body's x axis.

    Parameters
    ----------
    motion : Motion
    rate_hz : float
    rng : numpy.random.Generator
    sigma : float
        White 1-sigma. [m/s]
    scale_error : float
        Relative error of the wheel's circumference. [-]
    lever_arm_b : sequence of 3 floats
        From the IMU to the wheel, body axes. [m]
    """
    t = np.arange(0.0, motion.duration + 1e-9, 1.0 / rate_hz)
    s = motion.state(t)
    v_b = rotation.rotate(rotation.quat_conjugate(s.q_eb), s.v_eb_e) + np.cross(
        s.omega_eb_b, as_vector3(lever_arm_b, "lever")
    )
    speed = (1.0 + scale_error) * v_b[:, 0] + sigma * rng.standard_normal(len(t))
    return OdometerSeries(t, speed, np.full(len(t), sigma))
