"""Simulated GNSS solutions: white and time-correlated errors, outages, faults, stale and late fixes, wrong stamps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from schuler import frames
from schuler.arrays import BoolArray, FloatArray, as_vector3
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged
from schuler.recording.series import GnssSeries
from schuler.sensors.noise import gauss_markov
from schuler.simulation.motion import Motion
from schuler.simulation.scalar_aids import outside, times


class GnssFault(NamedTuple):
    """A receiver that is wrong and does not say so.

    Attributes
    ----------
    start, stop : float
        [s]
    position, velocity : tuple of 3 floats
        Added to its solutions, north, east, down. [m], [m/s]
    """

    start: float
    stop: float
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True, repr=False)
class GnssModel(Abridged):
    """Solutions of a receiver and their errors.

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
    reported_position, reported_velocity : ndarray, shape (3,), optional
        1-sigma it claims, instead of that of its white errors. [m], [m/s]
    faults : tuple of GnssFault
    stale : float
        Probability with which an epoch holds the solution of the one before under its own stamp.
    late, late_time : float
        Probability with which a solution is delivered late, and by how much more. [s]
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
    reported_position: FloatArray | tuple[float, float, float] | None = None
    reported_velocity: FloatArray | tuple[float, float, float] | None = None
    faults: tuple[GnssFault, ...] = ()
    stale: float = 0.0
    late: float = 0.0
    late_time: float = 0.0

    def __post_init__(self) -> None:
        for name in ("sigma_position", "sigma_velocity", "drift_position", "drift_velocity", "lever_arm_b"):
            object.__setattr__(self, name, as_vector3(getattr(self, name), f"GnssModel.{name}"))
        if not (self.rate_hz > 0.0 and self.drift_time > 0.0 and self.latency >= 0.0):
            raise InputError("GnssModel: expected positive rate_hz and drift_time and latency >= 0")
        if np.any(np.asarray(self.sigma_position) <= 0.0) or np.any(np.asarray(self.sigma_velocity) <= 0.0):
            raise InputError("GnssModel: a receiver's white errors must be positive; use 1e-3 for a nearly perfect one")
        for name in ("reported_position", "reported_velocity"):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, value := as_vector3(value, f"GnssModel.{name}"))
                if np.any(value <= 0.0):
                    raise InputError(f"GnssModel.{name}: expected positive values, got {value}")
        if not (0.0 <= self.stale < 1.0 and 0.0 <= self.late <= 1.0 and self.late_time >= 0.0):
            raise InputError("GnssModel: expected stale in 0..1 (1 excluded), late in 0..1 and late_time >= 0")


class SimulatedGnss(NamedTuple):
    """Solutions and what is true of them.

    Attributes
    ----------
    gnss : GnssSeries
    drift_position, drift_velocity : ndarray, shape (n, 3)
        Correlated errors at each fix, north, east, down. [m], [m/s]
    stale : ndarray of bool, shape (n,)
        Fixes that repeat the one before.
    """

    gnss: GnssSeries
    drift_position: FloatArray
    drift_velocity: FloatArray
    stale: BoolArray


def simulate_gnss(motion: Motion, model: GnssModel, rng: np.random.Generator) -> GnssSeries:
    """GNSS solutions of an antenna on a moving body; see :func:`draw_gnss`, which also returns the truth."""
    return draw_gnss(motion, model, rng).gnss


def draw_gnss(motion: Motion, model: GnssModel, rng: np.random.Generator) -> SimulatedGnss:
    """GNSS solutions of an antenna on a moving body, and the truth about them.

    Parameters
    ----------
    motion : Motion
        Motion of the IMU.
    model : GnssModel
    rng : numpy.random.Generator

    Returns
    -------
    SimulatedGnss
        Covariances are those of the white errors only, as receivers report them, or what the model claims.

    Raises
    ------
    InputError
        If the outages leave nothing.
    """
    t = times(motion.duration, model.rate_hz, model.first_s)
    white = rng.standard_normal((len(t), 6))
    drift = gauss_markov(1.0, model.drift_time, (len(t), 6), 1.0 / model.rate_hz, rng)
    chance = rng.uniform(size=(2, len(t)))
    keep = outside(t, model.outages, "GNSS fix")
    t, white, drift, chance = t[keep], white[keep], drift[keep], chance[:, keep]
    s = motion.state(t)
    lever = np.asarray(model.lever_arm_b)
    r = s.r_eb_e + s.C_eb @ lever
    v_e = s.v_eb_e + np.einsum("nij,nj->ni", s.C_eb, np.cross(s.omega_eb_b, lever))
    C_en = frames.C_en(frames.llh_from_ecef(r))
    drift_r = np.asarray(model.drift_position) * drift[:, :3]
    drift_v = np.asarray(model.drift_velocity) * drift[:, 3:]
    error_r = np.asarray(model.sigma_position) * white[:, :3] + drift_r
    error_v = np.asarray(model.sigma_velocity) * white[:, 3:] + drift_v
    for fault in model.faults:
        wrong = (t >= fault.start) & (t < fault.stop)
        error_r[wrong] += fault.position
        error_v[wrong] += fault.velocity
    llh = frames.llh_from_ecef(r + np.einsum("nij,nj->ni", C_en, error_r))
    v_n = np.einsum("nji,nj->ni", C_en, v_e) + error_v
    stale = chance[0] < model.stale
    stale[0] = False
    source = np.maximum.accumulate(np.where(stale, 0, np.arange(len(t))))
    claimed_r = model.sigma_position if model.reported_position is None else model.reported_position
    claimed_v = model.sigma_velocity if model.reported_velocity is None else model.reported_velocity
    n = len(t)
    gnss = GnssSeries(
        t=t + model.clock_shift,
        llh=llh[source],
        cov_r_n=np.tile(np.diag(np.asarray(claimed_r) ** 2), (n, 1, 1)),
        v_n=v_n[source],
        cov_v_n=np.tile(np.diag(np.asarray(claimed_v) ** 2), (n, 1, 1)),
        quality=np.full(n, 5),
        received=t + model.latency + np.where(chance[1] < model.late, model.late_time, 0.0),
    )
    return SimulatedGnss(gnss, drift_r[source], drift_v[source], stale)
