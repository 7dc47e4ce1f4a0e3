"""What aids the runs of a campaign in lanes: measurements of the truth, and the noise that each run adds to them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from schuler import frames
from schuler.arrays import ArrayLike, BoolArray, FloatArray, as_floats
from schuler.exceptions import InputError
from schuler.filtering.measurements import (
    POSITION,
    VELOCITY,
    ZERO_VELOCITY,
    MeasurementSchedule,
    gate_threshold,
    in_windows,
    merged,
    zero_velocity,
)
from schuler.gnss.ranges import Ranges
from schuler.montecarlo.lanes.sky import SINGLE_KINDS, SkyErrors, numbered, true_measurements
from schuler.simulation.gnss import GnssModel
from schuler.simulation.motion import Motion
from schuler.simulation.satellites import PreparedSky, SatelliteModel, draw_satellites
from schuler.simulation.scalar_aids import times

KINDS = (POSITION, VELOCITY, ZERO_VELOCITY)


@dataclass(frozen=True)
class LaneAiding:
    """True measurements with the 1-sigma of what each run adds to them.

    Attributes
    ----------
    schedule : MeasurementSchedule
        Positions, velocities and zero velocities, or codes, range rates and carrier phases of single satellites, free
        of noise; R, lever arm and gate as the filter takes them. A
        negative gate means that the measurement is lost: its noise is drawn all the same, so that the others keep
        theirs.
    sigma : ndarray, shape (m, 3)
        White 1-sigma north, east, down that is added, whatever R claims; of single satellites zero. [m], [m/s]
    sky : SkyErrors, optional
        What errors of single satellites are drawn from.
    """

    schedule: MeasurementSchedule
    sigma: FloatArray
    sky: SkyErrors | None = None

    def __post_init__(self) -> None:
        sigma = as_floats(self.sigma, "sigma", (len(self.schedule), 3))
        object.__setattr__(self, "sigma", sigma)
        if np.any(sigma < 0.0):
            raise InputError("LaneAiding.sigma: expected standard deviations, not negative")
        kinds = KINDS if self.sky is None else SINGLE_KINDS
        if not np.isin(self.schedule.kind, kinds).all():
            raise InputError(
                "runs in lanes know positions, velocities and zero velocities only, or single satellites only; use the "
                "engine"
            )
        if self.sky is not None and len(self.sky.epoch) != len(self.schedule):
            raise InputError(f"expected errors of {len(self.schedule)} measurements, got {len(self.sky.epoch)}")
        if self.sky is None and np.any(self.schedule.z[self.schedule.kind != POSITION, 3:6]):
            raise InputError(
                "runs in lanes have lever arms fixed to the IMU; where it turns on a platform use the engine"
            )
        if len(self.schedule) and np.any(np.diff(self.schedule.t) < 0.0):
            raise InputError("measurements are taken in order of their time: use lane_aiding.together or sort them")

    def __len__(self) -> int:
        return len(self.schedule)

    @classmethod
    def none(cls) -> LaneAiding:
        """No measurement at all: free inertial navigation."""
        return cls(MeasurementSchedule.empty(), np.empty((0, 3)))

    def without(self, windows: Sequence[tuple[float, float]]) -> LaneAiding:
        """GNSS lost in ``start <= t < stop`` of each window [s]; every other measurement keeps its noise."""
        s = self.schedule
        lost = in_windows(s.t, windows) & np.isin(s.kind, (POSITION, VELOCITY, *SINGLE_KINDS))
        return replace(self, schedule=replace(s, gate=np.where(lost, -1.0, s.gate)))

    def where(self, keep: BoolArray) -> LaneAiding:
        """The measurements selected by a boolean array."""
        return LaneAiding(
            self.schedule.where(keep), self.sigma[keep], None if self.sky is None else self.sky.where(keep)
        )

    def axes(self) -> FloatArray:
        """Axes of the noise as columns, in those of the value: ``C_en`` for positions, else the identity. (m, 3, 3)"""
        C = np.tile(np.eye(3), (len(self), 1, 1))
        at = self.schedule.kind == POSITION
        C[at] = frames.C_en(frames.llh_from_ecef(self.schedule.z[at, :3]))
        return C


def true_gnss(
    motion: Motion, model: GnssModel, *, use_velocity: bool = True, gate: float | None = 0.9999
) -> LaneAiding:
    """Loosely coupled GNSS of a simulated receiver, its truth and its white noise.

    Parameters
    ----------
    motion : Motion
        Of the IMU.
    model : GnssModel
        Rates, errors, lever arm, outages and what it claims. Times and covariances are those of
        :func:`schuler.simulation.gnss.draw_gnss`.
    use_velocity : bool
        False takes positions only.
    gate : float, optional
        Probability with which a correct measurement passes; None accepts everything.

    Raises
    ------
    InputError
        If the receiver drifts, fails, repeats itself or has a wrong clock: lanes have none of these.
    """
    odd = [
        name
        for name in ("drift_position", "drift_velocity", "faults", "stale", "clock_shift")
        if np.any(np.asarray(getattr(model, name), dtype=object))
    ]
    if odd:
        raise InputError(
            f"runs in lanes have white GNSS errors only, this receiver has {', '.join(odd)}: use the engine"
        )
    t = times(motion.duration, model.rate_hz, model.first_s)
    s = motion.state(t)
    lever = np.asarray(model.lever_arm_b)
    r = s.r_eb_e + s.C_eb @ lever
    v_e = s.v_eb_e + np.einsum("nij,nj->ni", s.C_eb, np.cross(s.omega_eb_b, lever))
    v_n = np.einsum("nji,nj->ni", frames.C_en(frames.llh_from_ecef(r)), v_e)
    limit = gate_threshold(gate, 3)
    parts, sigmas = [], []
    for kind, z, white, claimed in (
        (POSITION, r, model.sigma_position, model.reported_position),
        (VELOCITY, v_n, model.sigma_velocity, model.reported_velocity),
    ):
        if kind == VELOCITY and not use_velocity:
            continue
        R = np.tile(np.diag(np.asarray(white if claimed is None else claimed) ** 2), (len(t), 1, 1))
        parts.append(MeasurementSchedule.of(kind, t, z, R, lever, limit))
        sigmas.append(np.tile(np.asarray(white), (len(t), 1)))
    return together(*(LaneAiding(p, x) for p, x in zip(parts, sigmas, strict=True))).without(model.outages)


def true_satellites(
    prepared: PreparedSky, model: SatelliteModel, measurements: Callable[[Ranges], MeasurementSchedule]
) -> LaneAiding:
    """Codes, range rates and carrier phases of single satellites: their truth, and what their errors are drawn from.

    Parameters
    ----------
    prepared : PreparedSky
        Of this model, see :func:`schuler.simulation.satellites.prepare_sky`.
    model : SatelliteModel
    measurements : callable
        Makes the filter's schedule of ranges, such as
        :func:`schuler.navigation.aids.satellite.range_measurements` with a lever arm. Only rows it takes are measured.

    Raises
    ------
    InputError
        If satellites fail, or carriers or the receiver's clock jump: lanes have none of these.
    """
    odd = [name for name in ("faults", "clock_jumps", "clock_shift", "slips_per_hour") if getattr(model, name)]
    if odd:
        raise InputError(
            f"runs in lanes have satellites and receivers without faults, this receiver has {', '.join(odd)}: use the "
            "engine"
        )
    made = draw_satellites(prepared, model, np.random.default_rng(0)).made
    schedule, sky = true_measurements(
        measurements(numbered(made.ranges)), made.ranges, made.epoch, prepared.sky, model.errors
    )
    return LaneAiding(schedule, np.zeros((len(schedule), 3)), sky)


def true_rests(t: ArrayLike, sigma: float) -> LaneAiding:
    """Zero velocity at times at which the IMU truly rests; nothing is added. See ``measurements.zero_velocity``."""
    schedule = zero_velocity(t, sigma)
    return LaneAiding(schedule, np.zeros((len(schedule), 3)))


def together(*aids: LaneAiding) -> LaneAiding:
    """Several aids in order of time; equal times keep the order of the arguments."""
    if any(a.sky is not None for a in aids):
        raise InputError("runs in lanes take single satellites alone, without other aids; use the engine")
    t = np.concatenate([a.schedule.t for a in aids]) if aids else np.empty(0)
    order = np.argsort(t, kind="stable")
    sigma = np.concatenate([a.sigma for a in aids])[order] if aids else np.empty((0, 3))
    return LaneAiding(merged(*(a.schedule for a in aids)), sigma)
